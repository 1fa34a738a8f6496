// Lines of a chart: through their samples, or column by column of pixels where samples are denser than these.

import { line } from "./area.js";

const MOST_SHEETS = 8; // sizes of plots on a page, and some that they had before the window was resized
const inks = new Map(); // CSS colour → pixel
let pixels = new Uint32Array(0);
const sheets = new Map(); // canvases through which pixels reach charts, by size

/**
 * Draws lines whose samples are denser than the pixels: from the lowest to the highest of every column, each column
 * joined to the one before. The pixels of all lines are written into one picture, which takes a fifth of the time of a
 * rectangle for each column, and a hundredth of that of strokes.
 * @param {object} u uPlot
 * @param {ArrayLike<number>} x of the columns, two each
 * @param {Array<{extremes: ArrayLike<number|null>, colour: string, thick: number}>} lines two extremes for each column;
 *   `thick` the least height [device pixels]
 */
export function drawColumns(u, x, lines) {
  const { ctx, bbox } = u;
  const [wide, tall] = [Math.round(bbox.width), Math.round(bbox.height)];
  if (!lines.length || wide < 1 || tall < 1) return;
  if (pixels.length < wide * tall) pixels = new Uint32Array(wide * tall);
  pixels.fill(0, 0, wide * tall);
  const across = line(u.scales.x.min, u.scales.x.max, 0, bbox.width);
  const up = line(u.scales.y.min, u.scales.y.max, bbox.height, 0);
  const left = columnPlaces(x, across, wide);
  for (const one of lines) columns(one, left, up, wide, tall);
  const sheet = sheetOf(wide, tall);
  sheet.putImageData(new ImageData(new Uint8ClampedArray(pixels.buffer, 0, 4 * wide * tall), wide, tall), 0, 0);
  ctx.drawImage(sheet.canvas, Math.round(bbox.left), Math.round(bbox.top));
}

function sheetOf(wide, tall) {
  const size = `${wide} ${tall}`;
  if (!sheets.has(size)) {
    if (sheets.size >= MOST_SHEETS) sheets.delete(sheets.keys().next().value);
    sheets.set(size, new OffscreenCanvas(wide, tall).getContext("2d"));
  }
  return sheets.get(size);
}

/** First pixel of each column, and the end of the last. */
function columnPlaces(x, across, wide) {
  const n = x.length / 2;
  const left = new Int32Array(n + 1);
  for (let c = 0; c < n; c += 1) left[c] = Math.max(0, Math.min(wide, Math.round(across(x[2 * c]))));
  left[n] = Math.max(0, Math.min(wide, Math.round(across(x[2 * n - 1]))));
  return left;
}

function columns({ extremes, colour, thick }, left, up, wide, tall) {
  const ink = pixelOf(colour);
  const least = Math.max(1, Math.round(thick));
  const n = extremes.length / 2;
  let [before, under] = [NaN, NaN];
  for (let c = 0; c < n; c += 1) {
    const [a, z] = [extremes[2 * c], extremes[2 * c + 1]];
    if (a === null || Number.isNaN(a)) {
      [before, under] = [NaN, NaN];
      continue;
    }
    let top = up(a > z ? a : z);
    let bottom = up(a > z ? z : a);
    const [ownTop, ownBottom] = [top, bottom];
    if (bottom < before) bottom = before;
    else if (top > under) top = under;
    [before, under] = [ownTop, ownBottom];
    const more = Math.max(0, least - (bottom - top)) / 2;
    const from = Math.max(0, Math.round(top - more));
    const to = Math.min(tall, Math.max(from + least, Math.round(bottom + more)));
    const end = Math.min(wide, Math.max(left[c] + 1, left[c + 1]));
    for (let px = left[c]; px < end; px += 1) {
      for (let place = from * wide + px; place < to * wide; place += wide) pixels[place] = ink;
    }
  }
}

/** A colour as it stands in a picture's memory. */
function pixelOf(colour) {
  if (!inks.has(colour)) {
    const ctx = new OffscreenCanvas(1, 1).getContext("2d");
    ctx.fillStyle = colour;
    ctx.fillRect(0, 0, 1, 1);
    inks.set(colour, new Uint32Array(ctx.getImageData(0, 0, 1, 1).data.buffer)[0]);
  }
  return inks.get(colour);
}

/**
 * Draws a line through its samples, broken at holes. Its corners are cut: at this width nobody sees it, and rounding
 * them, which uPlot does, takes most of the time.
 * @param {object} u uPlot
 * @param {ArrayLike<number>} t
 * @param {ArrayLike<number|null>} values
 * @param {{colour: string, width: number, dash?: number[]}} style [device pixels]
 */
export function drawLine(u, t, values, { colour, width, dash = [] }) {
  const { ctx, bbox } = u;
  const x = line(u.scales.x.min, u.scales.x.max, bbox.left, bbox.left + bbox.width);
  const y = line(u.scales.y.min, u.scales.y.max, bbox.top + bbox.height, bbox.top);
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  ctx.lineJoin = "bevel";
  ctx.lineWidth = width;
  ctx.strokeStyle = colour;
  ctx.setLineDash(dash);
  ctx.beginPath();
  let on = false;
  for (let i = 0; i < t.length; i += 1) {
    if (values[i] === null) {
      on = false;
      continue;
    }
    if (on) ctx.lineTo(x(t[i]), y(values[i]));
    else ctx.moveTo(x(t[i]), y(values[i]));
    on = true;
  }
  ctx.stroke();
  ctx.restore();
}
