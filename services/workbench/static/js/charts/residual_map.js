/** The residual map: row × time of every run, cells in units of the noise floor, the phases of driving above. */

import { pointer, sharpCanvas } from "./canvas.js";
import { colourBar } from "./colourbar.js";
import { resolved } from "./colours.js";
import { h } from "../widgets/dom.js";
import { times } from "../widgets/format.js";
import { mapKeys, worstTable } from "./residual_map_access.js";
import { tick, ticks } from "./ticks.js";
import { PHASES, ratioScale } from "./colour_scales.js";

const LEFT = 150;
const HEAD = 36; // title of a run, its strip of phases
const STRIP = 12;
const FOOT = 26;
const GAP = 10;
const RIGHT = 12;

/**
 * Draws the residual map.
 * @param {HTMLElement} root
 * @param {{onPick: (place: {run: string, row: string, start: number, stop: number}) => void, rows: number}} act rows: for
 *   how many there is room from the start
 * @returns {{update: (map: object, row: string) => void, choose: (row: string) => void, destroy: () => void}}
 */
export function residualMap(root, { onPick, rows }) {
  const tall = matchMedia("(pointer: coarse)").matches ? 24 : 17;
  const legend = h("div", { class: "map-legend" });
  const box = h("div", { class: "map-box", tabindex: "0", role: "application", "data-testid": "map", "data-own-arrows": "",
    "aria-label": "Residual map, row by time. Arrows move, Enter compares at the place." });
  const mark = h("div", { class: "map-mark", hidden: true });
  const read = h("output", { class: "plot-read map-read", text: "Move over the map to read it; click to compare there." });
  const phases = h("div", { class: "map-phases" });
  const alternative = h("details", { class: "map-table" }, h("summary", { text: "The same as a table" }));
  root.append(legend, box, read, phases, alternative);
  box.append(mark);
  const bar = colourBar(legend, "error ÷ noise floor");
  legend.append(h("span", { class: "muted small-note" }, h("i", { class: "phase-swatch empty" }), "not measured"));
  const sheet = sharpCanvas(box, HEAD + FOOT + rows * tall, paint);
  let map = null;
  let chosen = "";
  let at = null; // {k: run, r: row, c: cell}
  let largest = 5;

  /** Where everything is, for a width: each run as wide as it is long. */
  function layout(width) {
    const seconds = map.runs.map((run) => run.cells * map.cell);
    const room = Math.max(80, width - LEFT - RIGHT - GAP * (map.runs.length - 1));
    const per = room / seconds.reduce((a, b) => a + b, 0);
    let left = LEFT;
    return map.runs.map((run, k) => {
      const place = { run, left, width: seconds[k] * per, per };
      left += place.width + GAP;
      return place;
    });
  }

  function paint(ctx, width) {
    if (!map) return;
    const scale = ratioScale(largest);
    const places = layout(width);
    names(ctx);
    for (const place of places) {
      heading(ctx, place);
      cells(ctx, place, scale);
      foot(ctx, place);
    }
    ctx.textAlign = "right";
    ctx.fillText("time [s]", LEFT - 10, HEAD + map.rows.length * tall + 8);
    put();
  }

  function names(ctx) {
    ctx.textAlign = "right";
    ctx.textBaseline = "middle";
    map.rows.forEach((row, r) => {
      ctx.font = `${row === chosen ? "700 " : ""}12px system-ui, sans-serif`;
      ctx.fillStyle = resolved(row === chosen ? "--accent" : "--ink");
      ctx.fillText(row, LEFT - 8, HEAD + (r + 0.5) * tall, LEFT - 12);
    });
    ctx.font = "12px system-ui, sans-serif";
    ctx.fillStyle = resolved("--chart-ink");
    ctx.fillText("phase", LEFT - 8, HEAD - STRIP / 2 - 2);
  }

  function heading(ctx, { run, left, width, per }) {
    ctx.save();
    ctx.beginPath();
    ctx.rect(left, 0, width, HEAD);
    ctx.clip();
    ctx.textAlign = "left";
    ctx.textBaseline = "top";
    ctx.fillStyle = resolved("--ink");
    ctx.font = "600 12px system-ui, sans-serif";
    ctx.fillText(run.name, left, 4);
    const after = left + ctx.measureText(`${run.name} `).width;
    ctx.font = "12px system-ui, sans-serif";
    ctx.fillStyle = resolved("--chart-ink");
    const role = run.used ? "used" : "held out";
    if (after + ctx.measureText(role).width <= left + width + 1) ctx.fillText(role, after, 4);
    ctx.restore();
    for (const phase of run.phases) {
      ctx.fillStyle = PHASES[phase.phase] ?? "#888";
      const x = left + Math.max(0, (phase.start - run.t0) * per);
      ctx.fillRect(x, HEAD - STRIP - 2, Math.min(left + width, left + (phase.stop - run.t0) * per) - x, STRIP - 2);
    }
  }

  function cells(ctx, { run, left, width, per }, scale) {
    const empty = resolved("--map-empty");
    const wide = map.cell * per;
    const columns = wide >= 1 ? run.cells : Math.ceil(width);
    map.rows.forEach((row, r) => {
      const line = run.rows[row];
      const y = HEAD + r * tall;
      ctx.fillStyle = empty;
      ctx.fillRect(left, y, width, tall - 1);
      if (!line) return;
      for (let c = 0; c < columns; c += 1) {
        // Where several cells share a pixel the worst of them is shown.
        const value = wide >= 1 ? line[c] : worst(line, (c / columns) * run.cells, ((c + 1) / columns) * run.cells);
        if (value === null || value === undefined) continue;
        ctx.fillStyle = scale.colour(value);
        const x = left + (c / columns) * width;
        ctx.fillRect(x, y, Math.max(1, width / columns) + 0.3, tall - 1);
      }
    });
  }

  function foot(ctx, { run, left, width, per }) {
    const y = HEAD + map.rows.length * tall;
    ctx.strokeStyle = ctx.fillStyle = resolved("--chart-ink");
    ctx.textAlign = "center";
    ctx.textBaseline = "top";
    const found = ticks(run.t0, run.t0 + run.cells * map.cell, Math.max(1, Math.floor(width / 36)));
    for (const v of found.values) {
      const x = Math.round(left + (v - run.t0) * per) + 0.5;
      ctx.beginPath();
      ctx.moveTo(x, y);
      ctx.lineTo(x, y + 4);
      ctx.stroke();
      ctx.fillText(tick(v, found.step), x, y + 6);
    }
  }

  function find(x, y) {
    if (!map) return null;
    const k = layout(sheet.width()).findIndex((p) => x >= p.left && x < p.left + p.width);
    const r = Math.floor((y - HEAD) / tall);
    if (k < 0 || r < 0 || r >= map.rows.length) return null;
    const place = layout(sheet.width())[k];
    return { k, r, c: Math.min(place.run.cells - 1, Math.floor((x - place.left) / place.per / map.cell)) };
  }

  /** Puts the mark on a cell and says what is there. */
  function put(to = at) {
    at = to;
    mark.hidden = !at;
    if (!at) return;
    const place = layout(sheet.width())[at.k];
    const wide = Math.max(3, map.cell * place.per);
    mark.style.left = `${place.left + (at.c / place.run.cells) * place.width + (map.cell * place.per - wide) / 2}px`;
    mark.style.top = `${HEAD + at.r * tall}px`;
    mark.style.width = `${wide}px`;
    mark.style.height = `${tall - 1}px`;
    read.textContent = says(at);
  }

  function says({ k, r, c }) {
    const { run, row, start, stop } = where({ k, r, c });
    const value = map.runs[k].rows[row]?.[c];
    const middle = (start + stop) / 2;
    const phase = map.runs[k].phases.find((p) => middle >= p.start && middle <= p.stop)?.phase ?? "no phase";
    const error = value === null || value === undefined ? "not measured here" : `${times(value)} × its noise floor`;
    return `${row}, run ${run} (${map.runs[k].used ? "used" : "held out"}), ${tick(start, 0.1)} to ${tick(stop, 0.1)} s: ${error}; ${phase}`;
  }

  function where({ k, r, c }) {
    const run = map.runs[k];
    const start = run.t0 + c * map.cell;
    return { run: run.name, row: map.rows[r], start, stop: start + map.cell };
  }

  pointer(sheet.canvas, {
    move: (x, y) => {
      const found = find(x, y);
      if (found) put(found);
    },
    leave: () => { if (document.activeElement !== box) mark.hidden = true; },
    pick: (x, y) => {
      const found = find(x, y);
      if (found) onPick(where(found));
    },
  });
  mapKeys(box, { map: () => map, at: () => at, put, pick: () => { if (at) onPick(where(at)); } });

  return {
    update(next, row) {
      map = next;
      chosen = row;
      at = null;
      largest = 0;
      for (const run of map.runs) for (const line of Object.values(run.rows)) for (const v of line) if (v > largest) largest = v;
      sheet.resize(HEAD + FOOT + map.rows.length * tall);
      const marks = ratioScale(largest);
      bar.update(() => ratioScale(largest), marks.ticks.map((v) => [marks.part(v), String(v)]));
      phases.replaceChildren(...key(map));
      worstTable(alternative, map, onPick);
    },
    choose(row) {
      chosen = row;
      sheet.draw();
    },
    destroy() {
      sheet.destroy();
      bar.destroy();
    },
  };
}

function key(map) {
  const there = new Set(map.runs.flatMap((run) => run.phases.map((p) => p.phase)));
  return Object.keys(PHASES).filter((name) => there.has(name)).map((name) => {
    const swatch = h("i", { class: "phase-swatch" });
    swatch.style.background = PHASES[name];
    return h("span", { class: "chart-key" }, swatch, name);
  });
}

function worst(line, from, to) {
  let found = null;
  for (let c = Math.floor(from); c < Math.max(Math.ceil(to), Math.floor(from) + 1) && c < line.length; c += 1) {
    if (line[c] !== null && (found === null || line[c] > found)) found = line[c];
  }
  return found;
}
