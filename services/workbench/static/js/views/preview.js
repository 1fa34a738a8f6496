/** What a candidate would do to the chosen row: the residual now and with it, before it is added. */

import { needing } from "../widgets/pending.js";
import { debounce, h } from "../widgets/dom.js";
import { short } from "../widgets/format.js";

const HEIGHT = 150;

/**
 * @param {Object} app
 * @param {{effects: Map<string, Object>}} about
 */
export function createPreview(app, about) {
  const title = h("h2", { text: "What it would do" });
  const figure = h("div", { class: "preview-chart", "data-testid": "preview" });
  const numbers = h("p", { class: "preview-numbers", role: "status" });
  const why = h("div", { class: "preview-why" });
  const element = h(
    "section",
    { class: "panel preview", "aria-label": "What the chosen effect would do" },
    title,
    numbers,
    figure,
    why,
  );
  const kept = new Map();
  let chart = null;
  let candidate = null;
  let asked = null;
  let library = null;

  const load = debounce(() => void fetchIt(), 120);

  function words() {
    if (!candidate) {
      title.textContent = "What it would do";
      numbers.textContent = "Point at an effect of the ranking to see what it would do to the chosen row.";
      why.replaceChildren();
      return;
    }
    const record = about.effects.get(candidate.effect);
    title.textContent = candidate.effect;
    why.replaceChildren(
      h("p", { text: candidate.why }),
      record
        ? h("p", { class: "muted", text: `${record.about}. ${record.shown_by ? `Shown by: ${record.shown_by}.` : ""}` })
        : "",
    );
  }

  async function fetchIt() {
    const { version, run, row } = app.state;
    asked?.abort();
    if (!candidate || !run || !row || !app.state.study?.diagnosis) {
      return;
    }
    if (candidate.answer === "not testable") {
      blank("These runs do not show it: there is nothing to draw.");
      return;
    }
    const path = `api/preview/${version}/${encodeURIComponent(candidate.effect)}/${encodeURIComponent(run)}/${encodeURIComponent(row)}`;
    if (kept.has(path)) {
      await draw(kept.get(path), row, run);
      return;
    }
    numbers.textContent = `Fitting ${row} in ${run} with it …`;
    asked = new AbortController();
    const mine = asked;
    try {
      const place = { say: (text) => mine === asked && (numbers.textContent = text) };
      const found = await needing(app, () => ask(path, mine.signal), { version }, place);
      if (kept.size > 60) kept.delete(kept.keys().next().value);
      kept.set(path, found);
      if (mine === asked) await draw(found, row, run);
    } catch (cause) {
      if (cause.name !== "AbortError" && mine === asked) blank(cause.message);
    }
  }

  /** A ranking takes minutes: pointing at a line must never start one. */
  async function ask(path, signal) {
    try {
      return await app.api.binary(path, signal);
    } catch (cause) {
      if (cause.needs !== "diagnose") throw cause;
      throw new Error("Look for what is missing again to see this: the server was started anew since.");
    }
  }

  function blank(text) {
    numbers.textContent = text;
    chart?.destroy?.();
    chart = null;
    figure.replaceChildren();
  }

  async function draw({ meta, arrays }, row, run) {
    const { rms_now: now, rms_after: after, unit } = meta;
    const part = now > 0 ? (now - after) / now : 0;
    numbers.replaceChildren(
      h("b", { text: row }),
      ` in ${run}: ${short(now)} → `,
      h("b", { text: `${short(after)} ${unit}` }),
      ` RMS residual, `,
      Math.abs(part) < 0.005 ? "no change" : `${Math.abs(100 * part).toFixed(0)} % ${part > 0 ? "less" : "more"}`,
    );
    library ??= await import("../charts/time_chart.js");
    const colours = app.palette();
    const series = [
      { name: "now", values: arrays.now, colour: colours.residual, width: 1 },
      { name: "with it", values: arrays.after, colour: colours.modelled, width: 1.3 },
    ];
    if (chart) chart.update({ t: arrays.t, series, unit });
    else chart = library.timeChart(figure, { t: arrays.t, series, unit, height: HEIGHT });
  }

  words();
  return {
    element,
    show(c) {
      candidate = c;
      if (!c) blank("");
      words();
      load();
    },
    refresh: load,
    theme() {
      chart?.destroy?.();
      chart = null;
      figure.replaceChildren();
      load();
    },
    destroy() {
      load.cancel();
      asked?.abort();
      chart?.destroy?.();
    },
  };
}
