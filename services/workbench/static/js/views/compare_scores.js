/** Scores of a run's rows: a strip for the chosen row, a table for all. */

import { h } from "../widgets/dom.js";
import { minus, short, times } from "../widgets/format.js";
import { term } from "../widgets/terms.js";

/**
 * A run's scores, by row.
 * @param {object} version of /api/study
 * @param {string} run
 * @returns {{used: boolean, rows: Array<object>}}
 */
export function scoresOf(version, run) {
  for (const used of [true, false]) {
    const own = version?.rows?.[used ? "used" : "held"]?.[run];
    if (own) return { used, rows: Array.isArray(own) ? own : Object.values(own) };
  }
  return { used: false, rows: [] };
}

/** What kind of validation a run is, in words. */
export function validation(used, run) {
  return used
    ? ["Direct validation", `run ${run} was used for the fit: the model has seen what it is compared with`]
    : ["Cross validation", `run ${run} was held out: the model is fitted to other runs and predicts this one`];
}

/** Whether a row's error can be judged, and why not. */
export function judged(score) {
  if (score.judged === false) return `cannot be judged: ${score.why}`;
  if (score.fails) return "fails: louder than its noise";
  return "at its noise floor";
}

/**
 * The chosen row's scores in one strip.
 * @param {object} app
 * @param {object|undefined} score
 * @returns {HTMLElement}
 */
export function strip(app, score) {
  const cell = (label, value, more = "", key = "") => h("div", { class: `score ${more}` }, h("dt", null, `${label} `, key ? term(app, key) : null), h("dd", { text: value }));
  if (!score) return h("dl", { class: "scores" }, cell("error", "–"), cell("row", "not in this run"));
  const bad = score.fails;
  return h("dl", { class: "scores", "data-testid": "scores" },
    cell("error, RMS", `${short(score.rms)} ${score.unit}`),
    cell("noise floor, RMS", `${short(score.floor)} ${score.unit}`, "", "floor"),
    cell("error ÷ floor, this run", times(score.ratio), bad ? "fails" : ""),
    cell("variance explained", score.noise_alone ? "–" : `${percent(score.vaf)} %`, "", "vaf"),
    cell("error ÷ span", `${short(score.nrmse, 2)} %`, "", "span"),
    cell("the residual is", score.colour || "–", "wide", "colour"),
    cell("verdict", judged(score), `wide${bad ? " fails" : ""}`, "judged"));
}

/**
 * All rows of a run.
 * @param {{rows: Array<object>, chosen: string, beneath: Set<string>, onRow: (row: string) => void,
 *   onBeneath: (row: string, on: boolean) => void}} options
 * @returns {HTMLElement}
 */
export function table({ rows, chosen, beneath, onRow, onBeneath }) {
  const head = ["row", "unit", "error", "floor", "error ÷ floor, this run", "VAF [%]", "residual", "verdict", "show"];
  return h("table", { class: "score-table" },
    h("thead", null, h("tr", null, head.map((t, k) => h("th", { scope: "col", class: k > 1 && k < 6 ? "num" : "", text: t })))),
    h("tbody", null, rows.map((score) => h("tr", { "aria-selected": String(score.row === chosen), data: { row: score.row } },
      h("th", { scope: "row" }, h("button", { type: "button", class: "link", onclick: () => onRow(score.row), text: score.row })),
      h("td", { text: score.unit }),
      h("td", { class: "num", text: short(score.rms) }),
      h("td", { class: "num", text: short(score.floor) }),
      h("td", { class: `num${score.fails ? " bad strong" : ""}`, text: times(score.ratio) }),
      h("td", { class: "num", text: score.noise_alone ? "–" : percent(score.vaf) }),
      h("td", { text: score.colour || "–" }),
      h("td", { class: "why", text: judged(score) }),
      h("td", null, h("input", { type: "checkbox", checked: beneath.has(score.row), "aria-label": `show ${score.row} beneath`,
        disabled: score.row === chosen, onchange: (e) => onBeneath(score.row, e.target.checked) }))))));
}

/**
 * Which rows are measured, derived, assumed or impossible, and what would have to be added; below, what channels that
 * are not measured are taken from, and what is assumed.
 * @param {Array<{head: Array<string>, lines: Array<Array<string>>}>} sources
 * @returns {Array<HTMLElement>}
 */
export function sourcesTables(sources) {
  if (!sources.length) return [h("p", { class: "muted", text: "Versions made from now on show it." })];
  return sources.flatMap(({ head, lines, note: below }) => {
    const filled = head.map((_, k) => lines.some((line) => line[k]));
    const shown = (line) => line.filter((_, k) => filled[k]);
    return [h("table", { class: "score-table" },
      h("thead", null, h("tr", null, shown(head).map((text) => h("th", { scope: "col", text })))),
      h("tbody", null, lines.map(shown).map(([first, ...cells]) => h("tr", null,
        h("th", { scope: "row", text: first }), cells.map((text) => h("td", { class: "why", text: text || "–" })))))),
    ...(below ? [h("p", { class: "sub muted", text: below })] : [])];
  });
}

function percent(value) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  return minus(value > 99 ? value.toFixed(2) : value.toFixed(1));
}
