// Ticks of axes and colour bars.

import { minus } from "../widgets/format.js";

/** As many decimals as the distance of the ticks needs. */
export function tick(value, step) {
  const size = Math.max(Math.abs(value), step);
  if (size >= 1e6 || step < 1e-5) return minus(value.toExponential(1).replace("e+", "e"));
  return minus(value.toFixed(Math.max(0, Math.min(8, -Math.floor(Math.log10(step * 1.0001) + 1e-9) + (odd(step) ? 1 : 0)))));
}

/** Whether a step such as 2.5 needs a digit more than its magnitude. */
function odd(step) {
  const lead = step / 10 ** Math.floor(Math.log10(step * 1.0001));
  return Math.abs(lead - Math.round(lead)) > 1e-6;
}

/**
 * Round places for ticks between two ends.
 * @returns {{values: number[], step: number}}
 */
export function ticks(low, high, most) {
  if (!(high > low)) return { values: [low], step: 1 };
  const raw = (high - low) / Math.max(1, most);
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find((k) => k * power >= raw * (1 - 1e-9));
  const values = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) values.push(k * step);
  return { values, step };
}
