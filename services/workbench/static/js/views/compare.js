/** Compare: measured against modelled, row by row, with other versions, runs, channels and formulas on the same time. */

import { needing, veil } from "../widgets/pending.js";
import { link } from "../charts/linked_axes.js";
import { compareBar } from "./compare_bar.js";
import { channelCharts } from "./compare_channels.js";
import { cursorPanel } from "./compare_cursors.js";
import { forcesPanel } from "./compare_forces.js";
import { layoutOf, patchOf } from "./compare_layout.js";
import { colourOf, named, overlayPicker } from "./compare_overlays.js";
import { scoresOf, sourcesTables, strip, table, validation } from "./compare_scores.js";
import { rowStack } from "./compare_stack.js";
import { xyPanel } from "./compare_xy.js";
import { h } from "../widgets/dom.js";
import { term } from "../widgets/terms.js";
import { LAYOUT } from "../net/state.js";

const SYNC = "compare";
const KEPT = 60; // series kept, so that going back to a row is immediate
const series = new Map();

/**
 * @param {HTMLElement} root
 * @param {object} app
 * @returns {Promise<() => void>} takes the view down
 */
export async function show(root, app) {
  if (!app.state.study?.exists) {
    root.append(h("p", { class: "notice", text: "There is no model yet: choose runs in the view Runs and make the model." }));
    return app.on((patch) => { if (patch.study?.exists) app.go("compare"); });
  }
  const view = new Compare(root, app);
  view.everything();
  const off = app.on((patch) => view.changed(patch));
  return () => {
    off();
    view.close();
  };
}

class Compare {
  constructor(root, app) {
    this.app = app;
    this.turn = 0;
    this.stacks = new Map();
    this.onZoom = (t0, t1, whole) => {
      this.own = true;
      app.set(whole ? { t0: null, t1: null } : { t0, t1 });
      this.own = false;
      this.bar.whole(whole);
      this.aside();
    };
    this.overlays = overlayPicker({
      add: (one) => this.change((layout) => layout.overlays.push(one)),
      remove: (k) => this.change((layout) => layout.overlays.splice(k, 1)),
    });
    this.bar = compareBar(this.acts(), this.overlays.select);
    this.heading = h("p", { class: "validation", "data-testid": "validation" });
    this.doubts = h("div", { "data-testid": "doubts" }); // of all values: a scale that is hardly known, values that no car has
    this.strip = h("div", { class: "score-strip" });
    this.rows = h("div", { class: "stacks" });
    this.table = h("div", { class: "scroll" });
    this.sources = h("div", { class: "scroll", "data-testid": "row-sources" });
    this.forces = forcesPanel();
    this.cursors = cursorPanel({ set: (a, b) => app.set({ a, b }) });
    this.xy = xyPanel({ set: (pair) => this.change((layout) => { layout.xy = pair; }) });
    this.channels = channelCharts(app, { sync: SYNC, onZoom: this.onZoom, onDrawn: () => this.window(),
      onClose: (kind, name) => this.change((layout) => {
        const names = layout[`${kind}s`];
        names.splice(names.indexOf(name), 1);
      }) });
    root.append(this.bar.element, this.overlays.chips,
      h("section", { class: "panel compare-head" }, this.doubts, this.heading, this.strip), this.rows, this.channels.element, this.cursors.element,
      this.xy.element, this.forces.element, h("section", { class: "panel all-scores" }, h("h2", null, "All rows of this run"), this.table),
      h("section", { class: "panel all-scores" }, h("h2", null, "Where the rows come from", term(app, "source")), this.sources));
    this.veil = veil(this.rows);
    root.addEventListener("pointerdown", (event) => { this.pressed = event.clientX; }, true);
    root.addEventListener("click", (event) => this.clicked(event));
  }

  acts() {
    const { app } = this;
    return {
      run: (run) => app.set({ run }),
      row: (row) => app.set({ row }),
      step: (by) => this.step(by),
      beneath: (row) => this.beneath(row, true),
      channel: (name) => name && this.change((layout) => layout.channels.includes(name) || layout.channels.push(name), `channel ${name}`),
      formula: (text) => this.change((layout) => layout.formulas.includes(text) || layout.formulas.push(text), `formula ${text}`),
      whole: () => app.set({ t0: null, t1: null }),
      save: (kind) => void this.save(kind),
      part: (key, on) => {
        if (key === "cursors") this.setCursors(on);
        else if (key === "xy") this.change((layout) => { layout.xy = on ? this.firstPair() : null; });
        else this.change((layout) => { layout[key] = on; });
      },
    };
  }

  get version() {
    const { study, version } = this.app.state;
    return study.versions.find((v) => v.version === version);
  }

  get layout() {
    return layoutOf(this.app.state);
  }

  /** Changes what is shown; `reveal` : a chart to scroll to. */
  change(edit, reveal = "") {
    const { layout } = this;
    edit(layout);
    this.app.set(patchOf(layout));
    if (reveal) this.channels.reveal(reveal);
  }

  changed(patch) {
    if ("study" in patch || "version" in patch) {
      if (patch.study && !patch.study.exists) return;
      this.everything();
    } else if ("run" in patch) {
      if (!("t0" in patch)) this.app.set({ t0: null, t1: null, ...(this.layout.cursors ? { a: null, b: null } : {}) });
      this.everything();
    } else if ("row" in patch) this.everything();
    else if (LAYOUT.some((key) => key in patch && key !== "a" && key !== "b" && key !== "xy")) this.everything();
    else {
      if (("t0" in patch || "t1" in patch) && !this.own) this.window();
      if ("a" in patch || "b" in patch || "xy" in patch) this.aside();
    }
  }

  /** Fills controls and scores from what is known already, then fetches the series. */
  everything() {
    const { state } = this.app;
    const version = this.version;
    if (!version || !state.run || !state.row) return; // a short address: the page is about to choose
    this.found = scoresOf(version, state.run);
    const [kind, why] = validation(this.found.used, state.run);
    this.heading.replaceChildren(h("b", { text: kind }), " ", term(this.app, "validation"), ` ${why}.`);
    this.strip.replaceChildren(strip(this.app, this.found.rows.find((s) => s.row === state.row)));
    this.table.replaceChildren(table({ rows: this.found.rows, chosen: state.row, beneath: new Set(this.layout.rows),
      onRow: (row) => this.app.set({ row }), onBeneath: (row, on) => this.beneath(row, on) }));
    this.doubts.replaceChildren(...version.doubts.map((text) => h("p", { class: "notice", text: `${text}.` })));
    this.sources.replaceChildren(...sourcesTables(version.row_sources));
    this.forces.of(this.found.used ? "" : `api/forces/${state.version}/${encodeURIComponent(state.run)}`);
    this.arrange();
    void this.fetch();
    void this.channelNames();
  }

  step(by) {
    const rows = this.found.rows.map((s) => s.row);
    if (!rows.length) return;
    this.app.set({ row: rows[(rows.indexOf(this.app.state.row) + by + rows.length) % rows.length] });
  }

  beneath(row, on) {
    if (row) this.change((layout) => { layout.rows = [...layout.rows.filter((r) => r !== row), ...(on ? [row] : [])]; });
  }

  /** One stack for the chosen row, one for each beneath. */
  arrange() {
    const { state } = this.app;
    const { layout } = this;
    this.bar.choices({ version: this.version, state, layout, rows: this.found.rows });
    this.overlays.update(state.study, state, layout.overlays);
    const there = new Set(this.found.rows.map((s) => s.row));
    const wanted = [state.row, ...layout.rows.filter((r) => r !== state.row && there.has(r))];
    for (const [name, stack] of this.stacks) {
      if (wanted.includes(name) && stack.first === (name === state.row)) continue;
      stack.destroy();
      this.stacks.delete(name);
    }
    for (const name of wanted) {
      if (!this.stacks.has(name)) {
        const first = name === state.row;
        const stack = rowStack(this.rows, { sync: SYNC, row: name, onZoom: this.onZoom, tall: first,
          onClose: first ? null : () => this.beneath(name, false) });
        stack.first = first;
        if (first) this.rows.prepend(stack.element);
        this.stacks.set(name, stack);
      }
      this.stacks.get(name).parts(layout);
    }
  }

  async fetch() {
    const { run, version } = this.app.state;
    const { overlays, channels, formulas } = this.layout;
    const mine = ++this.turn;
    const slow = setTimeout(() => this.veil.say("Reading the series …"), 150);
    const beneath = this.channels.show(run, version, channels, formulas);
    try {
      const found = await Promise.all([...this.stacks].map(async ([row, stack]) => [stack, await this.get(version, run, row),
        await this.over(overlays, version, run, row)]));
      if (mine !== this.turn) return;
      this.veil.clear();
      for (const [stack, one, over] of found) stack.show(one, over);
      this.window();
      await beneath;
    } catch (cause) {
      if (mine === this.turn) this.veil.fail(cause, () => void this.fetch());
    } finally {
      clearTimeout(slow);
    }
  }

  async get(version, run, row) {
    const path = `api/series/${version}/${encodeURIComponent(run)}/${encodeURIComponent(row)}`;
    if (!series.has(path)) {
      series.set(path, await needing(this.app, () => this.app.api.binary(path), { version }, this.veil));
      if (series.size > KEPT) series.delete(series.keys().next().value);
    }
    return series.get(path);
  }

  /** Series of the overlays; one that the version or run does not have is left out, and said to be. */
  async over(overlays, version, run, row) {
    const out = await Promise.all(overlays.map(async (one, k) => {
      try {
        const found = await this.get(one.version ?? version, one.run ?? run, row);
        return { found, name: named(one), colour: colourOf(k), otherRun: one.run !== null };
      } catch (cause) {
        this.app.complain(cause);
        return null;
      }
    }));
    return out.filter(Boolean);
  }

  window() {
    const { t0, t1 } = this.app.state;
    const any = this.stacks.values().next().value;
    const whole = t0 === null || t1 === null;
    any?.setWindow(whole ? null : t0, whole ? null : t1);
    this.bar.whole(whole);
    requestAnimationFrame(() => this.aside()); // the window is set a frame later
  }

  // -- cursors, XY, files -------------------------------------------------------------------------------------------

  figures() {
    return [...[...this.stacks.values()].flatMap((stack) => stack.figures()), ...this.channels.figures()].filter((f) => f.t.length);
  }

  /** Cursors and XY plot from the curves as they are now. */
  aside() {
    if (this.gone) return;
    const { a, b } = this.app.state;
    const { layout } = this;
    link(SYNC).setMarks(layout.cursors ? [{ t: a, label: "A" }, { t: b, label: "B" }] : []);
    if (!layout.cursors && !layout.xy && this.cursors.element.hidden && this.xy.element.hidden) return;
    const figures = this.figures();
    this.cursors.update(a, b, figures);
    this.xy.update(layout.xy, figures);
  }

  setCursors(on) {
    const [t0, t1] = link(SYNC).shown;
    const at = (part) => Math.round(1e3 * (t0 + part * (t1 - t0))) / 1e3;
    this.app.set(on ? { a: at(0.25), b: at(0.75) } : { a: null, b: null });
  }

  /** A click on a chart moves the nearer cursor there; a drag has chosen a window instead. */
  clicked(event) {
    if (!this.layout.cursors || !event.target.closest?.(".chart-plot .u-over")) return;
    const t = link(SYNC).cursor;
    if (t === null || event.detail > 1 || Math.abs(event.clientX - this.pressed) > 4) return;
    const { a, b } = this.app.state;
    const at = Math.round(1e3 * t) / 1e3;
    this.app.set(Math.abs(at - a) <= Math.abs(at - b) ? { a: at } : { b: at });
  }

  firstPair() {
    const row = this.app.state.row;
    return [`${row}: modelled`, `${row}: measured`];
  }

  async save(kind) {
    const { state } = this.app;
    const name = `${state.study.name}-v${state.version}-${state.run}-${state.row}`.replace(/[^\w.-]+/g, "_");
    const title = `${state.study.name}, version ${state.version}, run ${state.run}, ${link(SYNC).shown.map((t) => t.toFixed(2)).join(" to ")} s`;
    const { csv, png, save, svg } = await import("./compare_export.js");
    const [figures, xy] = [this.figures(), this.xy.figure()];
    if (kind === "csv") save(`${name}.csv`, csv(figures, xy), "text/csv");
    else if (kind === "svg") save(`${name}.svg`, svg(title, figures, xy), "image/svg+xml");
    else save(`${name}.png`, await png(title, figures, xy), "image/png");
  }

  async channelNames() {
    const { run } = this.app.state;
    if (this.namesOf === run) return;
    this.namesOf = run;
    try {
      const about = await this.app.api.get(`api/runs/${encodeURIComponent(run)}`);
      if (this.namesOf === run) this.bar.channels(about.channels ?? []);
    } catch (cause) {
      this.app.complain(cause);
    }
  }

  close() {
    this.turn += 1;
    this.gone = true;
    this.channels.close();
    this.xy.destroy();
    for (const stack of this.stacks.values()) stack.destroy();
  }
}
