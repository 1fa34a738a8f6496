/** The run to drive next: the one that tells tied candidates apart, or shows an effect these runs cannot. */

import { h } from "../widgets/dom.js";
import { minus, short, times } from "../widgets/format.js";
import { xyPlot } from "../charts/xy_plot.js";
import { term } from "../widgets/terms.js";

/**
 * @param {Object} app
 */
export function createNextRun(app) {
  const effect = h("select", { "aria-label": "to tell apart or to show" });
  const go = h("button", { type: "button", "data-testid": "next-run-go", disabled: true, text: "Find the run" });
  const says = h("div", {
    class: "next-says",
    role: "status",
    text: "Which run would tell tied effects apart, or show one that these runs cannot.",
  });
  const element = h(
    "section",
    { class: "panel next", "data-testid": "next-run", "aria-label": "Recommended next run" },
    h("h2", null, "Which run to drive next", term(app, "next")),
    h("div", { class: "bar" }, effect, go),
    says,
  );
  const box = h("div", { class: "next-picture" });
  let picture = null;
  let may = false;
  let asking = false;
  let of = "";

  async function ask() {
    asking = true;
    go.disabled = true;
    element.classList.remove("answered");
    says.replaceChildren(h("p", { class: "muted", text: "Simulating the runs of the library …" }));
    try {
      const result = await app.api.run(
        "next",
        { effects: effect.value ? [effect.value] : [] },
        {
          onProgress: (job) => {
            says.replaceChildren(
              h("p", {
                class: "muted",
                text: `${job.text || "Simulating the runs of the library"} …`,
              }),
            );
          },
        },
      );
      show(result && "next" in result ? result.next : result);
    } catch (cause) {
      says.replaceChildren(h("p", { class: "muted", text: cause.message }));
    }
    asking = false;
    go.disabled = !may;
  }

  function show(found) {
    if (!found) {
      says.replaceChildren(
        h("p", {
          text: "Nothing is tied with the best candidate: no run is needed to tell them apart. Choose an effect to see which run would show it.",
        }),
      );
      return;
    }
    picture?.destroy();
    picture = null;
    const runs = found.runs ?? [];
    const table = !runs.length ? [] : [
      h("table", null,
        h("thead", null, h("tr", null, h("th", { scope: "col", text: "Run" }),
          ["now", "then", "at least"].map((text) => h("th", { scope: "col", class: "num", text })))),
        h("tbody", null, runs.slice(0, 4).map((r) => h("tr", null,
          h("th", { scope: "row", text: r.run }),
          h("td", { class: "num", text: short(found.now, 2) }),
          h("td", { class: "num", text: short(r.after, 2) }),
          h("td", { class: "num", text: r.seconds ? `${r.seconds.toFixed(0)} s` : "–" }))))),
      h("p", { class: "sub muted",
        text: `${found.quantity === "size" ? "How far it would stand out of its noise" : "Separation"}; ${short(found.needed, 2)} is needed.` }),
    ];
    says.replaceChildren(
      h("div", { class: "next-words" }, h("p", { text: found.says }), (found.warnings ?? []).map((w) => h("p", { class: "sub warn", text: w }))),
      box, h("div", null, table));
    element.classList.add("answered");
    draw(found.picture);
  }

  /** What the sizes may be, now and after the best run: a region for two effects, a bar for one. */
  function draw({ effects, now, after }) {
    box.replaceChildren();
    if (!after) return;
    const title = "What these sizes may be, 95 %";
    const reach = Math.min(4, Math.max(0.5, ...after.flat().map((v) => Math.abs(v - 1)))) * 2;
    const range = [1 - reach, 1 + reach];
    if (effects.length === 1) {
      box.append(sizeBars(title, effects[0], range, { now, "after the run": after }));
      return;
    }
    const edge = (points) => ({ x: points.map((p) => p[0]), y: points.map((p) => p[1]) });
    picture = xyPlot(box, {
      title, height: 280, testid: "next-picture", closed: true,
      x: { label: `${effects[0]} ÷ its size`, unit: "", range },
      y: { label: `${effects[1]} ÷ its size`, unit: "", range },
      items: [
        { kind: "line", name: "now", colour: "--residual", ...edge(now), dash: [5, 3], width: 2 },
        { kind: "line", name: "after the run", colour: "--modelled", ...edge(after), width: 2.4 },
      ],
    });
  }

  go.addEventListener("click", () => void ask());
  return {
    element,
    ready(now, diagnosis) {
      may = now && Boolean(diagnosis);
      go.disabled = !may || asking;
      const key = JSON.stringify((diagnosis?.candidates ?? []).map((c) => [c.effect, c.answer]));
      if (key === of) return;
      of = key;
      const groups = new Map(); // manoeuvre → candidates that it would show
      for (const c of diagnosis?.candidates ?? []) {
        if (c.answer !== "not testable") continue;
        groups.set(c.shown_by, [...(groups.get(c.shown_by) ?? []), c]);
      }
      effect.replaceChildren(
        h("option", {
          value: "",
          text: diagnosis ? "the best and those tied with it" : "look for what is missing first",
        }),
        ...[...groups.entries()]
          .sort((a, b) => b[1].length - a[1].length)
          .map(([shown, ones]) =>
            h("optgroup", { label: `shown by: ${shown || "other runs"}` }, ones.sort((a, b) => a.effect.localeCompare(b.effect)).map((c) => h("option", { value: c.effect, text: c.label }))),
          ),
      );
      effect.disabled = !diagnosis;
    },
  };
}

/** Bars of what the size of one effect may be, in parts of it; `range` is as wide as the picture. */
function sizeBars(title, effect, [from, to], of) {
  const at = (v) => `${(100 * Math.min(1, Math.max(0, (v - from) / (to - from)))).toFixed(1)}%`;
  return h("figure", { class: "size-bars", "data-testid": "next-picture" },
    h("figcaption", null, h("span", { class: "chart-title", text: title }), ` ${effect} ÷ its size`),
    Object.entries(of).map(([name, points]) => {
      const low = Math.min(...points.map(([v]) => v));
      const high = Math.max(...points.map(([v]) => v));
      const bar = h("i", { class: name === "now" ? "now" : "" });
      bar.style.left = at(low);
      bar.style.right = `calc(100% - ${at(high)})`;
      return h("div", { class: "size-bar" }, h("span", { text: name }), h("span", { class: "track", "aria-hidden": "true" }, bar),
        h("span", { class: "num", text: `${minus(times(low))} to ${times(high)}` }));
    }));
}
