// Colour scales that hold for every kind of colour vision: lightness rises or falls with the value throughout.

import { isDark } from "./colours.js";

/** Error ÷ floor where the colours begin, and where they end at least and at most. */
const LEAST = 0.5;
const MOST = 5;
const UTMOST = 50;
const QUIET = 0.05; // part of the colours for what is below its floor: noise must not draw the eye

// After magma (Smith and van der Walt): light is little on a light page, dark is little on a dark one.
const LIGHT = ["#fbfaea", "#fde7b0", "#fec98d", "#fd9567", "#f1605d", "#cd3f71", "#9e2f7f", "#721f81", "#440f76"];
const DARK = ["#1c1a26", "#3a1260", "#721f81", "#9e2f7f", "#cd3f71", "#f1605d", "#fd9567", "#fec98d", "#fcfdbf"];
const LIGHT_ENDS = ["#2166ac", "#67a9cf", "#d1e5f0", "#f7f7f7", "#fddbc7", "#ef8a62", "#b2182b"];
const DARK_ENDS = ["#9ecbff", "#4f93d8", "#2a4d73", "#23272e", "#6b3f22", "#d07a35", "#ffc38a"];
const VIRIDIS = ["#440154", "#46327e", "#365c8d", "#277f8e", "#1fa187", "#4ac16d", "#a0da39", "#fde725"];

/**
 * Colours of error ÷ floor: logarithmic above 1, nearly one colour below.
 * @param {number} largest the largest ratio there is: the scale reaches so far, within MOST and UTMOST.
 * @returns {{colour: (ratio: number) => string, ink: (ratio: number) => string, part: (ratio: number) => number,
 *   low: number, high: number, ticks: number[], at: (part: number) => string}}
 */
export function ratioScale(largest) {
  const high = Math.max(MOST, Math.min(UTMOST, largest || MOST));
  const stops = (isDark() ? DARK : LIGHT).map(rgb);
  const part = (ratio) => clamp(ratio <= 1 ? (QUIET * Math.log(ratio / LEAST)) / Math.log(1 / LEAST)
    : QUIET + ((1 - QUIET) * Math.log(ratio)) / Math.log(high));
  const at = (p) => css(between(stops, p));
  return {
    low: LEAST, high, part, at,
    colour: (ratio) => at(part(ratio)),
    ink: (ratio) => inkOn(between(stops, part(ratio))),
    ticks: [1, 2, 5, 10, 20, 50].filter((k) => k <= high * 1.0001),
  };
}

/**
 * Colours of a signed quantity about zero.
 * @param {number} size largest magnitude
 */
export function signedScale(size) {
  const stops = (isDark() ? DARK_ENDS : LIGHT_ENDS).map(rgb);
  const at = (p) => css(between(stops, clamp(p)));
  return { low: -size, high: size, at, colour: (value) => at(0.5 + (0.5 * value) / size),
    ink: (value) => inkOn(between(stops, clamp(0.5 + (0.5 * value) / size))) };
}

/** Colours of a quantity from one end to another. */
export function plainScale(low, high) {
  const stops = VIRIDIS.map(rgb);
  const at = (p) => css(between(stops, clamp(p)));
  return { low, high, at, colour: (value) => at((value - low) / (high - low)),
    ink: (value) => inkOn(between(stops, clamp((value - low) / (high - low)))) };
}

/** One colour a phase, the same in every picture, as the reports have them. */
export const PHASES = {
  "standing": "#8c8c8c", "straight, steady": "#d0d3d8", "accelerating": "#4c9f70", "braking": "#c1443c",
  "lift-off": "#e09f3e", "cornering left": "#2e86ab", "cornering right": "#8ecae6", "accelerating in a bend": "#2a6f4e",
  "braking in a bend": "#7f1d1d", "lift-off in a bend": "#a36a12", "steering": "#8e6bbf", "rough road": "#6b4a2f",
};

function clamp(part) {
  return Math.max(0, Math.min(1, part));
}

function rgb(hex) {
  return [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16));
}

function between(stops, part) {
  const place = part * (stops.length - 1);
  const k = Math.min(stops.length - 2, Math.floor(place));
  return stops[k].map((v, i) => Math.round(v + (stops[k + 1][i] - v) * (place - k)));
}

function css([r, g, b]) {
  return `rgb(${r}, ${g}, ${b})`;
}

/** Black or white, whichever has the higher contrast on a colour. */
function inkOn(colour) {
  const [r, g, b] = colour.map((v) => {
    const part = v / 255;
    return part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4;
  });
  return 0.2126 * r + 0.7152 * g + 0.0722 * b > 0.179 ? "#000" : "#fff";
}
