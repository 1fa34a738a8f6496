/** Where a model fails, in numbers: by phase of driving, and how much is left to explain. */

import { h } from "../widgets/dom.js";
import { percent, short, times } from "../widgets/format.js";
import { ratioScale } from "../charts/colour_scales.js";

/**
 * Error ÷ floor by row and phase, each number on its colour.
 * @param {object} found where_result
 * @param {string} chosen row
 * @param {(row: string) => void} onRow
 * @returns {HTMLElement}
 */
export function phaseTable(found, chosen, onRow) {
  const phases = Object.entries(found.by_phase);
  const rows = Object.keys(found.rows).sort((a, b) => found.rows[b] - found.rows[a]);
  const scale = ratioScale(Math.max(...phases.flatMap(([, own]) => Object.values(own).map((x) => x.ratio))));
  const cell = (value, strong = false) => {
    const td = h("td", { class: `num${strong ? " strong" : ""}`, text: times(value) });
    if (value !== undefined && Number.isFinite(value)) {
      td.style.background = scale.colour(value);
      td.style.color = scale.ink(value);
    }
    return td;
  };
  const seconds = (own) => Math.max(...Object.values(own).map((x) => x.seconds));
  return h("table", { class: "phase-table" },
    h("thead", null, h("tr", null, h("th", { scope: "col", text: "row" }), h("th", { scope: "col", class: "num", text: "all runs used" }),
      phases.map(([phase, own]) => h("th", { scope: "col", class: "num" }, phase, h("br"), h("span", { class: "muted", text: `${seconds(own).toFixed(1)} s` }))))),
    h("tbody", null, rows.map((row) => h("tr", { "aria-selected": String(row === chosen) },
      h("th", { scope: "row" }, h("button", { type: "button", class: "link", text: row, onclick: () => onRow(row) })),
      cell(found.rows[row], true), phases.map(([, own]) => cell(own[row]?.ratio))))));
}

/**
 * What each row's residual is made of, drawn and in words.
 * @param {object} found where_result
 * @param {string} chosen row
 * @param {(row: string) => void} onRow
 * @param {{least: number, errors: Array<object>}} about error ÷ floor that the bars reach at least; errors of the rows
 * @returns {HTMLElement}
 */
export function explainableTable(found, chosen, onRow, { least, errors }) {
  const of = new Map(errors.map((e) => [e.row, e]));
  const rows = Object.values(found.left).filter((x) => of.has(x.row))
    .map((x) => ({ ...x, error: of.get(x.row) })).sort((a, b) => b.error.ratio - a.error.ratio);
  const longest = Math.max(...rows.map((x) => x.error.ratio), least);
  return h("table", { class: "left-table" },
    h("thead", null, h("tr", null, ["row", "residual", "floor", "error ÷ floor: what it is made of", "in words"].map((text, k) =>
      h("th", { scope: "col", class: k === 1 || k === 2 ? "num" : "", text })))),
    h("tbody", null, rows.map((x) => h("tr", { "aria-selected": String(x.row === chosen) },
      h("th", { scope: "row" }, h("button", { type: "button", class: "link", text: x.row, onclick: () => onRow(x.row) })),
      h("td", { class: "num", text: `${short(x.error.rms)} ${x.unit}` }),
      h("td", { class: "num", text: `${short(x.error.floor)} ${x.unit}` }),
      h("td", { class: "made-of" }, parts(x, longest)),
      h("td", { class: "why", text: x.says })))));
}

function parts(x, longest) {
  const { ratio } = x.error;
  const present = x.something ? Math.max(0, x.part) : 0;
  const history = x.depends_on_history ? Math.max(0, x.history) : 0;
  const shares = [[present, "follows", "follows the states"], [history, "history", "follows their history"],
    [Math.max(0, 1 - present - history), "rest", "not predictable"]];
  const bar = h("span", { class: "made-bar", role: "img",
    "aria-label": `${times(ratio)} times its floor: ${shares.map(([part, , name]) => `${percent(part)} ${name}`).join(", ")}` });
  for (const [part, kind] of shares) {
    const piece = h("i", { class: `made-${kind}` });
    piece.style.width = `${100 * part * (ratio / longest)}%`;
    bar.append(piece);
  }
  const floor = h("i", { class: "made-floor", title: "noise floor" });
  floor.style.left = `${100 / longest}%`;
  bar.append(floor);
  return [bar, h("span", { class: "made-number", text: times(ratio) })];
}

/** What the pieces of the bars stand for. */
export function explainableKey() {
  const one = (kind, text) => h("span", { class: "chart-key" }, h("i", { class: `phase-swatch made-${kind}` }), text);
  return h("p", { class: "made-key" }, one("follows", "follows the measured states"), one("history", "follows their history"),
    one("rest", "not predictable: noise, or something not measured"), h("span", { class: "chart-key" }, h("i", { class: "floor-swatch" }), "noise floor"));
}
