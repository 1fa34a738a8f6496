/** What is chosen: study, version, run, row, time window. The choice is also in the address, so that a reload keeps it. */

const IN_ADDRESS = ["run", "row", "t0", "t1"];
/** What the view Compare shows beside the chosen row (compare_layout.js); in its own address only. */
export const LAYOUT = ["rows", "channels", "formulas", "over", "xy", "a", "b", "without"];
const NUMBERS = new Set(["t0", "t1", "a", "b"]);

const inAddress = (view) => (view === "compare" ? [...IN_ADDRESS, ...LAYOUT] : IN_ADDRESS);

/**
 * The state and its listeners.
 * @returns {{state: Object, set: (patch: Object) => void, on: (listener: (patch: Object) => void) => (() => void),
 *            notify: (patch: Object) => void}}
 */
export function createState() {
  const state = { study: null, version: null, run: null, row: null, t0: null, t1: null, cursor: null };
  for (const key of LAYOUT) state[key] = null;
  const listeners = new Set();

  function notify(patch) {
    for (const listener of [...listeners]) listener(patch);
  }

  function set(patch) {
    const changed = Object.fromEntries(Object.entries(patch).filter(([key, value]) => state[key] !== value));
    if (!Object.keys(changed).length) return;
    Object.assign(state, changed);
    notify(changed);
  }

  function on(listener) {
    listeners.add(listener);
    return () => listeners.delete(listener);
  }

  return { state, set, on, notify };
}

/**
 * View and choice from an address like `#/compare?run=sinus&row=roll`.
 * @param {string} hash
 * @returns {{view: string, patch: Object}}
 */
export function readHash(hash) {
  const [path, query] = hash.replace(/^#\/?/, "").split("?");
  const search = new URLSearchParams(query ?? "");
  const patch = {};
  for (const key of inAddress(path)) {
    const text = search.get(key);
    if (text === null || text === "") patch[key] = null;
    else if (!NUMBERS.has(key)) patch[key] = text;
    else patch[key] = Number.isFinite(Number(text)) ? Number(text) : null;
  }
  return { view: path, patch };
}

/**
 * The address of a view with the present choice.
 * @param {string} view
 * @param {Object} state
 * @returns {string}
 */
export function writeHash(view, state) {
  const search = new URLSearchParams();
  for (const key of inAddress(view)) {
    const value = state[key];
    if (value === null || value === undefined) continue;
    search.set(key, NUMBERS.has(key) ? String(Math.round(value * 1e3) / 1e3) : value);
  }
  const query = search.toString();
  return `#/${view}${query ? `?${query}` : ""}`;
}

/**
 * Rows of a version with their errors over all runs used and in the worst run, in the order of the equations.
 * @param {Object|null} study as /api/study gives it
 * @param {number|null} number of the version
 * @returns {Array<{row: string, unit: string, rms: number, floor: number, ratio: number, level: number, fails: boolean,
 *   worst: number, worst_run: string, worst_level: number}>}
 */
export function rowsOf(study, number) {
  return study?.versions?.find((v) => v.version === number)?.errors ?? [];
}

/**
 * Names of the study's runs, those used first.
 * @param {Object|null} study
 * @returns {string[]}
 */
export function runsOf(study) {
  return [...(study?.used ?? []), ...(study?.held ?? [])].map(runName);
}

/** @param {string|{name: string}} run file or name @returns {string} its name */
export function runName(run) {
  const text = typeof run === "string" ? run : run.name;
  return text.replace(/^.*[\\/]/, "").replace(/\.(mcap|parquet|csv|mf4)$/i, "");
}
