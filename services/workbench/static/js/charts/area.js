// Areas of a chart: bands and stacked layers, between two lines.

import { first } from "./pyramid.js";

/**
 * Fills what is between two lines, column by column of pixels where samples are denser than that: the highest and the
 * lowest of a column are kept, so that no peak is lost.
 * @param {object} u uPlot
 * @param {ArrayLike<number>} t of the area's lines
 * @param {{low: number|ArrayLike<number>, high: number|ArrayLike<number>}} area
 * @param {string} colour
 */
export function drawArea(u, t, area, colour) {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  ctx.fillStyle = colour;
  if (typeof area.high === "number") {
    const top = u.valToPos(area.high, "y", true);
    ctx.fillRect(bbox.left, top, bbox.width, u.valToPos(area.low, "y", true) - top);
  } else {
    outline(u, t, area);
  }
  ctx.restore();
}

function outline(u, t, area) {
  const [from, to] = window(t, u.scales.x.min, u.scales.x.max);
  const { ctx, bbox } = u;
  const x = line(u.scales.x.min, u.scales.x.max, bbox.left, bbox.left + bbox.width);
  const y = line(u.scales.y.min, u.scales.y.max, bbox.top + bbox.height, bbox.top);
  const dense = to - from > 2 * bbox.width;
  let [xs, tops, bottoms] = [[], [], []];
  const fill = () => {
    if (xs.length > 1) {
      ctx.beginPath();
      ctx.moveTo(xs[0], tops[0]);
      for (let k = 1; k < xs.length; k += 1) ctx.lineTo(xs[k], tops[k]);
      for (let k = xs.length - 1; k >= 0; k -= 1) ctx.lineTo(xs[k], bottoms[k]);
      ctx.fill();
    }
    [xs, tops, bottoms] = [[], [], []];
  };
  // A share that changes its sign leaves the stack above zero and joins the one below: it is nothing in between.
  const cross = (i) => {
    const [before, after] = [Math.abs(area.high[i - 1] - area.low[i - 1]), Math.abs(area.high[i] - area.low[i])];
    const px = x(t[i - 1] + ((t[i] - t[i - 1]) * before) / (before + after));
    const inner = (k) => y(side(area, k) > 0 ? area.low[k] : area.high[k]);
    xs.push(px);
    tops.push(inner(i - 1));
    bottoms.push(inner(i - 1));
    fill();
    [xs, tops, bottoms] = [[px], [inner(i)], [inner(i)]];
  };
  for (let i = from; i <= to; i += 1) {
    const [low, high] = [area.low[i], area.high[i]];
    if (!(low <= high) && !(high <= low)) {
      fill();
      continue;
    }
    if (!dense && i > from && side(area, i - 1) * side(area, i) < 0) cross(i);
    const px = dense ? Math.round(x(t[i])) : x(t[i]);
    const [top, bottom] = [y(Math.max(low, high)), y(Math.min(low, high))];
    const k = xs.length - 1;
    if (dense && k >= 0 && xs[k] === px) {
      tops[k] = Math.min(tops[k], top);
      bottoms[k] = Math.max(bottoms[k], bottom);
    } else {
      xs.push(px);
      tops.push(top);
      bottoms.push(bottom);
    }
  }
  fill();
}

/** 1 above zero, −1 below, 0 across it. */
function side(area, i) {
  if (area.low[i] >= 0 && area.high[i] > 0) return 1;
  return area.high[i] <= 0 && area.low[i] < 0 ? -1 : 0;
}

/** Lowest and highest of an area in a window of time. */
export function areaRange(t, area, t0, t1) {
  if (typeof area.high === "number") return [area.low, area.high];
  const [from, to] = window(t, t0, t1);
  let [low, high] = [Infinity, -Infinity];
  for (let i = from; i <= to; i += 1) {
    if (area.low[i] < low) low = area.low[i];
    if (area.high[i] > high) high = area.high[i];
  }
  return [low, high];
}

/**
 * Stacks shares upwards where they are positive and downwards where they are negative, so that no layer hides another.
 * @param {Array<ArrayLike<number>>} shares
 * @returns {Array<{low: Float32Array, high: Float32Array}>}
 */
export function stacked(shares) {
  const n = shares[0]?.length ?? 0;
  const up = new Float32Array(n);
  const down = new Float32Array(n);
  return shares.map((share) => {
    const low = new Float32Array(n);
    const high = new Float32Array(n);
    for (let i = 0; i < n; i += 1) {
      const v = share[i];
      if (v >= 0) {
        low[i] = up[i];
        high[i] = up[i] += v;
      } else {
        high[i] = down[i];
        low[i] = down[i] += v;
      }
    }
    return { low, high };
  });
}

/** First and last index inside a window, and one more on either side. */
function window(t, t0, t1) {
  return [Math.max(0, first(t, t0) - 1), Math.min(t.length - 1, first(t, t1) + 1)];
}

/** Places [device pixels] of values between two values and two places. */
export function line(from, to, start, stop) {
  const slope = (stop - start) / (to - from);
  return (value) => start + (value - from) * slope;
}
