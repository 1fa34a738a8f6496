// Colours come from the style sheets, so that light, dark and their contrast are decided in one place.

const listeners = new Set();
let queued = false;

/**
 * A colour as canvas needs it.
 * @param {string} colour `--name` of a custom property, or any CSS colour.
 * @param {string} [otherwise] used where the property is not set.
 * @returns {string}
 */
export function resolved(colour, otherwise = "#888") {
  if (!colour || !colour.startsWith("--")) return colour || otherwise;
  return getComputedStyle(document.documentElement).getPropertyValue(colour).trim() || otherwise;
}

/**
 * The same colour, partly transparent.
 * @param {string} colour `#rgb`, `#rrggbb` or another CSS colour.
 * @param {number} alpha 0 to 1.
 */
export function faded(colour, alpha) {
  const found = resolved(colour);
  const hex = /^#([0-9a-f]{3}|[0-9a-f]{6})$/i.exec(found);
  if (!hex) return `color-mix(in srgb, ${found} ${Math.round(100 * alpha)}%, transparent)`;
  const full = hex[1].length === 3 ? [...hex[1]].map((c) => c + c).join("") : hex[1];
  const [r, g, b] = [0, 2, 4].map((k) => parseInt(full.slice(k, k + 2), 16));
  return `rgba(${r}, ${g}, ${b}, ${alpha})`;
}

/** Whether the page is dark now: the switch on the root element, otherwise what the system prefers. */
export function isDark() {
  const theme = document.documentElement.dataset.theme;
  if (theme === "dark" || theme === "light") return theme === "dark";
  return matchMedia("(prefers-color-scheme: dark)").matches;
}

/**
 * Calls back after the theme changed, by the page's switch or by the system.
 * @param {() => void} listener
 * @returns {() => void} takes the listener off.
 */
export function onTheme(listener) {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

function notify() {
  if (queued) return;
  queued = true;
  requestAnimationFrame(() => {
    queued = false;
    for (const listener of [...listeners]) listener();
  });
}

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", notify);
matchMedia("(prefers-contrast: more)").addEventListener("change", notify);
new MutationObserver(notify).observe(document.documentElement, { attributes: true, attributeFilter: ["data-theme", "class"] });
