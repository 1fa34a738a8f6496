/** Any curve over any other, in the window shown. */

import { first } from "../charts/pyramid.js";
import { xyPlot } from "../charts/xy_plot.js";
import { h } from "../widgets/dom.js";
import { onto } from "./compare_overlays.js";

/**
 * The panel.
 * @param {{set: (pair: [string, string]|null) => void}} act
 * @returns {{element: HTMLElement, update: (pair: [string, string]|null, figures: object[]) => void, figure: () => object|null,
 *   destroy: () => void}}
 */
export function xyPanel({ set }) {
  let curves = new Map();
  let now = null;
  let drawn = null;
  const choice = (label, testid) => h("select", { "aria-label": label, "data-testid": testid, onchange: () => set([x.value, y.value]) });
  const [x, y] = [choice("across", "xy-x"), choice("upwards", "xy-y")];
  const close = h("button", { type: "button", class: "small quiet stack-close", text: "Close", "aria-label": "Close the XY plot", onclick: () => set(null) });
  const note = h("p", { class: "muted", hidden: true });
  const element = h("section", { class: "panel stack xy", hidden: true, "data-testid": "xy" }, close,
    h("div", { class: "bar" }, h("label", null, "across ", x), h("label", null, "upwards ", y)), note);
  const plot = xyPlot(element, { title: "", x: { label: "", unit: "" }, y: { label: "", unit: "" }, items: [], height: 360, testid: "xy-plot" });

  function draw() {
    const [a, b] = now.map((key) => curves.get(key));
    note.hidden = Boolean(a && b);
    drawn = null;
    if (!a || !b) {
      note.textContent = "Choose two of the curves shown; add rows, channels and formulas above.";
      plot.update({ items: [], title: "" });
      return;
    }
    const [t0, t1] = a.figure.window;
    const [from, to] = [first(a.figure.t, t0), first(a.figure.t, t1 + 1e-9)];
    const xs = a.series.values.slice(from, to);
    const ys = (a.figure.t === b.figure.t ? b.series.values : onto(a.figure.t, b.figure.t, b.series.values, false)).slice(from, to);
    const good = [...xs.keys()].filter((i) => Number.isFinite(xs[i]) && Number.isFinite(ys[i]));
    drawn = { title: `${now[1]} over ${now[0]}`, t: good.map((i) => a.figure.t[from + i]), x: good.map((i) => xs[i]), y: good.map((i) => ys[i]),
      labels: now, units: [a.figure.unit, b.figure.unit] };
    plot.update({ title: "", x: { label: now[0], unit: a.figure.unit }, y: { label: now[1], unit: b.figure.unit },
      items: [{ kind: "line", name: now[1], colour: "--measured", width: 0.9, x: drawn.x, y: drawn.y }],
      hint: `${good.length} samples, ${t0.toFixed(2)} to ${t1.toFixed(2)} s` });
  }

  return {
    element,
    update(pair, figures) {
      element.hidden = !pair;
      if (!pair) {
        drawn = null;
        return;
      }
      curves = new Map(figures.filter((f) => !f.rough).flatMap((figure) => figure.series.map((series) => [`${figure.title}: ${series.name}`, { figure, series }])));
      const options = () => [...curves.keys()].map((key) => h("option", { value: key, text: key }));
      x.replaceChildren(...options());
      y.replaceChildren(...options());
      now = pair.map((key, k) => (curves.has(key) ? key : ([...curves.keys()][k] ?? "")));
      [x.value, y.value] = now;
      draw();
    },
    figure: () => (drawn ? { ...drawn, canvas: element.querySelector("canvas") } : null),
    destroy: () => plot.destroy(),
  };
}
