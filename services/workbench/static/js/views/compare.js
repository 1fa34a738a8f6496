/** Compare: measured against modelled, row by row, with the share of each effect and any channel on the same time. */

import { needing, veil } from "../widgets/pending.js";
import { timeChart } from "../charts/time_chart.js";
import { scoresOf, sourcesTable, strip, table, validation } from "./compare_scores.js";
import { rowStack } from "./compare_stack.js";
import { forcesPanel } from "./compare_forces.js";
import { h } from "../widgets/dom.js";
import { times } from "../widgets/format.js";
import { readChannels } from "../net/run_channels.js";
import { runName } from "../net/state.js";

const SYNC = "compare";
const KEPT = 40; // series kept, so that going back to a row is immediate
const series = new Map();
const KEPT_CHANNELS = 90; // those of two runs
const measured = new Map();
const kept = { beneath: new Set(), channels: [], shares: true, centred: true };

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

function keep(list, path, one, most) {
  list.set(path, one);
  if (list.size > most) list.delete(list.keys().next().value);
}

class Compare {
  constructor(root, app) {
    this.app = app;
    this.turn = 0;
    this.stacks = new Map();
    this.plots = new Map();
    this.onZoom = (t0, t1, whole) => {
      this.own = true;
      app.set(whole ? { t0: null, t1: null } : { t0, t1 });
      this.own = false;
      this.wholeButton.disabled = whole;
    };
    this.bar(root);
    this.heading = h("p", { class: "validation", "data-testid": "validation" });
    this.strip = h("div", { class: "score-strip" });
    this.rows = h("div", { class: "stacks" });
    this.channels = h("div", { class: "channels" });
    this.table = h("div", { class: "scroll" });
    this.scores = h("section", { class: "panel all-scores" }, h("h2", null, "All rows of this run"), this.table);
    this.sources = h("div", { class: "scroll", "data-testid": "row-sources" });
    const formed = h("section", { class: "panel all-scores" }, h("h2", null, "Where the rows come from"), this.sources);
    this.forces = forcesPanel();
    root.append(h("section", { class: "panel compare-head" }, this.heading, this.strip), this.rows, this.channels, this.forces.element,
      this.scores, formed);
    this.veil = veil(this.rows);
  }

  bar(root) {
    const { app } = this;
    const option = (value, text) => h("option", { value, text });
    this.run = h("select", { "aria-label": "run", "data-testid": "compare-run", onchange: () => app.set({ run: this.run.value }) });
    this.row = h("select", { "aria-label": "row", "data-testid": "row-select", onchange: () => app.set({ row: this.row.value }) });
    const step = (by, text, label) => h("button", { type: "button", class: "step", text, "aria-label": label, title: label,
      onclick: () => this.step(by) });
    this.more = h("select", { class: "more", "aria-label": "add a row beneath", onchange: () => this.beneath(this.more.value, true) });
    this.channel = h("select", { class: "more", "aria-label": "add a channel beneath", "data-testid": "channel-select",
      onchange: () => this.addChannel(this.channel.value) });
    this.more.append(option("", "+ row …"));
    this.channel.append(option("", "+ channel …"));
    const check = (key, text, title) => h("label", { class: "check", title }, h("input", { type: "checkbox", checked: kept[key],
      onchange: (e) => {
        kept[key] = e.target.checked;
        for (const stack of this.stacks.values()) stack.parts(kept);
        this.window();
      } }), text);
    this.wholeButton = h("button", { type: "button", class: "small", text: "Whole run", title: "Show the whole run (double click, or 0)",
      disabled: true, onclick: () => { app.set({ t0: null, t1: null }); } });
    root.append(h("div", { class: "bar compare-bar" }, this.run, step(-1, "↑", "the row before"), this.row,
      step(1, "↓", "the row after"), this.more, this.channel, check("shares", "Shares", "the share of each effect"),
      check("centred", "About means", "shares without their mean: what static loads hide"), this.wholeButton));
  }

  get version() {
    const { study, version } = this.app.state;
    return study.versions.find((v) => v.version === version);
  }

  changed(patch) {
    if ("study" in patch || "version" in patch) {
      if (patch.study && !patch.study.exists) return;
      this.everything();
    } else if ("run" in patch) {
      if (!("t0" in patch)) this.app.set({ t0: null, t1: null });
      this.everything();
    } else if ("row" in patch) this.everything();
    else if (("t0" in patch || "t1" in patch) && !this.own) this.window();
  }

  /** Fills controls and scores from what is known already, then fetches the series. */
  everything() {
    const { state } = this.app;
    const version = this.version;
    if (!version || !state.run || !state.row) return; // a short address: the page is about to choose
    this.found = scoresOf(version, state.run);
    this.choices(version);
    const [kind, why] = validation(this.found.used, state.run);
    this.heading.replaceChildren(h("b", { text: kind }), `: ${why}.`);
    this.strip.replaceChildren(strip(this.found.rows.find((s) => s.row === state.row)));
    this.list();
    this.forces.of(this.found.used ? "" : `api/forces/${state.version}/${encodeURIComponent(state.run)}`);
    this.arrange();
    void this.fetch();
    void this.channelNames();
  }

  choices(version) {
    const { state } = this.app;
    const group = (label, runs) => (runs.length ? h("optgroup", { label },
      runs.map((r) => h("option", { value: runName(r), text: runName(r) }))) : null);
    this.run.replaceChildren(...[group("used for the fit", version.used ?? state.study.used ?? []),
      group("held out", version.held ?? state.study.held ?? [])].filter(Boolean));
    this.run.value = state.run;
    const rows = this.found.rows;
    this.row.replaceChildren(...rows.map((s) => h("option", { value: s.row, text: `${s.row}: ${times(s.ratio)}` })));
    this.row.value = state.row;
    this.more.replaceChildren(h("option", { value: "", text: "+ row …" }),
      ...rows.filter((s) => s.row !== state.row && !kept.beneath.has(s.row)).map((s) => h("option", { value: s.row, text: s.row })));
  }

  list() {
    this.table.replaceChildren(table({
      rows: this.found.rows, chosen: this.app.state.row, beneath: kept.beneath,
      onRow: (row) => this.app.set({ row }), onBeneath: (row, on) => this.beneath(row, on),
    }));
    this.sources.replaceChildren(sourcesTable(this.version?.row_sources));
  }

  step(by) {
    const rows = this.found.rows.map((s) => s.row);
    if (!rows.length) return;
    const k = (rows.indexOf(this.app.state.row) + by + rows.length) % rows.length;
    this.app.set({ row: rows[k] });
  }

  beneath(row, on) {
    if (!row) return;
    if (on) kept.beneath.add(row);
    else kept.beneath.delete(row);
    this.everything();
  }

  /** One stack for the chosen row, one for each beneath. */
  arrange() {
    const { row } = this.app.state;
    const there = new Set(this.found.rows.map((s) => s.row));
    const wanted = [row, ...[...kept.beneath].filter((r) => r !== row && there.has(r))];
    for (const [name, stack] of this.stacks) {
      if (wanted.includes(name) && stack.first === (name === row)) continue;
      stack.destroy();
      this.stacks.delete(name);
    }
    for (const name of wanted) {
      if (this.stacks.has(name)) continue;
      const first = name === row;
      const stack = rowStack(this.rows, { sync: SYNC, row: name, onZoom: this.onZoom, tall: first,
        onClose: first ? null : () => this.beneath(name, false) });
      stack.first = first;
      stack.parts(kept);
      if (first) this.rows.prepend(stack.element);
      this.stacks.set(name, stack);
    }
  }

  async fetch() {
    const { app } = this;
    const { run, version } = app.state;
    const mine = ++this.turn;
    const slow = setTimeout(() => this.veil.say("Reading the series …"), 150);
    const channels = this.fetchChannels(mine, run);
    try {
      const found = await Promise.all([...this.stacks].map(async ([row, stack]) => [stack, await this.get(version, run, row)]));
      if (mine !== this.turn) return;
      this.veil.clear();
      for (const [stack, one] of found) stack.show(one);
      this.window();
      await channels;
    } catch (cause) {
      if (mine === this.turn) this.veil.fail(cause, () => void this.fetch());
    } finally {
      clearTimeout(slow);
    }
  }

  async get(version, run, row) {
    const path = `api/series/${version}/${encodeURIComponent(run)}/${encodeURIComponent(row)}`;
    if (!series.has(path)) {
      keep(series, path, await needing(this.app, () => this.app.api.binary(path), { version }, this.veil), KEPT);
    }
    return series.get(path);
  }

  window() {
    const { t0, t1 } = this.app.state;
    const any = this.stacks.values().next().value;
    const whole = t0 === null || t1 === null;
    any?.setWindow(whole ? null : t0, whole ? null : t1);
    this.wholeButton.disabled = whole;
  }

  async channelNames() {
    const { run } = this.app.state;
    if (this.namesOf === run) return;
    this.namesOf = run;
    try {
      const about = await this.app.api.get(`api/runs/${encodeURIComponent(run)}`);
      if (this.namesOf !== run) return;
      this.channel.replaceChildren(h("option", { value: "", text: "+ channel …" }), ...(about.channels ?? []).map((c) =>
        h("option", { value: c.name, text: `${c.name}${c.unit ? ` [${c.unit}]` : ""}` })));
    } catch (cause) {
      this.app.complain(cause);
    }
  }

  async addChannel(name) {
    this.channel.value = "";
    if (!name || kept.channels.includes(name)) return;
    kept.channels.push(name);
    const over = this.fetchChannels(this.turn, this.app.state.run);
    this.plots.get(name)?.box.scrollIntoView({ block: "nearest" });
    await over;
  }

  async fetchChannels(mine, run) {
    for (const name of kept.channels) {
      if (!this.plots.has(name)) this.plots.set(name, this.channelBox(name));
    }
    const path = (name) => `${run} ${name}`;
    const names = [...this.plots.keys()];
    const there = names.filter((name) => measured.has(path(name)));
    if (there.length) this.drawChannels(new Map(there.map((name) => [name, measured.get(path(name))])));
    const lacking = names.filter((name) => !measured.has(path(name)));
    if (!lacking.length) return;
    this.reading?.abort();
    this.reading = new AbortController();
    try {
      await readChannels(run, lacking, (found) => {
        for (const [name, one] of found) if (!one.rough) keep(measured, path(name), one, KEPT_CHANNELS);
        if (mine === this.turn) this.drawChannels(found);
      }, this.reading.signal);
    } catch (cause) {
      if (cause.name === "AbortError" || mine !== this.turn) return;
      for (const name of lacking) this.plots.get(name)?.veil.fail(cause);
    }
  }

  drawChannels(found) {
    for (const [name, { t, parts, unit, rough }] of found) {
      const plot = this.plots.get(name);
      if (!plot) continue; // taken away meanwhile
      plot.veil.clear();
      plot.chart.update({ t, unit, rough, series: parts.map(([part, values], k) =>
        ({ name: part === "value" ? "measured" : part, values, colour: `--effect-${k % 8}` })) });
    }
    this.window();
  }

  channelBox(name) {
    const close = h("button", { type: "button", class: "small quiet stack-close", "aria-label": `Take ${name} away`, text: "Take away",
      onclick: () => {
        kept.channels.splice(kept.channels.indexOf(name), 1);
        this.plots.get(name)?.chart.destroy();
        this.plots.delete(name);
        box.remove();
      } });
    const box = h("section", { class: "panel stack", "aria-label": `channel ${name}` }, close);
    this.channels.append(box);
    const chart = timeChart(box, { t: new Float32Array(0), series: [], title: name, sync: SYNC, height: 130, onZoom: this.onZoom,
      testid: `chart-channel-${name}` });
    return { box, chart, veil: veil(box) };
  }

  close() {
    this.turn += 1;
    this.reading?.abort();
    for (const stack of this.stacks.values()) stack.destroy();
    for (const plot of this.plots.values()) plot.chart.destroy();
  }
}
