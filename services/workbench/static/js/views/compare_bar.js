/** The bar of Compare: run and row, what is drawn beneath and over them, cursors, XY plot, and what is saved. */

import { h } from "../widgets/dom.js";
import { times } from "../widgets/format.js";
import { runName } from "../net/state.js";

/**
 * @param {object} act what each control does: `run`, `row`, `step`, `beneath`, `channel`, `formula`, `part`, `whole`, `cursors`, `xy`, `save`
 * @param {HTMLElement} overlays the select of overlays
 */
export function compareBar(act, overlays) {
  const option = (value, text) => h("option", { value, text });
  const select = (label, testid, first, onchange) => h("select", { class: first ? "more" : "", "aria-label": label, "data-testid": testid,
    onchange: (e) => onchange(e.target.value) }, first ? option("", first) : null);
  const run = select("run", "compare-run", "", act.run);
  const row = select("row", "row-select", "", act.row);
  const more = select("add a row beneath", "beneath-select", "+ row …", act.beneath);
  const channel = select("add a channel beneath", "channel-select", "+ channel …", act.channel);
  const step = (by, text, label) => h("button", { type: "button", class: "step", text, "aria-label": label, title: label, onclick: () => act.step(by) });
  const formula = h("input", { type: "text", class: "formula", placeholder: "+ formula …", "aria-label": "add a formula in the states beneath",
    title: "for instance travel_fl - travel_fr: states as in an own effect, wheels by name: travel_fl, rate_rr, ay, speed, lag(ay, 0.1 s)", "data-testid": "formula",
    onkeydown: (e) => {
      if (e.key !== "Enter" || !formula.value.trim()) return;
      act.formula(formula.value.trim().replaceAll("−", "-").replaceAll(";", ""));
      formula.value = "";
    } });
  const check = (key, text, title) => {
    const input = h("input", { type: "checkbox", "data-testid": `compare-${key}`, onchange: () => act.part(key, input.checked) });
    return [h("label", { class: "check", title }, input, text), input];
  };
  const [shares, sharesBox] = check("shares", "Shares", "the share of each effect");
  const [centred, centredBox] = check("centred", "About means", "shares without their mean: what static loads hide");
  const [cursors, cursorsBox] = check("cursors", "Cursors", "two cursors, and what every curve does between them");
  const [xy, xyBox] = check("xy", "XY", "any curve over any other");
  const whole = h("button", { type: "button", class: "small", text: "Whole run", title: "Show the whole run (double click, or 0)", disabled: true, onclick: act.whole });
  const save = select("save what is shown", "compare-save", "Save …", (kind) => {
    save.value = "";
    if (kind) act.save(kind);
  });
  for (const [kind, text] of [["png", "picture, PNG"], ["svg", "picture, SVG"], ["csv", "numbers, CSV"]]) save.append(option(kind, text));
  const element = h("div", { class: "bar compare-bar" }, run, step(-1, "↑", "the row before"), row, step(1, "↓", "the row after"),
    more, channel, overlays, formula, shares, centred, cursors, xy, whole, save);

  return {
    element,
    /** Choices of a version's runs and of a run's rows. */
    choices({ version, state, layout, rows }) {
      const group = (label, runs) => (runs.length ? h("optgroup", { label }, runs.map((r) => option(runName(r), runName(r)))) : null);
      run.replaceChildren(...[group("used for the fit", version.used ?? []), group("held out", version.held ?? [])].filter(Boolean));
      run.value = state.run;
      row.replaceChildren(...rows.map((s) => option(s.row, `${s.row}: ${times(s.ratio)}`)));
      row.value = state.row;
      more.replaceChildren(option("", "+ row …"), ...rows.filter((s) => s.row !== state.row && !layout.rows.includes(s.row)).map((s) => option(s.row, s.row)));
      sharesBox.checked = layout.shares;
      centredBox.checked = layout.centred;
      cursorsBox.checked = layout.cursors;
      xyBox.checked = Boolean(layout.xy);
    },
    channels(list) {
      channel.replaceChildren(option("", "+ channel …"), ...list.map((c) => option(c.name, `${c.name}${c.unit ? ` [${c.unit}]` : ""}`)));
    },
    whole: (yes) => {
      whole.disabled = yes;
    },
  };
}
