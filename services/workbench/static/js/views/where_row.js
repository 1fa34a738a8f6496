/** What one row's residual follows: against a state, its spectrum, its coherence with the states. */

import { needing, veil } from "../widgets/pending.js";
import { h } from "../widgets/dom.js";
import { percent, short } from "../widgets/format.js";
import { xyPlot } from "../charts/xy_plot.js";

const CURVES = 5;
const COLOURS = ["--modelled", "--effect-1", "--effect-2", "--effect-3", "--effect-5"];
const AXIS = { label: "", unit: "" };

/**
 * The pictures of one row, their places reserved.
 * @param {HTMLElement} root
 * @param {object} app
 * @returns {{show: (found: object, version: number, row: string) => void, destroy: () => void}}
 */
export function rowPictures(root, app) {
  const state = h("select", { "aria-label": "state", "data-testid": "state-select", onchange: () => void against() });
  const says = h("p", { class: "follows-says" });
  const left = h("div", { class: "where-cell" });
  const right = h("div", { class: "where-cell" });
  const last = h("div", { class: "where-cell" });
  root.append(says, h("div", { class: "where-grid" }, left, right, last));
  left.append(h("div", { class: "bar state-bar" }, h("label", { class: "check" }, "Residual against", state)));
  const first = xyPlot(left, { title: "", x: AXIS, y: AXIS, items: [], testid: "plot-against", height: 250 });
  const power = xyPlot(right, { title: "Spectrum", x: AXIS, y: AXIS, items: [], testid: "plot-spectrum", height: 250 });
  const share = xyPlot(last, { title: "Coherence", x: AXIS, y: AXIS, items: [], testid: "plot-coherence", height: 250 });
  const veils = { left: veil(left), right: veil(right), last: veil(last) };
  let now = { found: null, version: 0, row: "" };
  let turn = 0;
  let states = [];

  function choices(names) {
    const before = state.value;
    states = names;
    const follows = now.found.follows?.[now.row] ?? [];
    const part = (name) => follows.find((f) => f.state === name);
    state.replaceChildren(...names.map((name) => h("option", { value: name,
      text: part(name) ? `${name}  (${percent(Math.max(0, part(name).part))})` : name })));
    state.value = names.includes(before) ? before : names[0] ?? "";
    state.disabled = !names.length;
  }

  async function against() {
    const name = state.value;
    const mine = turn;
    if (!name) return;
    veils.left.clear();
    try {
      const one = now.found.against?.[now.row]?.[name] ?? await ask(`api/against/${now.version}/${path(now.row)}/${path(name)}`, "left");
      if (mine !== turn || state.value !== name) return;
      veils.left.clear();
      const { state: x, unit, row_unit: rowUnit } = one.shown;
      first.update({
        title: "", x: { label: name, unit }, y: { label: "error", unit: rowUnit },
        hint: one.put_back ? "What the model's own springs, dampers and masses absorbed is put back." : "The residual as it is.",
        counts: one.count,
        items: [
          { kind: "level", value: 0, colour: "--chart-ink", dash: [2, 3], width: 1 },
          { kind: "band", name: "95 % band", colour: "--residual", x, low: one.low, high: one.high },
          { kind: "line", name: "conditional mean", colour: "--residual", x, y: one.mean, marks: true, width: 2 },
        ],
      });
    } catch (cause) {
      if (mine === turn) veils.left.fail(cause, () => void against());
    }
  }

  async function spectrum() {
    const mine = turn;
    try {
      const one = await ask(`api/spectrum/${now.version}/${path(now.row)}`, "right");
      if (mine !== turn) return;
      veils.right.clear();
      veils.last.clear();
      if (one.why) {
        power.update({ title: "Spectrum", x: AXIS, y: AXIS, items: [], hint: "" });
        share.update({ title: "Coherence with states, squared", x: AXIS, y: AXIS, items: [], hint: "" });
        veils.right.say(one.why);
        veils.last.say(one.why);
        return;
      }
      const x = { label: "frequency", unit: "Hz", range: [0, one.frequency.at(-1)] };
      const f = one.frequency;
      power.update({
        title: "Spectrum", x, y: { label: "power density", unit: one.density_unit, log: true },
        hint: `mean of ${short(one.segments, 2)} segments of 4 s`,
        items: [
          { kind: "band", name: "noise, up to 95 %", colour: "--floor", x: f, low: one.floor, high: one.high },
          { kind: "line", name: "residual", colour: "--residual", x: f, y: one.residual, width: 2 },
          { kind: "line", name: "noise floor", colour: "--floor", x: f, y: one.floor, dash: [5, 3] },
        ],
      });
      share.update({
        title: "Coherence with states, squared", x, y: { label: "coherence²", unit: "", range: [0, 1] },
        hint: `those first that explain most of the residual's power; above ${one.level.toFixed(2)} it is no chance (5 %)`,
        items: [
          { kind: "level", name: "chance, 5 %", value: one.level, colour: "--chart-ink", dash: [5, 3] },
          // the server has them in the order of the residual's power that they explain
          ...Object.entries(one.coherence).slice(0, CURVES).map(([name, c], k) => ({ kind: "line",
            name: `${name} ${percent(one.explained[name])}`, colour: COLOURS[k], x: f, y: c, width: 1.8 })),
        ],
      });
      const more = Object.keys(one.coherence).filter((name) => !states.includes(name));
      if (more.length) {
        const none = !states.length;
        choices([...states, ...more]);
        if (none) void against();
      }
    } catch (cause) {
      if (mine !== turn) return;
      veils.right.fail(cause, () => void spectrum());
      veils.last.fail(cause);
    }
  }

  function ask(address, place) {
    const slow = setTimeout(() => veils[place].say("Computing …"), 200);
    return needing(app, () => app.api.get(address), { version: now.version }, veils[place]).finally(() => clearTimeout(slow));
  }

  return {
    show(found, version, row) {
      now = { found, version, row };
      turn += 1;
      const follows = found.follows?.[row] ?? [];
      says.textContent = sentence(row, follows);
      choices([...new Set([...follows.map((f) => f.state), ...Object.keys(found.against?.[row] ?? {}), ...(found.states?.[row] ?? [])])]);
      void against();
      void spectrum();
    },
    destroy() {
      turn += 1;
      for (const plot of [first, power, share]) plot.destroy();
    },
  };
}

function sentence(row, follows) {
  if (!follows.length) return `${row} does not fail, so no state was looked for that it follows. Any of its states can still be drawn.`;
  const strong = follows.filter((f) => f.p <= 0.05).slice(0, 3);
  if (!strong.length) return `${row} follows none of its states more than chance does.`;
  return `${row} follows ${strong.map((f) => `${f.state} (${percent(f.part)} of its squares, ${short(f.rms)} ${f.row_unit} RMS, p ${short(f.p, 2)})`).join("; ")}.`;
}

function path(text) {
  return encodeURIComponent(text);
}
