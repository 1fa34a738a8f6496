/** Other versions and runs drawn over the chosen ones, without making them the present ones. */

import { h } from "../widgets/dom.js";
import { runName } from "../net/state.js";

const FIRST_COLOUR = 2; // the palette's colours before it are near those of measured and modelled
const COLOURS = 6;
export const MOST = 4;

/** @param {number} k which overlay @returns {string} its colour */
export const colourOf = (k) => `--effect-${FIRST_COLOUR + (k % COLOURS)}`;

/** Name of an overlay beside the present choice. */
export function named({ version, run }) {
  return [version !== null ? `version ${version}` : "", run !== null ? `run ${run}` : ""].filter(Boolean).join(", ");
}

/**
 * The select that adds overlays, and a mark for each that takes it off.
 * @param {{add: (overlay: object) => void, remove: (k: number) => void}} act
 * @returns {{select: HTMLElement, chips: HTMLElement, update: (study: object, state: object, overlays: object[]) => void}}
 */
export function overlayPicker({ add, remove }) {
  const select = h("select", { class: "more", "aria-label": "draw a version or run over this one", "data-testid": "overlay-select",
    onchange: () => {
      if (select.value) add(JSON.parse(select.value));
    } });
  const chips = h("div", { class: "bar overlays", "data-testid": "overlays" });
  const option = (overlay, text) => h("option", { value: JSON.stringify(overlay), text });

  function update(study, state, overlays) {
    const there = new Set(overlays.map((one) => JSON.stringify(one)));
    const free = (one) => !there.has(JSON.stringify(one));
    const versions = study.versions.filter((v) => v.version !== state.version)
      .map((v) => [{ version: v.version, run: null }, `version ${v.version}: ${v.note}`]).filter(([one]) => free(one));
    const present = study.versions.find((v) => v.version === state.version);
    const runs = [...(present?.used ?? []), ...(present?.held ?? [])].map(runName).filter((r) => r !== state.run)
      .map((r) => [{ version: null, run: r }, r]).filter(([one]) => free(one));
    const group = (label, items) => (items.length ? h("optgroup", { label }, items.map(([one, text]) => option(one, text))) : null);
    select.replaceChildren(...[h("option", { value: "", text: "+ overlay …" }), group("this run, of", versions),
      group("this version, on run", runs)].filter(Boolean));
    select.value = "";
    select.disabled = overlays.length >= MOST || !(versions.length + runs.length);
    chips.replaceChildren(...overlays.map((one, k) => {
      const swatch = h("i", { class: "chart-swatch" });
      swatch.style.setProperty("--own", `var(${colourOf(k)})`);
      return h("button", { type: "button", class: "small chip-button", "aria-label": `Take the overlay ${named(one)} off`,
        onclick: () => remove(k) }, swatch, named(one), h("span", { "aria-hidden": "true", text: "×" }));
    }));
    chips.hidden = !overlays.length;
  }

  return { select, chips, update };
}

/**
 * Series of one time base on another, both from their first sample on; NaN where the other has none.
 * @param {ArrayLike<number>} t of the picture @param {ArrayLike<number>} other @param {ArrayLike<number>} values of `other`
 * @param {boolean} shift whether the two begin at different times, being different runs
 * @returns {Float32Array}
 */
export function onto(t, other, values, shift) {
  const by = shift && t.length && other.length ? other[0] - t[0] : 0;
  const out = new Float32Array(t.length).fill(NaN);
  const hole = other.length > 1 ? 2.5 * ((other[other.length - 1] - other[0]) / (other.length - 1)) : Infinity;
  let k = 0;
  for (let i = 0; i < t.length; i += 1) {
    const at = t[i] + by;
    while (k < other.length - 2 && other[k + 1] < at) k += 1;
    const [a, b] = [other[k], other[k + 1]];
    if (Math.abs(at - a) < 1e-4) out[i] = values[k];
    else if (at > a && at <= b + 1e-4 && b - a < hole) out[i] = values[k] + ((values[k + 1] - values[k]) * (at - a)) / (b - a);
  }
  return out;
}
