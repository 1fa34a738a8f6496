/**
 * Lowest and highest of blocks of samples, at several sizes of block: what makes zooming as fast as the picture is wide,
 * however long the run.
 */

const BASE = 8; // samples of the smallest block

/** Extremes of one series. NaN and null are holes. */
export class Pyramid {
  /** @param {ArrayLike<number>} values */
  constructor(values) {
    this.values = values;
    this.levels = [];
    this.holes = false;
  }

  /** Made when it is first needed: short series never need it. */
  build() {
    if (this.levels.length) return;
    const { values } = this;
    const n = Math.ceil(values.length / BASE);
    const low = new Float32Array(n);
    const high = new Float32Array(n);
    for (let b = 0, i = 0; b < n; b += 1) {
      let [a, z] = [Infinity, -Infinity];
      for (const end = Math.min(values.length, i + BASE); i < end; i += 1) {
        const v = values[i];
        if (v === null) continue;
        if (v < a) a = v;
        if (v > z) z = v;
      }
      low[b] = a;
      high[b] = z;
      if (a > z) this.holes = true;
    }
    this.levels.push({ low, high });
    while (this.levels[this.levels.length - 1].low.length > 64) this.levels.push(halved(this.levels[this.levels.length - 1]));
  }

  /**
   * Lowest and highest of each of so many columns of samples, one after the other; null where there is none.
   * @param {number} from first sample @param {number} count samples @param {number} columns
   * @returns {ArrayLike<number|null>} two for each column
   */
  columns(from, count, columns) {
    const each = count / columns;
    if (each < 2 * BASE) return this.few(from, each, columns);
    this.build();
    const level = Math.max(0, Math.min(this.levels.length - 1, Math.floor(Math.log2(each / BASE))));
    const { low, high } = this.levels[level];
    const block = BASE * 2 ** level;
    const out = this.holes ? new Array(2 * columns) : this.room(2 * columns);
    const last = low.length - 1;
    for (let c = 0; c < columns; c += 1) {
      let b = Math.floor((from + c * each) / block);
      const end = Math.min(last, Math.floor((from + (c + 1) * each - 1e-6) / block));
      let [a, z] = [low[b], high[b]];
      for (b += 1; b <= end; b += 1) {
        if (low[b] < a) a = low[b];
        if (high[b] > z) z = high[b];
      }
      const hole = a > z;
      // Falling and rising in turn: a column ends where the next begins.
      out[2 * c] = hole ? null : c % 2 ? z : a;
      out[2 * c + 1] = hole ? null : c % 2 ? a : z;
    }
    return out;
  }

  /** An array that is used again for every window: zooming makes no garbage. */
  room(n) {
    if (this.out?.length !== n) this.out = new Float32Array(n);
    return this.out;
  }

  /** The same where there are but a few samples a column: from the samples themselves. */
  few(from, each, columns) {
    const { values } = this;
    const out = this.room(2 * columns);
    const last = values.length - 1;
    let holes = false;
    for (let c = 0; c < columns; c += 1) {
      const end = Math.min(last, Math.ceil(from + (c + 1) * each) - 1);
      let [a, z] = [Infinity, -Infinity];
      for (let i = Math.floor(from + c * each); i <= end; i += 1) {
        const v = values[i];
        if (v === null) continue;
        if (v < a) a = v;
        if (v > z) z = v;
      }
      holes ||= a > z;
      out[2 * c] = a > z ? NaN : c % 2 ? z : a;
      out[2 * c + 1] = a > z ? NaN : c % 2 ? a : z;
    }
    return holes ? gapped(out) : out;
  }
}

function halved({ low, high }) {
  const n = Math.ceil(low.length / 2);
  const next = { low: new Float32Array(n), high: new Float32Array(n) };
  for (let b = 0; b < n; b += 1) {
    const k = Math.min(low.length - 1, 2 * b + 1);
    next.low[b] = Math.min(low[2 * b], low[k]);
    next.high[b] = Math.max(high[2 * b], high[k]);
  }
  return next;
}

/**
 * What is drawn of some series in a window: the samples themselves, or the extremes of each pixel column.
 * @param {ArrayLike<number>} t
 * @param {Pyramid[]} series
 * @param {[number, number]} window [s]
 * @param {number} width [device pixels]
 * @param {number} most samples a pixel up to which the samples themselves are drawn
 * @returns {{data: Array<ArrayLike<number|null>>, dense: boolean}}
 */
export function inWindow(t, series, [t0, t1], width, most) {
  const from = Math.max(0, first(t, t0) - 1);
  const to = Math.min(t.length - 1, first(t, t1) + 1);
  const count = to - from + 1;
  const columns = Math.max(2, Math.round(width));
  if (count < most * columns) {
    return { data: [part(t, from, to + 1), ...series.map((s) => gapped(part(s.values, from, to + 1)))], dense: false };
  }
  return { data: [times(t, from, to, columns), ...series.map((s) => s.columns(from, count, columns))], dense: true };
}

let same = {}; // charts on one page mostly share times and window

/** Two times of each column: of its first sample and of that in its middle. */
function times(t, from, to, columns) {
  if (same.t === t && same.from === from && same.to === to && same.columns === columns) return same.x;
  const x = new Float64Array(2 * columns);
  const each = (to - from + 1) / columns;
  for (let c = 0; c < columns; c += 1) {
    x[2 * c] = t[Math.floor(from + c * each)];
    x[2 * c + 1] = t[Math.min(to, Math.floor(from + (c + 0.5) * each))];
  }
  x[2 * columns - 1] = t[to];
  same = { t, from, to, columns, x };
  return x;
}

function part(values, from, to) {
  return values.subarray ? values.subarray(from, to) : values.slice(from, to);
}

/** uPlot's hole is null; NaN would be drawn over. Arrays without a hole are kept as they are. */
function gapped(values) {
  for (let i = 0; i < values.length; i += 1) {
    if (Number.isNaN(values[i])) return Array.from(values, (v) => (Number.isNaN(v) ? null : v));
  }
  return values;
}

/** Index of the first sample that is not before a time. */
export function first(t, value) {
  let [low, high] = [0, t.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (t[middle] < value) low = middle + 1;
    else high = middle;
  }
  return low;
}
