/** What the model with one more effect does: fitted anew by a job, asked for once, shared by card and preview. */

import { needing } from "../widgets/pending.js";

const MOST = 60;

/**
 * @param {Object} app
 * @returns {{of: (version: number, effect: string, say: (text: string, share: number|null) => void, signal: AbortSignal) =>
 *   Promise<{meta: Object, arrays: Object<string, Float32Array>}>}} `signal` : the answer is not wanted any more; a fit that
 *   nobody waits for is cancelled
 */
export function createEffectPreviews(app) {
  const kept = new Map(); // path → {found, places, stop}: the answer or what will be one, and who waits for it

  /** A ranking takes minutes: asking for a preview must never start one. */
  async function ask(path) {
    try {
      return await app.api.binary(path);
    } catch (cause) {
      if (cause.needs !== "diagnose") throw cause;
      throw new Error("Look for what is missing first: this version is not ranked.");
    }
  }

  function begin(path, version, effect) {
    const entry = { places: new Set(), stop: new AbortController(), said: null };
    const say = (text, share) => {
      entry.said = [text, share];
      for (const place of entry.places) place(text, share);
    };
    entry.found = needing(app, () => ask(path), { version, effect }, { say }, entry.stop.signal);
    const forget = () => kept.get(path) === entry && kept.delete(path);
    entry.stop.signal.addEventListener("abort", forget);
    entry.found.then(() => { entry.done = true; }, forget);
    if (kept.size > MOST) kept.delete(kept.keys().next().value);
    kept.set(path, entry);
    return entry;
  }

  return {
    of(version, effect, say, signal) {
      const path = `api/preview/${version}/${encodeURIComponent(effect)}`;
      const entry = kept.get(path) ?? begin(path, version, effect);
      if (entry.done) return entry.found;
      entry.places.add(say);
      if (entry.said) say(...entry.said);
      signal.addEventListener("abort", () => {
        entry.places.delete(say);
        if (!entry.places.size && !entry.done) entry.stop.abort();
      }, { once: true });
      return entry.found;
    },
  };
}
