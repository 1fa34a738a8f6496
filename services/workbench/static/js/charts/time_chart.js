// A chart over time: uPlot with a head that reads the cursor, areas, linked zoom and cursor, wheel, touch and keys.

import "./locale.js";
import uPlot from "../../vendor/uplot/uPlot.esm.js";
import { areaRange, drawArea } from "./area.js";
import { faded, onTheme, resolved } from "./colours.js";
import { short } from "../widgets/format.js";
import { gestures } from "./gestures.js";
import { drawColumns, drawLine } from "./lines.js";
import { drawMarks } from "./marks.js";
import { link } from "./linked_axes.js";
import { tick } from "./ticks.js";
import { Pyramid, first, inWindow } from "./pyramid.js";

const MARGIN = "400px";
const LEFT = 66; // room for the numbers of the axis, the same in every chart, so that times are above each other [px]
const RIGHT = 24; // half of the last time's label [px]
const SIDES = LEFT + RIGHT;
const MANY = 16; // lines of linked charts from which strokes, which are smoother, take too long
const HAIR = 1; // widest stroke that is drawn without the outline of a path, in a twentieth of the time [device pixels]
const straight = uPlot.paths.linear();
const charts = new WeakMap();
const waiting = new Set();
let idle = 0;

// Drawn first is what can be seen; the rest follows when the browser has time, or when it is scrolled to.
const seen = new IntersectionObserver((entries) => {
  for (const entry of entries) charts.get(entry.target)?.see(entry.isIntersecting);
}, { rootMargin: MARGIN });
const sized = new ResizeObserver((entries) => {
  for (const entry of entries) charts.get(entry.target)?.size(entry.contentRect.width);
});

/**
 * Draws series over time.
 * @param {HTMLElement} root the chart is appended to it.
 * @param {object} options
 * @param {ArrayLike<number>} options.t seconds, rising.
 * @param {Array<object>} options.series each `{name, values, colour, width?, fill?, band?, layer?, hidden?, dash?}`:
 *   `colour` a CSS colour or `--property`, resolved anew when the theme changes; `fill` true fills to zero;
 *   `band` `{low, high, name?}` (numbers or arrays) is shaded behind; `layer` `{low, high}` draws an area instead of the
 *   line, `values` is then what the head reads. NaN is a gap.
 * @param {string} [options.unit] @param {string} [options.title]
 * @param {string} [options.sync] charts of one key share window and cursor.
 * @param {number} [options.height] of the plot [px]; @param {boolean} [options.axis] false: no labels of time.
 * @param {boolean} [options.rough] the values are extremes of blocks of samples: drawn, not read at the cursor.
 * @param {boolean} [options.toggles] entries of the head switch their series on and off.
 * @param {(t: number|null, values: Array<number|null>) => void} [options.onCursor]
 * @param {(t0: number, t1: number, whole: boolean) => void} [options.onZoom] by the user's hand, not by setWindow.
 * @param {(series: object) => void} [options.onToggle] after a series was switched on or off, before it is redrawn.
 * @param {string} [options.testid] @param {string} [options.keyTestid] of every entry of the head
 * @returns {{update: (patch: {t?: ArrayLike<number>, series?: Array<object>, unit?: string, title?: string, rough?: boolean}) => void,
 *   destroy: () => void, setWindow: (t0: number|null, t1?: number|null) => void, element: HTMLElement,
 *   figure: () => object}} `figure` : what is shown, for whoever draws or writes it elsewhere
 */
export function timeChart(root, options) {
  const chart = new Chart(root, options);
  return {
    element: chart.element,
    figure: () => chart.figure(),
    update: (patch) => chart.update(patch),
    destroy: () => chart.destroy(),
    setWindow: (t0, t1) =>
      chart.shared.setWindow(t0 ?? -Infinity, t1 ?? Infinity, false),
  };
}

class Chart {
  constructor(root, options) {
    this.o = { height: 150, unit: "", title: "", sync: "", axis: true, toggles: true, ...options };
    this.width = 0;
    this.visible = false;
    this.stale = true;
    this.shared = link(this.o.sync);
    this.onZoom = this.o.onZoom;
    this.dress(root);
    this.take();
    this.shared.join(this);
    this.off = onTheme(() => this.renew());
    charts.set(this.plot, this);
    sized.observe(this.plot);
    seen.observe(this.plot);
    later(this);
  }

  dress(root) {
    this.element = make("figure", "chart");
    if (this.o.testid) this.element.dataset.testid = this.o.testid;
    this.head = this.element.appendChild(make("figcaption", "chart-head"));
    this.plot = this.element.appendChild(make("div", "chart-plot"));
    this.plot.style.height = `${this.o.height}px`;
    this.plot.tabIndex = 0;
    this.plot.setAttribute("role", "application");
    root.appendChild(this.element);
  }

  /** Takes over data: extents, holes, and the head's entries. */
  take() {
    const { series } = this.o;
    this.measure();
    const what = [this.o.title, series.map((s) => s.name).join(", ")].filter(Boolean).join(": ");
    this.plot.setAttribute("aria-label", `${what}${this.o.unit ? ` [${this.o.unit}]` : ""} over time [s]`);
    this.entries();
  }

  measure() {
    const { t, series } = this.o;
    const n = t.length;
    this.extent = n ? [t[0], t[n - 1]] : [NaN, NaN];
    this.spacing = n > 1 ? (t[n - 1] - t[0]) / (n - 1) : 0.01;
    this.least = 8 * this.spacing;
    this.lines = series.filter((s) => !s.layer);
    this.pyramids = this.lines.map((s) => new Pyramid(s.values));
  }

  /** What uPlot is given: the window's samples, or the extremes of each pixel column where there are many. */
  get data() {
    const most = this.shared.lines > MANY ? 1.5 : 4;
    const { data, dense } = inWindow(this.o.t, this.pyramids, this.shared.shown, (this.width - SIDES) * uPlot.pxRatio, most);
    this.dense = dense;
    this.plot.classList.toggle("dense", dense);
    return data;
  }

  entries() {
    this.head.replaceChildren();
    const title = this.head.appendChild(make("span", "chart-title"));
    title.textContent = this.o.title;
    if (this.o.unit) this.head.appendChild(make("span", "chart-unit")).textContent = `[${this.o.unit}]`;
    this.reads = this.o.series.map((s) => {
      const entry = this.head.appendChild(make(this.o.toggles ? "button" : "span", "chart-key"));
      if (this.o.toggles) {
        entry.type = "button";
        if (this.o.keyTestid) entry.dataset.testid = this.o.keyTestid;
        entry.title = "show or hide";
        entry.setAttribute("aria-pressed", String(!s.hidden));
        entry.addEventListener("click", () => this.toggle(s, entry));
      }
      const swatch = entry.appendChild(make("i", s.layer || s.fill ? "chart-swatch area" : "chart-swatch"));
      swatch.style.setProperty("--own", s.colour.startsWith("--") ? `var(${s.colour})` : s.colour);
      entry.appendChild(make("span")).textContent = s.name;
      return entry.appendChild(make("output", "chart-value"));
    });
    for (const s of this.o.series) if (s.band?.name) this.head.appendChild(bandKey(s));
    this.clock = this.head.appendChild(make("output", "chart-time"));
  }

  toggle(series, entry) {
    series.hidden = !series.hidden;
    entry.setAttribute("aria-pressed", String(!series.hidden));
    this.o.onToggle?.(series);
    const k = this.lines.indexOf(series);
    if (this.u && k >= 0) this.u.setSeries(k + 1, { show: !series.hidden });
    this.u?.redraw(false);
    this.u?.setScale("y", { min: null, max: null });
  }

  /** Title, unit, window and series, hidden ones left out, and the canvas they are drawn on. */
  figure() {
    const { title, unit, t, series, height, rough } = this.o;
    if (!this.u && this.width) this.draw();
    return { title, unit, t, height, rough, window: this.shared.shown, series: series.filter((s) => !s.hidden),
      canvas: this.plot.querySelector("canvas"), range: this.u ? [this.u.scales.y.min, this.u.scales.y.max] : null };
  }

  see(visible) {
    this.visible = visible;
    if (visible) this.draw();
  }

  size(width) {
    const whole = Math.floor(width);
    if (!whole || whole === this.width) return;
    this.width = whole;
    if (this.u) {
      this.u.setData(this.data, false);
      this.u.setSize({ width: whole, height: this.o.height });
    } else if (this.visible) this.draw();
  }

  /** Makes or refreshes the picture if anything changed since. */
  draw() {
    waiting.delete(this);
    if (!this.width || this.gone) return;
    if (!this.u) {
      this.u = new uPlot(this.options(), this.data, this.plot);
      this.end = gestures(this.u.over, this.plot, this.shared, {
        timeAt: (px) => this.u.posToVal(px, "x"),
        spacing: () => this.spacing,
      });
      this.stale = false;
      if (this.shared.cursor !== null) this.showCursor(this.shared.cursor);
    } else if (this.stale) {
      this.stale = false;
      const [min, max] = this.shared.shown;
      // The link sets the cursor a frame later: here it would write to the page between charts, which lays it out for each.
      this.u.cursor.left = -10;
      this.u.setData(this.data, false);
      this.u.setScale("x", { min, max });
      this.shared.follow();
    }
  }

  /** Called once a frame, whatever changed in it: data, window, or both. */
  refresh() {
    if (!this.stale) return;
    if (this.visible && this.u) this.draw();
    else later(this);
  }

  showCursor(t, own = false) {
    const k = t === null ? -1 : nearest(this.o.t, t);
    const values = this.o.series.map((s) => (k < 0 || this.o.rough ? null : at(s.values, k)));
    if (this.visible) this.read(k, values);
    if (this.u && this.visible && !own) {
      this.following = true;
      const left = t === null ? -10 : this.u.valToPos(t, "x");
      this.u.setCursor({ left: left < 0 || left > this.u.bbox.width / uPlot.pxRatio ? -10 : left, top: t === null ? -10 : 5 });
      this.following = false;
    }
    this.o.onCursor?.(k < 0 ? null : this.o.t[k], values);
  }

  read(k, values) {
    this.reads.forEach((output, i) => say(output, k < 0 ? "" : short(values[i], 4)));
    say(this.clock, k < 0 ? "" : `${tick(this.o.t[k], 0.01)} s`);
  }

  update(patch) {
    const shape = (list) => list.map((s) => [s.name, s.colour, s.hidden, Boolean(s.layer), s.band?.name].join()).join(";");
    const head = () => `${this.o.title} ${this.o.unit} ${shape(this.o.series)}`;
    const before = head();
    Object.assign(this.o, patch);
    if (this.u && before === head()) {
      this.measure();
      this.stale = true;
      this.shared.queue();
      return;
    }
    this.take();
    this.renew();
  }

  /** Makes the picture anew: other series, other colours. */
  renew() {
    this.end?.();
    this.u?.destroy();
    this.u = null;
    this.stale = true;
    if (this.visible) this.draw();
    else later(this);
  }

  destroy() {
    this.gone = true;
    waiting.delete(this);
    this.off();
    seen.unobserve(this.plot);
    sized.unobserve(this.plot);
    this.end?.();
    this.u?.destroy();
    this.shared.leave(this);
    this.element.remove();
  }

  options() {
    this.inks = this.lines.map((s) => resolved(s.colour));
    const ink = resolved("--chart-ink", "#555");
    const grid = { stroke: resolved("--chart-grid", "#8883"), width: 1 };
    const font = "12px system-ui, sans-serif";
    const x = {
      stroke: ink, grid, font, size: this.o.axis ? 28 : 8, gap: 4, space: 70, ticks: { ...grid, size: this.o.axis ? 5 : 0 },
      values: (u, splits, k, space, step) => splits.map((v) => (this.o.axis ? `${tick(v, step)} s` : "")),
    };
    const y = {
      stroke: ink, grid, font, size: LEFT, gap: 4, space: 17, ticks: { ...grid, size: 5 },
      values: (u, splits, k, space, step) => splits.map((v) => tick(v, step)),
    };
    return {
      width: this.width,
      height: this.o.height,
      legend: { show: false },
      padding: [6, RIGHT, 0, 0],
      scales: { x: { time: false, range: () => this.shared.shown }, y: { range: (u, low, high) => this.range(u, low, high) } },
      axes: [x, y],
      series: [{}, ...this.lines.map((s) => this.stroke(s))],
      cursor: {
        y: false,
        points: this.shared.lines > MANY ? { show: false } : { size: 6 },
        drag: { x: true, y: false, setScale: false, dist: 5 },
        bind: { dblclick: () => () => { this.shared.reset(); return null; } },
      },
      hooks: {
        drawAxes: [(u) => this.areas(u)],
        drawSeries: [(u, k) => this.line(u, k)],
        draw: [(u) => drawMarks(u, this.shared.marks)],
        setCursor: [(u) => this.pointed(u)],
        setSelect: [(u) => this.chosen(u)],
      },
    };
  }

  stroke(s) {
    const colour = resolved(s.colour);
    return {
      show: !s.hidden, stroke: colour, width: s.width ?? 1.25, dash: s.dash, points: { show: s.points ?? false },
      paths: (u, k, from, to) => (s.fill && !this.dense ? straight(u, k, from, to) : null), fill: s.fill ? faded(s.colour, 0.25) : undefined, spanGaps: false,
    };
  }

  /** A line, which uPlot does not draw: it takes several times as long. */
  line(u, k) {
    const s = this.lines[k - 1];
    if (!s || s.hidden || s.fill || this.dense) return;
    const width = this.shared.lines > MANY && uPlot.pxRatio < 1.5 ? HAIR : this.thick(s);
    drawLine(u, u.data[0], u.data[k], { colour: this.inks[k - 1], width, dash: s.dash });
  }

  /** All lines where samples are denser than pixels. */
  columns(u) {
    const lines = this.lines.map((s, k) => ({ s, extremes: u.data[k + 1], colour: this.inks[k], thick: this.thick(s) }));
    drawColumns(u, u.data[0], lines.filter(({ s }) => !s.hidden));
  }

  thick(s) {
    return (s.width ?? 1.25) * uPlot.pxRatio;
  }

  areas(u) {
    const { series } = this.o;
    for (const s of series) {
      if (s.hidden) continue;
      if (s.band) drawArea(u, this.o.t, s.band, faded(s.band.colour ?? s.colour, 0.22));
      if (s.layer) drawArea(u, this.o.t, s.layer, faded(s.colour, 0.85));
    }
    if (this.dense) this.columns(u);
  }

  /** The lines in the window, their bands and layers, with a little room. */
  range(u, low, high) {
    let [a, b] = [low ?? Infinity, high ?? -Infinity];
    const [t0, t1] = this.shared.shown;
    for (const s of this.o.series) {
      if (s.hidden || (!s.band && !s.layer)) continue;
      const [c, d] = areaRange(this.o.t, s.layer ?? s.band, t0, t1);
      a = Math.min(a, c);
      b = Math.max(b, d);
    }
    if (!(a <= b)) return [-1, 1];
    const room = b > a ? 0.06 * (b - a) : Math.max(1e-9, Math.abs(a) * 0.1) || 1;
    return [a - room, b + room];
  }

  pointed(u) {
    if (this.following) return;
    const { left } = u.cursor;
    this.shared.setCursor(left >= 0 ? u.posToVal(left, "x") : null, this);
  }

  chosen(u) {
    const { left, width } = u.select;
    if (width < 5) return;
    const [a, b] = [u.posToVal(left, "x"), u.posToVal(left + width, "x")];
    u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    this.shared.setWindow(a, b);
  }
}

/**
 * Charts whose picture is not up to date yet: those out of sight are drawn when the browser has time.
 * @returns {number}
 */
export function pending() {
  return waiting.size;
}

function later(chart) {
  waiting.add(chart);
  if (!idle) idle = soon(work);
}

/** Draws what is out of sight while the browser has nothing else to do. */
function work(deadline) {
  idle = 0;
  for (const chart of [...waiting]) {
    if (deadline.timeRemaining() < 4) break;
    if (chart.width) chart.draw();
    else waiting.delete(chart);
  }
  if (waiting.size) idle = soon(work);
}

const soon = window.requestIdleCallback ?? ((call) => setTimeout(() => call({ timeRemaining: () => 8 }), 60));

function make(tag, className = "") {
  const element = document.createElement(tag);
  if (className) element.className = className;
  return element;
}

const said = new WeakMap();

/** A text that is there already is not written again: the page would be laid out anew. */
function say(output, text) {
  if ((said.get(output) ?? "") === text) return;
  said.set(output, text);
  output.textContent = text;
}

function bandKey(s) {
  const key = make("span", "chart-key");
  const swatch = key.appendChild(make("i", "chart-swatch area faint"));
  const colour = s.band.colour ?? s.colour;
  swatch.style.setProperty("--own", colour.startsWith("--") ? `var(${colour})` : colour);
  key.appendChild(make("span")).textContent = s.band.name;
  return key;
}

function at(values, k) {
  const value = values?.[k];
  return value === undefined || Number.isNaN(value) ? null : value;
}

function nearest(t, value) {
  const k = Math.min(t.length - 1, first(t, value));
  return k > 0 && value - t[k - 1] < t[k] - value ? k - 1 : k;
}
