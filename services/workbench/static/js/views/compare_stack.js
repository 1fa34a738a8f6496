/** The charts of one row: measured and modelled, residual over its floor, the share of each effect. */

import { stacked } from "../charts/area.js";
import { timeChart } from "../charts/time_chart.js";
import { onto } from "./compare_overlays.js";
import { h } from "../widgets/dom.js";

const MOST_LAYERS = 8;
const NOTHING = new Float32Array(0);

/**
 * Charts of a row, with their heights reserved before there is anything to draw.
 * @param {HTMLElement} root
 * @param {{sync: string, row: string, onZoom: Function, onClose?: () => void, tall?: boolean}} options
 * @returns {{element: HTMLElement, show: (found: {meta: object, arrays: object}, over?: object[]) => void,
 *   parts: (options: {shares: boolean, centred: boolean}) => void, setWindow: Function, figures: () => object[],
 *   destroy: () => void}} `over` : overlays `{found, name, colour, otherRun}`
 */
export function rowStack(root, { sync, row, onZoom, onClose, tall = true }) {
  const element = h("section", { class: "panel stack", "aria-label": `charts of ${row}`, data: { row } });
  if (onClose) {
    element.append(h("button", { type: "button", class: "small quiet stack-close", onclick: onClose,
      "aria-label": `Close the charts of ${row}`, text: "Close" }));
  }
  root.append(element);
  const base = { t: NOTHING, sync, onZoom };
  const first = timeChart(element, { ...base, title: row, height: tall ? 150 : 120, axis: false, testid: "chart-measured",
    series: lines(NOTHING, NOTHING) });
  const second = timeChart(element, { ...base, title: "Residual", height: tall ? 112 : 100, testid: "chart-residual",
    series: rest(NOTHING, null) });
  const box = h("div", { class: "stack-shares" });
  element.append(box);
  let third = null;
  let found = null;
  let how = { shares: true, centred: true };

  function shares() {
    third?.destroy();
    third = null;
    box.hidden = !how.shares;
    if (!how.shares) return;
    const own = found ? layers(found, how.centred) : { series: [], restack: null };
    third = timeChart(box, { ...base, t: found?.arrays.t ?? NOTHING, unit: found?.meta.unit ?? "", height: tall ? 180 : 150,
      title: how.centred ? "Share of each effect, about its mean" : "Share of each effect", series: own.series,
      onToggle: own.restack, testid: "chart-shares", keyTestid: "effect-layer" });
  }

  shares();
  return {
    element,
    show(next, over = []) {
      const same = found === next;
      found = next;
      const { meta, arrays } = found;
      const { t, measured, modelled } = arrays;
      const drawn = over.map((one) => overlaid(t, one));
      first.update({ t, unit: meta.unit, series: [...lines(measured, modelled), ...drawn.flatMap((one) => one.lines)] });
      second.update({ t, unit: meta.unit,
        series: [...rest(measured.map((v, i) => v - modelled[i]), meta.floor), ...drawn.map((one) => one.residual)] });
      if (!same) shares();
    },
    parts(next) {
      if (next.shares === how.shares && next.centred === how.centred) return;
      how = next;
      shares();
    },
    figures: () => [{ ...first.figure(), title: row }, { ...second.figure(), title: `${row}, residual` },
      ...(third ? [{ ...third.figure(), title: `${row}, shares` }] : [])],
    setWindow: (t0, t1) => first.setWindow(t0, t1),
    destroy() {
      for (const chart of [first, second, third]) chart?.destroy();
      element.remove();
    },
  };
}

function lines(measured, modelled) {
  return [
    { name: "measured", values: measured, colour: "--measured", width: 1.4 },
    { name: "modelled", values: modelled, colour: "--modelled", width: 1.4 },
  ];
}

/** Curves of an overlay on the time of the row: modelled, residual, and of another run what was measured there. */
function overlaid(t, { found: { arrays }, name, colour, otherRun }) {
  const on = (values) => onto(t, arrays.t, values, otherRun);
  const residual = arrays.measured.map((v, i) => v - arrays.modelled[i]);
  const measured = otherRun ? [{ name: `measured, ${name}`, values: on(arrays.measured), colour, width: 1, dash: [2, 3] }] : [];
  return {
    lines: [...measured, { name: `modelled, ${name}`, values: on(arrays.modelled), colour, width: 1.4, dash: [7, 4] }],
    residual: { name, values: on(residual), colour, width: 1 },
  };
}

function rest(residual, floor) {
  const band = floor ? { low: -2 * floor, high: 2 * floor, name: "noise floor, ± 2 RMS", colour: "--floor" } : undefined;
  return [{ name: "measured − modelled", values: residual, colour: "--residual", band }];
}

/** Stacked layers, the largest share first, and the line they add up to. */
function layers({ arrays, meta }, centred) {
  const own = Object.keys(arrays).filter((name) => name.startsWith("effect:") || name === "zeros")
    .map((name) => ({ key: name.replace(/^effect:/, ""), values: arrays[name] }));
  for (const one of own) {
    one.mean = mean(one.values);
    one.size = Math.sqrt(mean(one.values.map((v) => (v - (centred ? one.mean : 0)) ** 2)));
  }
  own.sort((a, b) => b.size - a.size);
  const shown = own.filter((one) => one.size > 0);
  const few = shown.length > MOST_LAYERS ? shown.slice(0, MOST_LAYERS - 1) : shown;
  const rest = shown.slice(few.length);
  const series = few.map((one) => ({ name: one.key === "zeros" ? "sensor zeros" : meta.labels[one.key], key: one.key,
    values: centred ? one.values.map((v) => v - one.mean) : one.values }));
  if (rest.length) {
    const sum = new Float32Array(arrays.t.length);
    for (const one of rest) for (let i = 0; i < sum.length; i += 1) sum[i] += one.values[i] - (centred ? one.mean : 0);
    series.push({ name: `${rest.length} smaller`, key: "smaller", values: sum });
  }
  paint(series, meta.colours);
  const total = mean(arrays.modelled);
  const line = { name: "modelled: the sum", colour: "--ink", width: 1.4,
    values: centred ? arrays.modelled.map((v) => v - total) : arrays.modelled };
  const restack = () => {
    const on = series.filter((s) => !s.hidden);
    stacked(on.map((s) => s.values)).forEach((layer, k) => { on[k].layer = layer; });
    for (const s of series) s.layer ??= { low: s.values, high: s.values };
  };
  restack();
  return { series: [...series, line], restack };
}

/**
 * Each family of effects has its colour by the server, the same in every version and after a reload, as far as no two
 * layers of a row are alike.
 */
function paint(series, places) {
  const taken = new Set();
  // in the order of the places: what was added later gives way, whatever its size here
  for (const s of [...series].sort((a, b) => (places[a.key] ?? 0) - (places[b.key] ?? 0))) {
    if (s.key === "zeros" || s.key === "smaller") {
      s.colour = "--floor";
      continue;
    }
    let k = places[s.key] % 8;
    for (let tries = 0; taken.has(k) && tries < 8; tries += 1) k = (k + 1) % 8;
    taken.add(k);
    s.colour = `--effect-${k}`;
  }
}

function mean(values) {
  let sum = 0;
  for (let i = 0; i < values.length; i += 1) sum += values[i];
  return values.length ? sum / values.length : 0;
}
