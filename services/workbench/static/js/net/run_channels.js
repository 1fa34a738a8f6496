/** Measured channels of a run: their overview, which is there at once, then all samples. */

import { binary } from "./api.js";

// The server reads a file to its end though nobody waits for it any more: more channels may be asked for at once [ms].
const SETTLE = 100;

/**
 * Reads channels in one request; where the answer is an overview, their samples in a second one.
 * @param {string} run
 * @param {string[]} names
 * @param {(found: Map<string, {t: Float32Array, parts: Array<[string, Float32Array]>, unit: string, rough: boolean}>) => void} take
 *   is called once or twice. `rough`: the values are the lowest and the highest of each block of samples in turn.
 * @param {AbortSignal} [signal] of a view that is closed, or shows another run
 */
export async function readChannels(run, names, take, signal) {
  const found = await ask(run, names, false, signal);
  take(found);
  const rough = names.filter((name) => found.get(name).rough);
  if (!rough.length) return;
  await new Promise((done) => setTimeout(done, SETTLE));
  take(await ask(run, rough, true, signal));
}

async function ask(run, names, samples, signal) {
  const list = names.map(encodeURIComponent).join(",");
  const { meta, arrays } = await binary(`api/channels/${encodeURIComponent(run)}?names=${list}&samples=${samples}`, signal);
  return new Map(Object.entries(meta.channels).map(([name, { t, parts, unit, block }]) => [name,
    { t: arrays[t], parts: Object.entries(parts).map(([part, array]) => [part, arrays[array]]), unit, rough: block > 1 }]));
}
