// Small pictures of one quantity over another: lines, bands, marks, with axes and units.

import { pointer, sharpCanvas } from "./canvas.js";
import { faded, resolved } from "./colours.js";
import { h } from "../widgets/dom.js";
import { short } from "../widgets/format.js";
import { tick, ticks } from "./ticks.js";

const LEFT = 62;
const RIGHT = 12;
const TOP = 8;
const BOTTOM = 40;

/**
 * Draws y over x.
 * @param {HTMLElement} root
 * @param {object} options
 * @param {string} options.title
 * @param {{label: string, unit: string, range?: [number, number]}} options.x
 * @param {{label: string, unit: string, range?: [number, number], log?: boolean}} options.y
 * @param {Array<object>} options.items `{kind: "line"|"band"|"level", name, colour, x, y | low, high | value, dash?, marks?}`
 * @param {boolean} [options.closed] the lines are outlines: there is no y of an x to be read
 * @param {number} [options.height] [px] @param {string} [options.testid]
 * @returns {{update: (options: object) => void, destroy: () => void}}
 */
export function xyPlot(root, options) {
  let o = { height: 240, ...options };
  let hover = null;
  const title = h("span", { class: "chart-title" });
  const keys = h("span", { class: "plot-keys" });
  const read = h("output", { class: "plot-read" });
  const box = h("div", { class: "plot-box", role: "img" });
  const figure = h("figure", { class: "plot", "data-testid": o.testid ?? null },
    h("figcaption", { class: "chart-head" }, title, keys), box, read);
  root.append(figure);
  const sheet = sharpCanvas(box, o.height, paint);
  pointer(sheet.canvas, { move, leave: () => point(null) });

  function dress() {
    title.textContent = o.title;
    keys.replaceChildren(...o.items.filter((i) => i.name).map(key));
    box.setAttribute("aria-label", `${o.title ? `${o.title}: ` : ""}${named(o.y)} over ${named(o.x)}`);
    point(null);
    sheet.draw();
  }

  function paint(ctx, width, height) {
    const frame = { left: LEFT, right: width - RIGHT, top: TOP, bottom: height - BOTTOM };
    const sx = scale(o.x.range ?? extent(o.items, "x"), frame.left, frame.right, false, 0);
    const sy = scale(o.y.range ?? extent(o.items, "y", o.y.log), frame.bottom, frame.top, o.y.log, o.y.range ? 0 : 0.06);
    axes(ctx, frame, sx, sy, o);
    ctx.save();
    ctx.beginPath();
    ctx.rect(frame.left, frame.top, frame.right - frame.left, frame.bottom - frame.top);
    ctx.clip();
    for (const item of o.items) draw(ctx, item, sx, sy, frame);
    if (hover !== null) mark(ctx, hover, o.items, sx, sy, frame);
    ctx.restore();
    sheet.sx = sx;
  }

  function move(px) {
    const line = o.items.find((i) => i.kind === "line");
    if (!line || !sheet.sx || o.closed) return;
    let best = 0;
    for (let k = 1; k < line.x.length; k += 1) {
      if (Math.abs(sheet.sx.to(line.x[k]) - px) < Math.abs(sheet.sx.to(line.x[best]) - px)) best = k;
    }
    point(best);
  }

  function point(k) {
    const moved = hover !== k;
    hover = k;
    const line = o.items.find((i) => i.kind === "line");
    if (k === null || !line) read.textContent = o.hint ?? " ";
    else read.textContent = says(k, line);
    if (moved) sheet.draw();
  }

  function says(k, line) {
    const parts = o.items.filter((i) => i.name && (i.kind === "line" || (i.kind === "band" && i.low.length === line.x.length)))
      .map((i) => (i.kind === "line" ? `${i.name} ${short(i.y[k])}` : `${i.name} ${short(i.low[k])} to ${short(i.high[k])}`));
    const count = o.counts ? `, ${o.counts[k]} samples` : "";
    return `at ${short(line.x[k])} ${o.x.unit}: ${parts.join(", ")}${o.y.unit ? ` ${o.y.unit}` : ""}${count}`;
  }

  dress();
  return {
    update(patch) {
      o = { ...o, ...patch };
      dress();
    },
    destroy() {
      sheet.destroy();
      figure.remove();
    },
  };
}

/** A quantity with its unit; a number without one has none. */
function named({ label, unit }) {
  return unit ? `${label} [${unit}]` : label;
}

function key(item) {
  const swatch = h("i", { class: `chart-swatch${item.kind === "band" ? " area faint" : ""}` });
  swatch.style.setProperty("--own", item.colour.startsWith("--") ? `var(${item.colour})` : item.colour);
  return h("span", { class: "chart-key" }, swatch, item.name);
}

function extent(items, axis, log = false) {
  let [low, high] = [Infinity, -Infinity];
  const take = (values) => {
    for (const v of values) {
      if (v === null || !Number.isFinite(v) || (log && v <= 0)) continue;
      low = Math.min(low, v);
      high = Math.max(high, v);
    }
  };
  for (const item of items) {
    if (item.kind === "level") take(axis === "y" ? [item.value] : []);
    else if (axis === "x") take(item.x);
    else if (item.kind === "line") take(item.y);
    else {
      take(item.low);
      take(item.high);
    }
  }
  if (!(low <= high)) return log ? [0.1, 1] : [0, 1];
  return low < high ? [low, high] : [low - 1, high + 1];
}

function scale([a, b], from, to, log, room) {
  const f = log ? Math.log10 : (v) => v;
  let [low, high] = [f(a), f(b)];
  [low, high] = [low - room * (high - low), high + room * (high - low)];
  const slope = (to - from) / (high - low);
  return { low, high, log, to: (v) => from + (f(log ? Math.max(v, 1e-300) : v) - low) * slope };
}

function axes(ctx, frame, sx, sy, o) {
  ctx.strokeStyle = resolved("--chart-grid");
  ctx.fillStyle = resolved("--chart-ink");
  ctx.lineWidth = 1;
  ctx.textAlign = "center";
  ctx.textBaseline = "top";
  const across = ticks(sx.low, sx.high, Math.max(2, Math.floor((frame.right - frame.left) / 70)));
  for (const v of across.values) {
    const x = Math.round(sx.to(v)) + 0.5;
    stroke(ctx, x, frame.top, x, frame.bottom);
    ctx.fillText(tick(v, across.step), x, frame.bottom + 5);
  }
  const middle = (frame.left + frame.right) / 2;
  ctx.fillText(named(o.x), middle, frame.bottom + 22, 2 * (frame.right + RIGHT - middle)); // narrower where it is long
  ctx.textAlign = "right";
  ctx.textBaseline = "middle";
  for (const [v, text] of upward(sy, frame)) {
    const y = Math.round(sy.to(v)) + 0.5;
    stroke(ctx, frame.left, y, frame.right, y);
    ctx.fillText(text, frame.left - 5, y);
  }
  ctx.save();
  const centre = (frame.top + frame.bottom) / 2;
  ctx.translate(10, centre);
  ctx.rotate(-Math.PI / 2);
  ctx.textAlign = "center";
  ctx.fillText(named(o.y), 0, 0, 2 * centre);
  ctx.restore();
}

function upward(sy, frame) {
  if (!sy.log) {
    const found = ticks(sy.low, sy.high, Math.floor((frame.bottom - frame.top) / 32));
    return found.values.map((v) => [v, tick(v, found.step)]);
  }
  const step = Math.max(1, Math.ceil((sy.high - sy.low) / 6));
  const out = [];
  for (let k = Math.ceil(sy.low); k <= sy.high; k += step) out.push([10 ** k, power(k)]);
  return out.length > 1 ? out : withinDecade(sy.low, sy.high);
}

/** Round values on a logarithmic axis that has fewer than two powers of ten. */
function withinDecade(low, high) {
  const found = [];
  for (let k = Math.floor(low); k <= high; k += 1) {
    for (const lead of [1, 2, 5]) {
      const place = k + Math.log10(lead);
      if (place >= low && place <= high) found.push([10 ** place, short(10 ** place, 1)]);
    }
  }
  if (found.length > 2) return found;
  const { values, step } = ticks(10 ** low, 10 ** high, 4);
  return values.map((v) => [v, tick(v, step)]);
}

function power(k) {
  if (k >= -2 && k <= 4) return String(10 ** Math.max(0, k) / 10 ** Math.max(0, -k));
  return `10${[...String(k)].map((c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]).join("")}`;
}

function stroke(ctx, x0, y0, x1, y1) {
  ctx.beginPath();
  ctx.moveTo(x0, y0);
  ctx.lineTo(x1, y1);
  ctx.stroke();
}

function draw(ctx, item, sx, sy, frame) {
  ctx.setLineDash(item.dash ?? []);
  ctx.lineWidth = item.width ?? 1.6;
  ctx.strokeStyle = resolved(item.colour);
  if (item.kind === "level") stroke(ctx, frame.left, sy.to(item.value), frame.right, sy.to(item.value));
  else if (item.kind === "band") band(ctx, item, sx, sy);
  else line(ctx, item, sx, sy);
  ctx.setLineDash([]);
}

function line(ctx, item, sx, sy) {
  ctx.beginPath();
  let on = false;
  for (let k = 0; k < item.x.length; k += 1) {
    if (!known(item.y[k])) {
      on = false;
      continue;
    }
    const [x, y] = [sx.to(item.x[k]), sy.to(item.y[k])];
    if (on) ctx.lineTo(x, y);
    else ctx.moveTo(x, y);
    on = true;
  }
  ctx.stroke();
  if (!item.marks) return;
  ctx.fillStyle = resolved(item.colour);
  for (let k = 0; k < item.x.length; k += 1) if (known(item.y[k])) dot(ctx, sx.to(item.x[k]), sy.to(item.y[k]), 2.5);
}

function band(ctx, item, sx, sy) {
  ctx.fillStyle = faded(item.colour, 0.28);
  let start = 0;
  for (let k = 0; k <= item.x.length; k += 1) {
    if (k < item.x.length && known(item.low[k]) && known(item.high[k])) continue;
    if (k - start > 1) {
      ctx.beginPath();
      for (let i = start; i < k; i += 1) ctx.lineTo(sx.to(item.x[i]), sy.to(item.high[i]));
      for (let i = k - 1; i >= start; i -= 1) ctx.lineTo(sx.to(item.x[i]), sy.to(item.low[i]));
      ctx.fill();
    }
    start = k + 1;
  }
}

function mark(ctx, k, items, sx, sy, frame) {
  const lines = items.filter((i) => i.kind === "line" && known(i.y[k]));
  if (!lines.length) return;
  ctx.strokeStyle = resolved("--chart-ink");
  ctx.lineWidth = 1;
  ctx.setLineDash([3, 3]);
  const x = sx.to(lines[0].x[k]);
  stroke(ctx, x, frame.top, x, frame.bottom);
  ctx.setLineDash([]);
  for (const item of lines) {
    ctx.fillStyle = resolved(item.colour);
    dot(ctx, sx.to(item.x[k]), sy.to(item.y[k]), 4);
  }
}

function dot(ctx, x, y, r) {
  ctx.beginPath();
  ctx.arc(x, y, r, 0, 2 * Math.PI);
  ctx.fill();
}

function known(value) {
  return value !== null && value !== undefined && Number.isFinite(value);
}
