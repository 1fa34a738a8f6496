/** Long work: started, followed by events, cancelled. */

import * as api from "./api.js";

const OVER = new Set(["done", "failed", "cancelled"]);
const AGAIN = 2000; // asks for a job's state when no event came, for instance through a proxy that holds events back [ms]

/** A job that was cancelled: not an error worth a message. */
export class Cancelled extends Error {}

/**
 * Follows the server's events and the jobs started here.
 * @param {{onJob: (job: Object) => void, onStudy: () => void, onLive: (live: Object) => void,
 *          onLink: (up: boolean) => void}} hear
 */
export function createJobs(hear) {
  const waiting = new Map();
  let source = null;
  let lost = false;

  function open() {
    source = new EventSource("api/events");
    source.addEventListener("job", (e) => take(JSON.parse(e.data)));
    source.addEventListener("study", () => hear.onStudy());
    source.addEventListener("live", (e) => hear.onLive(JSON.parse(e.data)));
    source.onopen = () => {
      if (lost) hear.onStudy(); // something may have happened meanwhile
      lost = false;
      hear.onLink(true);
    };
    source.onerror = () => {
      lost = true;
      hear.onLink(false);
      // a browser gives up for good when the server answered with an error: try again ourselves
      if (source.readyState === EventSource.CLOSED) setTimeout(open, AGAIN);
    };
  }

  function take(job) {
    hear.onJob(job);
    const entry = waiting.get(job.id);
    if (!entry) return;
    entry.heard = Date.now();
    entry.onProgress?.(job);
    if (OVER.has(job.state)) void finish(job.id, entry);
  }

  async function finish(id, entry) {
    if (entry.over) return;
    entry.over = true;
    clearInterval(entry.timer);
    waiting.delete(id);
    try {
      const job = await api.get(`api/jobs/${id}`);
      if (job.state === "done") entry.resolve(job.result ?? null);
      else if (job.state === "cancelled") entry.reject(new Cancelled("cancelled"));
      else entry.reject(new Error(job.error || "the work failed and gave no reason"));
    } catch (cause) {
      entry.reject(cause);
    }
  }

  async function load(id, entry) {
    if (entry.over || Date.now() - entry.heard < AGAIN) return;
    try {
      const job = await api.get(`api/jobs/${id}`);
      if (!entry.over) take(job); // an event may have overtaken this answer
    } catch (cause) {
      if (cause.status === 404) {
        entry.over = true;
        clearInterval(entry.timer);
        waiting.delete(id);
        entry.reject(new Error("The server was started anew and does not know this work any more: start it again."));
      }
    }
  }

  /**
   * Follow a job to its end.
   * @param {string|number} id
   * @param {{onProgress?: (job: Object) => void}} [options]
   * @returns {Promise<any>} its result; rejects with Cancelled, or Error in the server's words
   */
  function follow(id, { onProgress } = {}) {
    return new Promise((resolve, reject) => {
      const entry = { resolve, reject, onProgress, heard: 0, over: false, timer: 0 };
      entry.timer = setInterval(() => void load(id, entry), AGAIN / 2);
      waiting.set(id, entry);
      void load(id, entry); // it may be over before the first event
    });
  }

  /**
   * Start a job and follow it.
   * @param {string} name what to do
   * @param {Object} [args]
   * @param {{onProgress?: (job: Object) => void}} [options]
   * @returns {Promise<any>}
   */
  async function run(name, args = {}, options = {}) {
    const answer = await api.post("api/jobs", { do: name, args });
    return follow(jobId(answer), options);
  }

  /** @param {string|number} id @returns {Promise<any>} */
  function cancel(id) {
    return api.remove(`api/jobs/${id}`);
  }

  open();
  return { run, follow, cancel };
}

/** @param {Object} answer of a request that started a job @returns {string|number} */
export function jobId(answer) {
  const job = answer.job ?? answer;
  return typeof job === "object" ? job.id : job;
}
