/** Results that are long work: asked for, made by a job if they are not there yet, the job's words shown meanwhile. */

import { h } from "./dom.js";

const WORDS = {
  compare: "Comparing model and measurement", where: "Looking where the model fails", diagnose: "Ranking what could be missing",
  preview: "Fitting the model with it",
};
const going = new Map();

/**
 * Asks; where the server says that a job is needed first, does the job and asks again. One job serves all who wait for it.
 * @template T
 * @param {object} app
 * @param {() => Promise<T>} ask
 * @param {object} args of the job
 * @param {{say: (text: string, part: number|null) => void}} [place] shows the job's words
 * @param {AbortSignal} [signal] cancels the job, whoever else waits for it
 * @returns {Promise<T>}
 */
export async function needing(app, ask, args, place, signal) {
  try {
    return await ask();
  } catch (cause) {
    if (!cause.needs || signal?.aborted) throw cause;
    await job(app, cause.needs, args, place, signal);
    return ask();
  }
}

async function job(app, name, args, place, signal) {
  const key = `${name} ${JSON.stringify(args)}`;
  let entry = going.get(key);
  if (!entry) {
    entry = { places: new Set(), last: null };
    entry.over = app.api.run(name, args, {
      signal,
      onProgress: (state) => {
        entry.last = state;
        for (const one of entry.places) show(one, name, state);
      },
    }).finally(() => going.delete(key));
    going.set(key, entry);
  }
  if (place) {
    entry.places.add(place);
    show(place, name, entry.last);
  }
  try {
    await entry.over;
  } finally {
    entry.places.delete(place);
  }
}

function show(place, name, state) {
  const words = state?.state === "waiting" ? "waits for other work" : state?.text;
  place.say(`${WORDS[name] ?? name}${words ? `: ${words}` : " …"}`, state?.share ?? (state?.total ? state.done / state.total : null));
}

/**
 * A box over a picture that is still being made. It takes no room, so that nothing moves when the picture comes.
 * @param {HTMLElement} box has a position of its own
 * @returns {{say: (text: string, part?: number|null) => void, fail: (cause: Error, again?: () => void) => void,
 *   clear: () => void}}
 */
export function veil(box) {
  const text = h("p", { class: "veil-text", role: "status" });
  const meter = h("progress", { class: "veil-meter", max: "1", "aria-label": "progress" });
  const again = h("button", { type: "button", class: "small", text: "Try again" });
  const element = h("div", { class: "veil", hidden: true }, h("div", { class: "veil-inner" }, text, meter, again));
  box.append(element);
  let retry = null;
  again.addEventListener("click", () => retry?.());
  return {
    say(words, part = null) {
      element.hidden = false;
      element.classList.remove("bad");
      text.textContent = words;
      meter.hidden = again.hidden = true;
      if (part !== null) {
        meter.hidden = false;
        meter.value = part;
      }
    },
    fail(cause, call) {
      element.hidden = false;
      meter.hidden = true;
      const stopped = cause?.constructor?.name === "Cancelled" || cause?.message === "cancelled";
      element.classList.toggle("bad", !stopped);
      text.textContent = stopped ? "Cancelled." : cause?.message ?? String(cause);
      retry = call ?? null;
      again.hidden = !call;
    },
    clear() {
      element.hidden = true;
    },
  };
}
