/** Numbers, times and names as an engineer reads them. */

/**
 * A value to the decimal place of the second significant digit of its interval's half-width, as services/render/intervals.py
 * writes it for the command line; to five significant digits without an interval.
 * @param {number|null} value
 * @param {number|null} [half] half of its 95 % interval
 * @returns {string}
 */
export function number(value, half) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (half !== null && half !== undefined && half > 0 && Number.isFinite(half)) {
    const place = Math.min(12, 1 - Number(half.toExponential(1).split("e")[1]));
    const step = 10 ** -place;
    const rounded = place < 0 ? Math.round(value / step) * step : Number(value.toFixed(place));
    return minus((rounded + 0).toFixed(Math.max(0, place)));
  }
  return minus(short(value, 5));
}

/**
 * A value to so many significant digits, without an exponent where it can be avoided.
 * @param {number} value
 * @param {number} [digits]
 * @returns {string}
 */
export function short(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return minus(value.toExponential(Math.max(0, digits - 1)).replace("e+", "e"));
  const decimals = Math.max(0, digits - 1 - Math.floor(Math.log10(size)));
  return minus(value.toFixed(decimals));
}

/**
 * Error ÷ noise floor, two decimals below 10, one below 100.
 * @param {number|null} ratio
 * @returns {string}
 */
export function times(ratio) {
  if (ratio === null || ratio === undefined || !Number.isFinite(ratio)) return "–";
  return ratio.toFixed(ratio < 9.995 ? 2 : ratio < 99.95 ? 1 : 0);
}

/** @param {number} part @returns {string} a fraction as a percentage */
export function percent(part) {
  if (part === null || part === undefined || !Number.isFinite(part)) return "–";
  const value = 100 * part;
  return `${minus(value.toFixed(Math.abs(value) < 9.95 ? 1 : 0))} %`;
}

/** @param {number} seconds @returns {string} */
export function duration(seconds) {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return "–";
  if (seconds < 60) return `${seconds.toFixed(1)} s`;
  return `${Math.floor(seconds / 60)} min ${String(Math.round(seconds % 60)).padStart(2, "0")} s`;
}

/** @param {number} bytes @returns {string} */
export function size(bytes) {
  if (!(bytes >= 0)) return "–";
  if (bytes < 1e6) return `${(bytes / 1e3).toFixed(0)} kB`;
  if (bytes < 1e9) return `${(bytes / 1e6).toFixed(1)} MB`;
  return `${(bytes / 1e9).toFixed(2)} GB`;
}

/** @param {string} text @returns {string} with a true minus sign */
export function minus(text) {
  return text.replace(/(^|[^0-9A-Za-z])-(?=[0-9.])/g, "$1−").replace(/e-/g, "e−");
}
