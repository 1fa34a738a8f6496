/** What the model with one more effect does: fitted anew by a job, asked for once, shared by card and preview. */

import { needing } from "../widgets/pending.js";

const MOST = 60;

/**
 * @param {Object} app
 * @returns {{of: (version: number, effect: string, say: (text: string, share: number|null) => void) =>
 *   Promise<{meta: Object, arrays: Object<string, Float32Array>}>}}
 */
export function createEffectPreviews(app) {
  const kept = new Map();

  /** A ranking takes minutes: asking for a preview must never start one. */
  async function ask(path) {
    try {
      return await app.api.binary(path);
    } catch (cause) {
      if (cause.needs !== "diagnose") throw cause;
      throw new Error("Look for what is missing first: this version is not ranked.");
    }
  }

  return {
    of(version, effect, say) {
      const path = `api/preview/${version}/${encodeURIComponent(effect)}`;
      if (kept.has(path)) return kept.get(path);
      const found = needing(app, () => ask(path), { version, effect }, { say });
      if (kept.size > MOST) kept.delete(kept.keys().next().value);
      kept.set(path, found);
      found.catch(() => kept.delete(path));
      return found;
    },
  };
}
