/** Where it fails: the residual map, phases, what is left to explain, what the error follows, restoring-force surfaces. */

import { needing, veil } from "../widgets/pending.js";
import { h } from "../widgets/dom.js";
import { residualMap } from "../charts/residual_map.js";
import { times } from "../widgets/format.js";
import { term } from "../widgets/terms.js";
import { surfaceMaps } from "../charts/restoring_surface.js";
import { rowPictures } from "./where_row.js";
import { explainableKey, explainableTable, phaseTable } from "./where_tables.js";

const AROUND = 2; // seconds shown on either side of a place of the map

/**
 * @param {HTMLElement} root
 * @param {object} app
 * @returns {Promise<() => void>} takes the view down
 */
export async function show(root, app) {
  if (!app.state.study?.exists) {
    root.append(h("p", { class: "notice", text: "There is no model yet: choose runs in the view Runs and make the model." }));
    return app.on((patch) => { if (patch.study?.exists) app.go("where"); });
  }
  const view = new WhereView(root, app);
  view.everything();
  const off = app.on((patch) => view.changed(patch));
  return () => {
    off();
    view.close();
  };
}

class WhereView {
  constructor(root, app) {
    this.app = app;
    this.turn = 0;
    this.found = null;
    this.version = null;
    this.says = h("p", { class: "where-says", role: "status", "data-testid": "where-says", text: " " });
    const panel = (name, title, key, note, ...children) => h("section", { class: `panel ${name}` },
      h("h2", null, title, term(app, key), note ? h("span", { class: "muted", text: note }) : null), ...children);
    const map = panel("where-map", "Residual map", "map", "every row over time, in units of its noise floor");
    this.phases = h("div", { class: "scroll" });
    this.left = h("div", { class: "scroll" });
    this.row = h("select", { "aria-label": "row", "data-testid": "where-row", onchange: () => app.set({ row: this.row.value }) });
    const own = panel("where-row", "What the error follows", "coherence", "");
    own.querySelector("h2").append(h("label", { class: "check row-choice" }, "Row", this.row));
    const what = this.kinds();
    const surfaces = panel("where-surfaces", "Restoring force over travel and rate", "surface", "mean over the runs used", what);
    const phases = panel("where-phases", "By phase of driving", "phase", "error ÷ floor, each phase over all runs", this.phases);
    const left = panel("where-left", "How much is left to explain", "left", "in blocks of 2 s that the prediction was not made from", explainableKey(), this.left);
    this.below = h("div", { class: "where-below" }, own, phases, left, surfaces);
    root.append(h("section", { class: "panel where-head" }, this.says), map, this.below);
    this.map = residualMap(map, { onPick: (place) => this.pick(place), rows: app.rows().length || 16 });
    this.pictures = rowPictures(own, app);
    this.surfaces = surfaceMaps(surfaces);
    this.mapVeil = veil(map);
    this.veil = veil(this.below);
  }

  kinds() {
    this.kind = "residual";
    const one = (value, text) => h("label", { class: "check" }, h("input", { type: "radio", name: "surface-kind", value,
      checked: value === this.kind, onchange: () => {
        this.kind = value;
        if (this.found) this.surfaces.update(this.found.surfaces, value, this.found.least_samples);
      } }), text);
    return h("div", { class: "bar", role: "radiogroup", "aria-label": "which surface" },
      one("residual", "What the model misses"), one("force", "The whole force"));
  }

  changed(patch) {
    if ("study" in patch || "version" in patch) {
      if (patch.study && !patch.study.exists) return;
      if (this.app.state.version !== this.version || "study" in patch) this.everything();
    } else if ("row" in patch) this.chosen();
    else if ("theme" in patch && this.found) this.tables();
  }

  everything() {
    if (!this.app.state.row) return; // a short address: the page is about to choose
    this.version = this.app.state.version;
    this.turn += 1;
    void this.drawMap(this.turn);
    void this.load(this.turn);
  }

  async drawMap(mine) {
    const slow = setTimeout(() => this.mapVeil.say("Reading the map …"), 150);
    try {
      const map = await needing(this.app, () => this.app.api.get(`api/map/${this.version}`), { version: this.version }, this.mapVeil);
      if (mine !== this.turn) return;
      this.mapVeil.clear();
      this.map.update(map, this.app.state.row);
    } catch (cause) {
      if (mine === this.turn) this.mapVeil.fail(cause, () => void this.drawMap(mine));
    } finally {
      clearTimeout(slow);
    }
  }

  async load(mine) {
    const slow = setTimeout(() => this.veil.say("Looking where the model fails …"), 150);
    try {
      const found = await needing(this.app, () => this.app.api.get(`api/where/${this.version}`), { version: this.version }, this.veil);
      if (mine !== this.turn) return;
      clearTimeout(slow);
      this.veil.clear();
      this.found = found;
      this.says.textContent = found.says;
      this.choices();
      this.surfaces.update(found.surfaces, this.kind, found.least_samples);
      this.tables();
      this.pictures.show(found, this.version, this.app.state.row);
    } catch (cause) {
      if (mine === this.turn) this.veil.fail(cause, () => void this.load(mine));
    } finally {
      clearTimeout(slow);
    }
  }

  choices() {
    const rows = Object.entries(this.found.rows).sort((a, b) => b[1] - a[1]);
    this.row.replaceChildren(...rows.map(([row, ratio]) => h("option", { value: row, text: `${row}  (${times(ratio)} × floor)` })));
    this.row.value = this.app.state.row;
  }

  tables() {
    const { row } = this.app.state;
    const choose = (name) => this.app.set({ row: name });
    this.phases.replaceChildren(phaseTable(this.found, row, choose));
    this.left.replaceChildren(Object.keys(this.found.left).length ? explainableTable(this.found, row, choose,
        { least: this.app.state.study.fails_above, errors: this.app.rows() })
      : h("p", { class: "muted", text: "The runs are too short to say how much is left to explain." }));
  }

  chosen() {
    const { row } = this.app.state;
    this.map.choose(row);
    if (!this.found) return;
    this.row.value = row;
    for (const tr of this.below.querySelectorAll("tr[aria-selected]")) {
      tr.setAttribute("aria-selected", String(tr.querySelector("th button")?.textContent === row));
    }
    this.pictures.show(this.found, this.version, row);
  }

  pick({ run, row, start, stop }) {
    this.app.go("compare", { run, row, t0: Math.max(0, start - AROUND), t1: stop + AROUND });
  }

  close() {
    this.turn += 1;
    this.map.destroy();
    this.pictures.destroy();
    this.surfaces.destroy();
  }
}
