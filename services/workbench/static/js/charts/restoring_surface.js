/** Restoring-force surfaces: what a corner's suspension does, or what the model misses of it, over travel and rate. */

import { pointer, sharpCanvas } from "./canvas.js";
import { colourBar } from "./colourbar.js";
import { resolved } from "./colours.js";
import { h } from "../widgets/dom.js";
import { short } from "../widgets/format.js";
import { tick, ticks } from "./ticks.js";
import { plainScale, signedScale } from "./colour_scales.js";

const LEFT = 58;
const RIGHT = 10;
const TOP = 6;
const FOOT = 42;

/**
 * Four surfaces with one scale of colours.
 * @param {HTMLElement} root
 * @returns {{update: (surfaces: object, what: "residual"|"force", least: number) => void, destroy: () => void}}
 */
export function surfaceMaps(root) {
  const legend = h("div", { class: "map-legend" });
  const grid = h("div", { class: "surfaces" });
  const table = h("details", { class: "map-table" }, h("summary", { text: "The same as tables" }));
  root.append(legend, grid, table);
  const bar = colourBar(legend, "force");
  const few = h("span", { text: "too few samples" });
  legend.append(h("span", { class: "muted small-note" }, h("i", { class: "phase-swatch empty" }), few),
    h("span", { class: "muted small-note", text: "× from one stretch of 2 s only: no evidence" }));
  const panels = new Map();
  let surfaces = {};
  let what = "residual";

  function scale() {
    let [low, high] = [Infinity, -Infinity];
    for (const s of Object.values(surfaces)) for (const line of s[what]) for (const v of line) if (v !== null) {
      low = Math.min(low, v);
      high = Math.max(high, v);
    }
    if (!(low <= high)) [low, high] = [-1, 1];
    return what === "residual" ? signedScale(Math.max(-low, high, 1e-9)) : plainScale(low, high > low ? high : low + 1);
  }

  /** Edges that all corners share, so that their pictures can be compared at a glance. */
  function extent() {
    const over = (edges) => {
      const all = Object.values(surfaces).flatMap((s) => [s.shown[edges][0], s.shown[edges].at(-1)]);
      return [Math.min(...all), Math.max(...all)];
    };
    return { travel: over("travel"), rate: over("rate") };
  }

  return {
    update(next, kind, least) {
      few.textContent = `fewer than ${least} samples`;
      surfaces = next;
      what = kind;
      for (const corner of Object.keys(surfaces)) if (!panels.has(corner)) panels.set(corner, panel(grid, corner));
      for (const [corner, one] of panels) one.show(surfaces[corner], what, scale, extent());
      const own = scale();
      const found = ticks(own.low, own.high, 4);
      const unit = Object.values(surfaces)[0]?.shown.unit ?? "";
      const label = what === "residual" ? `mean error of the suspension row [${unit}]` : `mean force of the suspension [${unit}], resisting compression`;
      bar.update(scale, found.values.map((v) => [(v - own.low) / (own.high - own.low), tick(v, found.step)]), label);
      tables(table, surfaces, what);
    },
    destroy() {
      bar.destroy();
      for (const one of panels.values()) one.destroy();
    },
  };
}

function panel(root, corner) {
  const title = h("figcaption", { class: "chart-head" });
  const box = h("div", { class: "surface-box", role: "img" });
  const read = h("output", { class: "plot-read" });
  root.append(h("figure", { class: "surface" }, title, box, read));
  let one = null;
  let what = "residual";
  let scale = null;
  let range = null;
  const sheet = sharpCanvas(box, 230, paint);
  const hint = "travel: compression positive";
  read.textContent = hint;

  function frame() {
    const { travel, rate } = range;
    const [right, bottom] = [sheet.width() - RIGHT, 230 - FOOT];
    return {
      right, bottom,
      x: line(...travel, LEFT, right),
      y: line(...rate, bottom, TOP),
    };
  }

  function paint(ctx) {
    if (!one) return;
    const { shown } = one;
    const { x, y, right, bottom } = frame();
    const colours = scale();
    ctx.fillStyle = resolved("--map-empty");
    ctx.fillRect(LEFT, TOP, right - LEFT, bottom - TOP);
    one[what].forEach((cells, j) => cells.forEach((value, i) => {
      if (value === null) return;
      const [x0, x1, y0, y1] = [x.to(shown.travel[i]), x.to(shown.travel[i + 1]), y.to(shown.rate[j + 1]), y.to(shown.rate[j])];
      ctx.fillStyle = colours.colour(value);
      ctx.fillRect(x0, y0, x1 - x0 + 0.4, y1 - y0 + 0.4);
      if (one.blocks[j][i] >= 2) return;
      ctx.fillStyle = colours.ink(value);
      ctx.textAlign = "center";
      ctx.textBaseline = "middle";
      ctx.fillText("×", (x0 + x1) / 2, (y0 + y1) / 2);
    }));
    axes(ctx, x, y, right, bottom, { ...range, travel_unit: shown.travel_unit, rate_unit: shown.rate_unit });
  }

  pointer(sheet.canvas, {
    move(px, py) {
      if (!one) return;
      const { shown } = one;
      const { x, y } = frame();
      const [i, j] = [cell(shown.travel, x.from(px)), cell(shown.rate, y.from(py))];
      const value = one[what][j]?.[i];
      if (i < 0 || j < 0 || value === undefined) {
        read.textContent = hint;
        return;
      }
      read.textContent = `${short(middle(shown.travel, i))} ${shown.travel_unit}, ${short(middle(shown.rate, j))} ${shown.rate_unit}: ${
        value === null ? "too few samples" : `${short(value)} ${shown.unit}`}, ${one.count[j][i]} samples from ${one.blocks[j][i]} stretches`;
    },
    leave: () => { read.textContent = hint; },
  });

  return {
    show(next, kind, make, edges) {
      one = next ?? null;
      range = edges;
      what = kind;
      scale = make;
      const shown = one?.shown;
      const about = one?.scatter ? `scatter about the surface ${short(one.scatter)} ${shown.unit}` : "";
      title.replaceChildren(h("span", { class: "chart-title", text: shown?.label ?? corner }), h("span", { class: "muted", text: about }));
      box.setAttribute("aria-label", shown
        ? `${shown.label}: ${kind === "residual" ? "mean error" : "mean force"} [${shown.unit}] over travel [${shown.travel_unit}] and rate [${shown.rate_unit}]; ${about}`
        : corner);
      sheet.draw();
    },
    destroy: () => sheet.destroy(),
  };
}

function axes(ctx, x, y, right, bottom, { travel, rate, travel_unit: travelUnit, rate_unit: rateUnit }) {
  ctx.fillStyle = ctx.strokeStyle = resolved("--chart-ink");
  ctx.textAlign = "center";
  ctx.textBaseline = "top";
  const across = ticks(...travel, Math.max(2, Math.floor((right - LEFT) / 60)));
  for (const v of across.values) {
    mark(ctx, x.to(v), bottom, 0, 4);
    ctx.fillText(tick(v, across.step), x.to(v), bottom + 6);
  }
  ctx.fillText(`travel [${travelUnit}]`, (LEFT + right) / 2, bottom + 23);
  ctx.textAlign = "right";
  ctx.textBaseline = "middle";
  const up = ticks(...rate, 6);
  for (const v of up.values) {
    mark(ctx, LEFT, y.to(v), -4, 0);
    ctx.fillText(tick(v, up.step), LEFT - 6, y.to(v));
  }
  ctx.save();
  ctx.translate(9, (TOP + bottom) / 2);
  ctx.rotate(-Math.PI / 2);
  ctx.textAlign = "center";
  ctx.fillText(`rate [${rateUnit}]`, 0, 0);
  ctx.restore();
}

function mark(ctx, x, y, dx, dy) {
  ctx.beginPath();
  ctx.moveTo(Math.round(x) + 0.5, Math.round(y) + 0.5);
  ctx.lineTo(Math.round(x) + 0.5 + dx, Math.round(y) + 0.5 + dy);
  ctx.stroke();
}

function line(from, to, start, stop) {
  const slope = (stop - start) / (to - from);
  return { to: (v) => start + (v - from) * slope, from: (px) => from + (px - start) / slope };
}

function middle(edges, k) {
  return (edges[k] + edges[k + 1]) / 2;
}

function cell(edges, value) {
  if (value < edges[0] || value > edges[edges.length - 1]) return -1;
  return Math.min(edges.length - 2, edges.findIndex((e, k) => value <= edges[k + 1]));
}

function tables(details, surfaces, what) {
  details.querySelector(".scroll")?.remove();
  const fill = () => {
    if (!details.open || details.querySelector(".scroll")) return;
    details.append(h("div", { class: "scroll" }, Object.values(surfaces).map((s) => [
      h("h3", { text: `${s.shown.label}: ${what === "residual" ? "mean error" : "mean force"} [${s.shown.unit}]` }),
      h("table", { class: "small-table" }, h("thead", null, h("tr", null, h("th", { scope: "col", text: `rate [${s.shown.rate_unit}] \\ travel [${s.shown.travel_unit}]` }),
        s.shown.travel.slice(0, -1).map((_, i) => h("th", { scope: "col", class: "num", text: short(middle(s.shown.travel, i)) })))),
      h("tbody", null, s[what].map((cells, j) => h("tr", null, h("th", { scope: "row", class: "num", text: short(middle(s.shown.rate, j)) }),
        cells.map((v) => h("td", { class: "num", text: v === null ? "" : short(v) })))))),
    ])));
  };
  details.ontoggle = fill;
  fill();
}
