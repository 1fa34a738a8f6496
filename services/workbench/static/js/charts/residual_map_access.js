/** The residual map without a pointer and without eyes for colours: keys, and the same as a table. */

import { h } from "../widgets/dom.js";
import { times } from "../widgets/format.js";
import { tick } from "./ticks.js";

/**
 * Moves the map's cursor by keys.
 * @param {HTMLElement} box
 * @param {{map: () => object, at: () => object, put: (at: object) => void, pick: () => void}} act
 */
export function mapKeys(box, act) {
  box.addEventListener("keydown", (event) => {
    const map = act.map();
    if (!map || event.ctrlKey || event.metaKey || event.altKey) return;
    const at = act.at() ?? { k: 0, r: 0, c: 0 };
    const by = event.shiftKey ? 10 : 1;
    let to = { ...at };
    if (event.key === "ArrowUp") to.r = Math.max(0, at.r - 1);
    else if (event.key === "ArrowDown") to.r = Math.min(map.rows.length - 1, at.r + 1);
    else if (event.key === "ArrowRight") to = along(map, at, by);
    else if (event.key === "ArrowLeft") to = along(map, at, -by);
    else if (event.key === "Home") to.c = 0;
    else if (event.key === "End") to.c = map.runs[at.k].cells - 1;
    else if (event.key === "w") to = worstOf(map, at.r) ?? at;
    else if (event.key === "Enter" || event.key === " ") act.pick();
    else return;
    event.preventDefault();
    event.stopPropagation();
    act.put(to);
  });
  box.addEventListener("focus", () => {
    if (!act.at() && act.map() && box.matches(":focus-visible")) act.put({ k: 0, r: 0, c: 0 });
  });
}

/** Along a row, from run to run. */
function along(map, at, by) {
  const to = { ...at, c: at.c + by };
  if (to.c < 0) {
    if (at.k === 0) return { ...at, c: 0 };
    return { ...at, k: at.k - 1, c: map.runs[at.k - 1].cells - 1 };
  }
  if (to.c < map.runs[at.k].cells) return to;
  if (at.k === map.runs.length - 1) return { ...at, c: map.runs[at.k].cells - 1 };
  return { ...at, k: at.k + 1, c: 0 };
}

function worstOf(map, r) {
  let found = null;
  let value = -1;
  map.runs.forEach((run, k) => (run.rows[map.rows[r]] ?? []).forEach((v, c) => {
    if (v !== null && v > value) {
      value = v;
      found = { k, r, c };
    }
  }));
  return found;
}

/**
 * The worst place of every row in every run, as a table whose entries go there.
 * @param {HTMLDetailsElement} details
 * @param {object} map
 * @param {(place: object) => void} onPick
 */
export function worstTable(details, map, onPick) {
  details.querySelector(".scroll")?.remove();
  const fill = () => {
    if (!details.open || details.querySelector(".scroll")) return;
    const head = h("tr", null, h("th", { scope: "col", text: "row" }), map.runs.map((run) =>
      h("th", { scope: "col", text: `${run.name} (${run.used ? "used" : "held out"})` })));
    details.append(h("div", { class: "scroll" }, h("p", { class: "muted", text: "The worst place of each row: error ÷ noise floor, when, and in which phase." }),
      h("table", null, h("thead", null, head), h("tbody", null, map.rows.map((row) =>
        h("tr", null, h("th", { scope: "row", text: row }), map.runs.map((run) => h("td", null, place(map, run, row, onPick)))))))));
  };
  details.ontoggle = fill;
  fill();
}

function place(map, run, row, onPick) {
  const line = run.rows[row];
  if (!line) return "not measured";
  let c = -1;
  line.forEach((v, k) => { if (v !== null && (c < 0 || v > line[c])) c = k; });
  if (c < 0) return "not measured";
  const start = run.t0 + c * map.cell;
  const middle = start + map.cell / 2;
  const phase = run.phases.find((p) => middle >= p.start && middle <= p.stop)?.phase ?? "";
  return h("button", { type: "button", class: "link", onclick: () => onPick({ run: run.name, row, start, stop: start + map.cell }),
    text: `${times(line[c])} at ${tick(start, 0.1)} s${phase ? `, ${phase}` : ""}` });
}
