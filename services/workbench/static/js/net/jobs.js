/** Long work: started, followed by events, cancelled. */

import * as api from "./api.js";

const OVER = new Set(["done", "failed", "cancelled"]);
const OPEN = new Set(["waiting", "running", "lost"]);
const AGAIN = 2000; // asks for a job's state when no event came, for instance through a proxy that holds events back [ms]

/** A job that was cancelled: not an error worth a message. */
export class Cancelled extends Error {}

/**
 * Follows the server's events and the jobs started here.
 * @param {{onJobs: (jobs: Object[]) => void, onJob: (job: Object) => void, onStudy: () => void,
 *          onLive: (live: Object) => void, onLiveFit: (fit: Object) => void, onLink: (up: boolean) => void}} hear `onJobs`: all that the server has open,
 *   in place of what was known before
 */
export function createJobs(hear) {
  const waiting = new Map();
  let source = null;
  let lost = false;

  function open() {
    source = new EventSource("api/events");
    source.addEventListener("hello", (e) => all(JSON.parse(e.data).jobs));
    source.addEventListener("job", (e) => take(JSON.parse(e.data)));
    source.addEventListener("study", (e) => {
      if (JSON.parse(e.data).missed) void again();
      hear.onStudy();
    });
    source.addEventListener("live", (e) => hear.onLive(JSON.parse(e.data)));
    source.addEventListener("live-fit", (e) => hear.onLiveFit(JSON.parse(e.data)));
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

  /** Every job that the server has open; one followed here that is not among them is over, or of an earlier server. */
  function all(jobs) {
    hear.onJobs(jobs);
    for (const job of jobs) take(job);
    const open = new Set(jobs.map((job) => job.id));
    for (const [id, entry] of waiting) {
      if (open.has(id)) continue;
      entry.heard = 0;
      void load(id, entry);
    }
  }

  /** Events were lost on the way: asks for what they said. */
  async function again() {
    try {
      all((await api.get("api/jobs")).filter((job) => OPEN.has(job.state)));
    } catch {
      // no answer: the next connection begins with all jobs
    }
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
        entry.reject(new Error("The server was started anew and this work was lost: start it again."));
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
   * @param {{onProgress?: (job: Object) => void, signal?: AbortSignal}} [options] `signal` cancels it
   * @returns {Promise<any>}
   */
  async function run(name, args = {}, { signal, ...options } = {}) {
    const id = jobId(await api.post("api/jobs", { do: name, args }));
    const stop = () => void cancel(id).catch(() => {}); // it may be over
    if (signal?.aborted) stop();
    else signal?.addEventListener("abort", stop, { once: true });
    return follow(id, options).finally(() => signal?.removeEventListener("abort", stop));
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
