/** Two cursors, A and B, and what every curve does between them: lowest, highest, mean, RMS, and its values at both. */

import { first } from "../charts/pyramid.js";
import { h } from "../widgets/dom.js";
import { short } from "../widgets/format.js";

/**
 * The panel.
 * @param {{set: (a: number|null, b: number|null) => void}} act
 * @returns {{element: HTMLElement, update: (a: number|null, b: number|null, figures: object[]) => void}}
 */
export function cursorPanel({ set }) {
  let now = { a: null, b: null };
  const field = (key, label) => {
    const input = h("input", { type: "number", step: "0.01", class: "cursor-time", "aria-label": `cursor ${label} in seconds`, "data-testid": `cursor-${key}`,
      onchange: () => {
        const value = Number(input.value);
        if (input.value !== "" && Number.isFinite(value)) set(...(key === "a" ? [value, now.b] : [now.a, value]));
      } });
    return input;
  };
  const [a, b] = [field("a", "A"), field("b", "B")];
  const span = h("span", { class: "muted" });
  const box = h("div", { class: "scroll" });
  const element = h("section", { class: "panel cursors", hidden: true, "data-testid": "cursors" },
    h("div", { class: "bar" }, h("label", null, "A ", a, " s"), h("label", null, "B ", b, " s"), span,
      h("span", { class: "muted end", text: "A click on a chart moves the nearer cursor." })), box);

  return {
    element,
    update(t0, t1, figures) {
      now = { a: t0, b: t1 };
      element.hidden = t0 === null || t1 === null;
      if (element.hidden) return;
      if (document.activeElement !== a) a.value = t0.toFixed(2);
      if (document.activeElement !== b) b.value = t1.toFixed(2);
      span.textContent = `B − A = ${short(t1 - t0, 4)} s`;
      const lines = figures.flatMap((f) => (f.rough ? [] : f.series.map((s) => [f, s, statistics(f.t, s.values, t0, t1)])));
      const head = ["curve", "unit", "min", "max", "mean", "RMS", "at A", "at B", "B − A"];
      box.replaceChildren(h("table", { class: "score-table" },
        h("thead", null, h("tr", null, head.map((t, k) => h("th", { scope: "col", class: k > 1 ? "num" : "", text: t })))),
        h("tbody", null, lines.map(([f, s, found]) => h("tr", { data: { curve: `${f.title}: ${s.name}` } },
          h("th", { scope: "row", text: `${f.title}: ${s.name}` }), h("td", { text: f.unit || "–" }),
          [found.min, found.max, found.mean, found.rms, found.a, found.b, found.b - found.a].map((v) =>
            h("td", { class: "num", text: Number.isFinite(v) ? short(v, 4) : "–" })))))));
    },
  };
}

/**
 * What a curve does in a window, its holes left out.
 * @param {ArrayLike<number>} t rising @param {ArrayLike<number>} values @param {number} a @param {number} b in either order
 * @returns {{n: number, min: number, max: number, mean: number, rms: number, a: number, b: number}} NaN without samples
 */
export function statistics(t, values, a, b) {
  const [low, high] = [Math.min(a, b), Math.max(a, b)];
  let [n, min, max, sum, squares] = [0, Infinity, -Infinity, 0, 0];
  for (let i = first(t, low); i < t.length && t[i] <= high; i += 1) {
    const v = values[i];
    if (v === null || v !== v) continue;
    n += 1;
    if (v < min) min = v;
    if (v > max) max = v;
    sum += v;
    squares += v * v;
  }
  const none = n ? 0 : NaN;
  return { n, min: min + none, max: max + none, mean: sum / n, rms: Math.sqrt(squares / n), a: valueAt(t, values, a), b: valueAt(t, values, b) };
}

/** The value nearest to a time; NaN outside. */
function valueAt(t, values, at) {
  if (!t.length || at < t[0] - 1e-3 || at > t[t.length - 1] + 1e-3) return NaN;
  const k = Math.min(t.length - 1, first(t, at));
  const near = k > 0 && at - t[k - 1] < t[k] - at ? k - 1 : k;
  return values[near] ?? NaN;
}
