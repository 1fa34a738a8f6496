/** The verdict: which effect and how sure, its signature over this study's residual, and the button that adds it. */

import { h } from "../widgets/dom.js";
import { times } from "../widgets/format.js";
import { term } from "../widgets/terms.js";
import { xyPlot } from "../charts/xy_plot.js";

const MARKS = {
  missing: { mark: "!", kind: "warn" },
  "nothing missing": { mark: "✓", kind: "good" },
  "unlisted cause": { mark: "?", kind: "bad" },
};
const AXIS = { label: "", unit: "" };

/**
 * @param {Object} app
 * @param {{of: Function}} previews
 * @param {{add: (card: Object) => void, search: () => void, all: () => void, stop: () => void, undo: () => void,
 *   take: (law: string) => void}} act
 */
export function createVerdictCard(app, previews, act) {
  const text = h("div", { class: "verdict-text", "data-testid": "card", "aria-live": "polite" });
  const last = h("p", { class: "verdict-last", role: "status", "data-testid": "last-change" });
  const button = (id, words, press, kind = "") =>
    h("button", { type: "button", class: kind, "data-testid": id, text: words, onclick: press });
  const add = button("add-best", "Add", () => act.add(card), "primary");
  const search = button("diagnose", "Look for what is missing", () => act.search());
  const all = button("diagnose-auto", "Add until nothing is missing", () => act.all());
  all.title = "Look, add the best, fit again, and so on";
  const stop = button("stop", "Stop", () => act.stop());
  const undo = button("undo-add", "Undo", () => act.undo(), "primary");
  const more = h("details", { class: "verdict-more" });
  const place = h("div", { class: "verdict-picture", "data-testid": "signature" });
  const element = h(
    "section",
    { class: "panel verdict", "data-testid": "verdict" },
    h("div", { class: "verdict-main" }, text, last, h("div", { class: "bar verdict-acts" }, add, undo, search, all, stop), more),
    place,
  );
  let card = null;
  let plot = null;
  let turn = 0;
  let wanted = new AbortController();

  function words(title, kind, mark, lines) {
    element.dataset.kind = kind;
    text.replaceChildren(
      h(
        "p",
        { class: `verdict-big ${kind}` },
        mark ? h("span", { class: "verdict-mark", "aria-hidden": "true", text: mark }) : null,
        h("span", { text: title }),
      ),
      ...lines,
    );
  }

  /** Words of the server, which counts them. */
  function verdict(study) {
    const known = MARKS[card.verdict] ?? { mark: "?", kind: "" };
    const { heads } = card;
    words(card.title, known.kind, known.mark, [
      ...card.lines.map((line) => h("p", null, `${line.text} `, line.term ? term(app, line.term) : null)),
      card.out.length
        ? h("p", { class: "verdict-out" }, `${heads.out} `,
            card.out.map((one, k) => [k ? "; " : "", h("span", { class: "code", text: one.effect }), `: ${one.why}`]))
        : null,
      card.showing.length
        ? h("p", { text: `${heads.showing} ${card.showing.map((s) => `${s.shown_by} (${s.effects})`).join(", ")}` })
        : null,
    ].filter(Boolean));
    const d = study.diagnosis;
    more.hidden = false;
    more.replaceChildren(
      h("summary", { text: "All the evidence" }),
      h("p", { text: d.says }),
      h("p", {
        class: "muted sub",
        text: `Version ${study.current}; every p is from ${d.draws} simulations. Held-out runs were not used.`,
      }),
      formulas(d),
    );
  }

  function formulas(d) {
    if (!d.formulas?.length) return "";
    return h(
      "ul",
      { class: "formulas" },
      d.formulas.map((f) =>
        h(
          "li",
          null,
          h("button", { type: "button", class: "small", onclick: () => act.take(f.text), text: "Take" }),
          " ",
          h("code", { text: f.text }),
        ),
      ),
    );
  }

  async function draw(version) {
    const mine = ++turn;
    const effect = card?.add;
    const before = wanted;
    wanted = new AbortController();
    const asked = effect ? previews.of(version, effect, () => {}, wanted.signal) : null;
    before.abort(); // only now: a fit that is still wanted goes on
    place.hidden = !effect;
    if (!effect) return;
    place.classList.add("waits");
    try {
      const found = await asked;
      if (mine !== turn || card?.add !== effect) return;
      place.classList.remove("waits");
      show(found);
    } catch {
      if (mine === turn) place.hidden = true; // the preview says why
    }
  }

  function show({ meta, arrays }) {
    if (!meta.state) {
      place.hidden = true;
      return;
    }
    plot ??= xyPlot(place, { title: "", x: AXIS, y: AXIS, items: [], testid: "signature-plot", height: 190 });
    plot.update({
      title: meta.row,
      x: { label: meta.state, unit: meta.state_unit },
      y: { label: "partial residual", unit: meta.unit },
      hint: `${meta.label} in the catalogue: ${meta.about}`,
      items: [
        { kind: "level", value: 0, colour: "--chart-ink", dash: [2, 3], width: 1 },
        { kind: "band", name: "this study, 95 %", colour: "--residual", x: arrays.state, low: arrays.low, high: arrays.high },
        { kind: "line", name: "mean", colour: "--residual", x: arrays.state, y: arrays.mean, marks: true, width: 1.4 },
        { kind: "line", name: `law of ${meta.label}`, colour: "--modelled", x: arrays.law_at, y: arrays.law, width: 2.2 },
      ],
    });
  }

  return {
    element,
    focus: () => (add.hidden ? search : add).focus({ preventScroll: true }),
    /** A job's words in the place of the verdict. */
    progress(job) {
      const count = job.total && !job.text?.includes(" of ") ? `: ${job.done} of ${job.total}` : "";
      words("Looking for what is missing", "muted", "", [h("p", { text: `${job.text || "at work"}${count}.` })]);
      more.hidden = true;
      place.hidden = true;
    },
    /**
     * @param {Object} study
     * @param {Object|null} now the present version
     * @param {{busy: string, change: Object|null}} how job that runs, and what the last change brought
     */
    update(study, now, { busy, change }) {
      const before = card;
      card = study?.card ?? null;
      const ready = Boolean(study?.exists) && !busy;
      if (!busy) {
        if (!study?.exists) {
          words("There is no model yet", "", "", [
            h("p", null, "Choose the runs to fit it on in the view ", h("a", { href: "#/runs", text: "Runs" }), "."),
          ]);
        } else if (card) verdict(study);
        else {
          const held = Number.isFinite(now?.held_error) ? `, ${times(now.held_error)} on those held out` : "";
          words(`Not looked for yet in version ${study.current}`, "", "", [
            h("p", { text: `Error ÷ floor: ${times(now?.used_error)} on the runs used${held}. Every effect of the catalogue and every sensor fault is tried.` }),
          ]);
        }
        if (!card) more.hidden = true;
      }
      const shown = change && change.version === study?.current ? change : null;
      last.hidden = !shown;
      last.textContent = shown?.says ?? "";
      last.classList.toggle("warn", Boolean(shown && shown.helps === false));
      undo.hidden = !(shown && shown.helps === false) || Boolean(busy);
      add.hidden = !card?.add || Boolean(busy);
      add.textContent = card?.add ? `Add ${card.label}` : "Add";
      search.textContent = card ? "Look again" : "Look for what is missing";
      search.classList.toggle("primary", !card && undo.hidden);
      for (const one of [add, search, all, undo]) one.disabled = !ready;
      search.hidden = all.hidden = Boolean(busy);
      stop.hidden = !busy;
      if (!busy && (card !== before || !plot)) void draw(study?.current);
      if (busy || !card?.add) place.hidden = true;
    },
    destroy() {
      turn += 1;
      wanted.abort();
      plot?.destroy();
    },
  };
}
