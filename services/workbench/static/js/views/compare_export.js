/** What Compare shows as a file: a picture (PNG, SVG) or its numbers (CSV), in the window shown. */

import { faded, resolved } from "../charts/colours.js";
import { first } from "../charts/pyramid.js";
import { tick, ticks } from "../charts/ticks.js";

const WIDE = 1200; // of the SVG [px]
const LEFT = 70;
const HEAD = 22;

/**
 * The curves in columns: each time base with its curves, a value where there is a sample.
 * @param {object[]} figures of charts @param {object|null} xy
 * @returns {string}
 */
export function csv(figures, xy) {
  const groups = new Map();
  for (const f of figures) {
    if (f.rough) continue;
    const own = groups.get(f.t) ?? [];
    own.push(...f.series.map((s) => [`${f.title}: ${s.name}${f.unit ? ` [${f.unit}]` : ""}`, s.values]));
    groups.set(f.t, own);
  }
  const columns = [];
  for (const [t, own] of groups) {
    const [t0, t1] = figures[0].window;
    const [from, to] = [first(t, t0 - 1e-6), first(t, t1 + 1e-4)];
    columns.push(["t [s]", t.slice(from, to)], ...own.map(([name, values]) => [name, values.slice(from, to)]));
  }
  if (xy) columns.push(["t [s]", xy.t], [label(xy, 0), xy.x], [label(xy, 1), xy.y]);
  const longest = Math.max(0, ...columns.map(([, values]) => values.length));
  const lines = [columns.map(([name]) => quoted(name)).join(",")];
  for (let i = 0; i < longest; i += 1) {
    lines.push(columns.map(([, values]) => (i < values.length && Number.isFinite(values[i]) ? String(Number(values[i].toPrecision(7))) : "")).join(","));
  }
  return `${lines.join("\n")}\n`;
}

const label = (xy, k) => `${xy.labels[k]}${xy.units[k] ? ` [${xy.units[k]}]` : ""}`;
const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);

/**
 * All charts below each other, with their heads, as PNG.
 * @param {string} title @param {object[]} figures @param {object|null} xy
 * @returns {Promise<Blob>}
 */
export function png(title, figures, xy) {
  const ratio = devicePixelRatio || 1;
  const shown = [...figures, ...(xy ? [{ title: xy.title, unit: "", series: [], canvas: xy.canvas }] : [])].filter((f) => f.canvas);
  const wide = Math.max(...shown.map((f) => f.canvas.width), 600);
  const head = HEAD * ratio;
  const canvas = document.createElement("canvas");
  canvas.width = wide;
  canvas.height = head * 1.4 + shown.reduce((sum, f) => sum + f.canvas.height + head, 0);
  const ctx = canvas.getContext("2d");
  ctx.fillStyle = resolved("--panel");
  ctx.fillRect(0, 0, canvas.width, canvas.height);
  const write = (text, x, y, bold) => {
    ctx.font = `${bold ? "bold " : ""}${12 * ratio}px system-ui, sans-serif`;
    ctx.fillStyle = resolved("--ink");
    ctx.fillText(text, x, y);
    return x + ctx.measureText(text).width + 10 * ratio;
  };
  write(title, 6 * ratio, head, true);
  let y = head * 1.4;
  for (const f of shown) {
    let x = write(`${f.title}${f.unit ? ` [${f.unit}]` : ""}`, 6 * ratio, y + head * 0.75, true);
    for (const s of f.series) {
      ctx.fillStyle = resolved(s.colour);
      ctx.fillRect(x, y + head * 0.45, 14 * ratio, 4 * ratio);
      x = write(s.name, x + 18 * ratio, y + head * 0.75);
    }
    ctx.drawImage(f.canvas, 0, y + head);
    y += head + f.canvas.height;
  }
  return new Promise((done) => canvas.toBlob(done, "image/png"));
}

const escaped = (text) => text.replace(/[&<>"]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[c]);

/**
 * All charts below each other as SVG, colours of the present theme written out.
 * @param {string} title @param {object[]} figures @param {object|null} xy
 * @returns {string}
 */
export function svg(title, figures, xy) {
  const out = [];
  let y = 34;
  for (const f of figures) {
    out.push(...timeChartSvg(f, y));
    y += f.height + HEAD + 22;
  }
  if (xy) {
    out.push(...xySvg(xy, y));
    y += 440;
  }
  const ink = resolved("--ink");
  return `<svg xmlns="http://www.w3.org/2000/svg" width="${WIDE}" height="${y}" viewBox="0 0 ${WIDE} ${y}" font-family="system-ui, sans-serif" font-size="12" fill="${ink}">
<rect width="100%" height="100%" fill="${resolved("--panel")}"/><text x="8" y="20" font-weight="bold" font-size="14">${escaped(title)}</text>
${out.join("\n")}
</svg>\n`;
}

function timeChartSvg(f, top) {
  const [t0, t1] = f.window;
  const [low, high] = f.range ?? extent(f, t0, t1);
  const box = { left: LEFT, top: top + HEAD, wide: WIDE - LEFT - 14, tall: f.height - 28 };
  const x = (t) => box.left + ((t - t0) / (t1 - t0)) * box.wide;
  const y = (v) => box.top + ((high - v) / (high - low)) * box.tall;
  const out = [...frame(box, [t0, t1], [low, high], x, y, " s")];
  let at = 8;
  const head = (text, more = "") => {
    out.push(`<text x="${at}" y="${top + 15}" ${more}>${escaped(text)}</text>`);
    at += 7 * text.length + 14;
  };
  head(`${f.title}${f.unit ? ` [${f.unit}]` : ""}`, 'font-weight="bold"');
  for (const s of f.series) {
    const colour = resolved(s.colour);
    out.push(`<rect x="${at}" y="${top + 9}" width="14" height="4" fill="${colour}"/>`);
    at += 18;
    head(s.name);
    const [from, to] = [Math.max(0, first(f.t, t0) - 1), Math.min(f.t.length, first(f.t, t1) + 1)];
    const part = [];
    if (s.band && typeof s.band.low === "number") {
      const [a, b] = [y(Math.min(high, s.band.high)), y(Math.max(low, s.band.low))];
      out.push(`<rect x="${box.left}" y="${a.toFixed(1)}" width="${box.wide}" height="${Math.max(0, b - a).toFixed(1)}" fill="${faded(s.band.colour ?? s.colour, 0.22)}"/>`);
    }
    if (s.layer) {
      const up = points(f.t, s.layer.high, from, to, x, y);
      const down = points(f.t, s.layer.low, from, to, x, y).reverse();
      if (up.length) part.push(`<path d="M${up.join("L")}L${down.join("L")}Z" fill="${faded(s.colour, 0.85)}"/>`);
    } else {
      part.push(`<path d="${path(f.t, s.values, from, to, x, y)}" fill="none" stroke="${colour}" stroke-width="${s.width ?? 1.25}"${s.dash ? ` stroke-dasharray="${s.dash.join(" ")}"` : ""}/>`);
    }
    out.push(`<svg x="${box.left}" y="${box.top}" width="${box.wide}" height="${box.tall}" viewBox="${box.left} ${box.top} ${box.wide} ${box.tall}">${part.join("")}</svg>`);
  }
  return out;
}

function xySvg(xy, top) {
  const box = { left: LEFT, top: top + HEAD, wide: 620, tall: 360 };
  const ends = (values) => {
    const [a, b] = values.reduce(([l, u], v) => [Math.min(l, v), Math.max(u, v)], [Infinity, -Infinity]);
    return a < b ? [a, b] : [a - 1, a + 1];
  };
  const [[x0, x1], [y0, y1]] = [ends(xy.x), ends(xy.y)];
  const x = (v) => box.left + ((v - x0) / (x1 - x0)) * box.wide;
  const y = (v) => box.top + ((y1 - v) / (y1 - y0)) * box.tall;
  return [...frame(box, [x0, x1], [y0, y1], x, y, ""), `<text x="8" y="${top + 15}" font-weight="bold">${escaped(`${label(xy, 1)} over ${label(xy, 0)}`)}</text>`,
    `<path d="${path(xy.x, xy.y, 0, xy.x.length, x, y)}" fill="none" stroke="${resolved("--measured")}" stroke-width="0.9"/>`];
}

function frame(box, [x0, x1], [y0, y1], x, y, unit) {
  const grid = resolved("--chart-grid");
  const across = ticks(x0, x1, 12);
  const up = ticks(y0, y1, Math.max(2, Math.floor(box.tall / 30)));
  return [
    ...across.values.map((v) => `<path d="M${x(v).toFixed(1)} ${box.top}v${box.tall}" stroke="${grid}"/><text x="${x(v).toFixed(1)}" y="${box.top + box.tall + 14}" text-anchor="middle" font-size="11">${tick(v, across.step)}${unit}</text>`),
    ...up.values.map((v) => `<path d="M${box.left} ${y(v).toFixed(1)}h${box.wide}" stroke="${grid}"/><text x="${box.left - 5}" y="${(y(v) + 4).toFixed(1)}" text-anchor="end" font-size="11">${tick(v, up.step)}</text>`),
  ];
}

function extent(f, t0, t1) {
  let [low, high] = [Infinity, -Infinity];
  for (const s of f.series) for (let i = first(f.t, t0); i < f.t.length && f.t[i] <= t1; i += 1) {
    if (s.values[i] < low) low = s.values[i];
    if (s.values[i] > high) high = s.values[i];
  }
  return low < high ? [low, high] : [-1, 1];
}

function points(t, values, from, to, x, y) {
  const out = [];
  for (let i = from; i < to; i += 1) if (Number.isFinite(values[i])) out.push(`${x(t[i]).toFixed(1)} ${y(values[i]).toFixed(1)}`);
  return out;
}

/** A path with gaps at holes; where samples are denser than pixels, the lowest and the highest of each column. */
function path(t, values, from, to, x, y) {
  const out = [];
  let on = false;
  let column = null;
  const put = (px, v) => {
    out.push(`${on ? "L" : "M"}${px.toFixed(1)} ${y(v).toFixed(1)}`);
    on = true;
  };
  const flush = () => {
    if (!column) return;
    const { px, low, high, lowFirst } = column;
    if (low === high) put(px, low);
    else for (const v of lowFirst ? [low, high] : [high, low]) put(px, v);
    column = null;
  };
  const dense = to - from > 4 * WIDE;
  for (let i = from; i < to; i += 1) {
    const v = values[i];
    if (!Number.isFinite(v)) {
      flush();
      on = false;
      continue;
    }
    const px = x(t[i]);
    if (!dense) {
      put(px, v);
      continue;
    }
    if (column && Math.floor(px) !== Math.floor(column.px)) flush();
    if (!column) column = { px, low: v, high: v, lowFirst: true };
    else if (v < column.low) [column.low, column.lowFirst] = [v, false];
    else if (v > column.high) [column.high, column.lowFirst] = [v, true];
  }
  flush();
  return out.join("");
}

/** Gives a file to the browser. */
export function save(name, content, kind) {
  const url = URL.createObjectURL(content instanceof Blob ? content : new Blob([content], { type: kind }));
  const link = document.createElement("a");
  link.href = url;
  link.download = name;
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(url), 5000);
}
