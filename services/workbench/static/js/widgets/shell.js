/** The bar of work at the foot of the page, and messages. */

import { h } from "./dom.js";

const DOING = {
  choose: "Making the model",
  compare: "Comparing model and measurement",
  where: "Looking where it fails",
  diagnose: "Looking for what is missing",
  preview: "Fitting with",
  add: "Adding",
  remove: "Removing",
  undo: "Going back",
  goto: "Going to a version",
  next: "Looking for the next run",
  report: "Writing the report",
  decode: "Decoding",
  examples: "Bringing in the example runs",
};

/**
 * What a job does, in words.
 * @param {Object} job
 * @returns {string}
 */
export function doing(job) {
  const of = job.args?.effect ?? job.args?.name ?? job.args?.run ?? "";
  return `${DOING[job.do] ?? job.do}${typeof of === "string" && of ? ` ${of}` : ""}`;
}

/** Share of the whole work that is done, or of the parts that are counted; null where nothing is known. */
function part(job) {
  return job.share ?? (job.total ? Math.min(1, job.done / job.total) : null);
}

/** Share done and time left, which runs down between two events; else the seconds since it began, also when overdue. */
function timeOf(job) {
  const since = (Date.now() - job.heard) / 1000;
  const seconds = `${Math.floor((job.elapsed ?? 0) + since)} s`;
  if (job.share === null || job.share === undefined) return seconds;
  if (job.overdue) return `${seconds} so far, longer than planned`;
  const share = `${Math.round(100 * job.share)} %`;
  if (job.remaining === null || job.remaining === undefined) return `${share} in ${seconds}`;
  const wait = Math.max(1, Math.round(job.remaining - since));
  return `${share} in ${seconds}, about ${wait < 100 ? `${wait} s` : `${(wait / 60).toFixed(wait < 600 ? 1 : 0)} min`} left`;
}

/**
 * The bar: always there and always as high, so that nothing moves when work begins. It shows the server's jobs.
 * @param {HTMLElement} root
 * @param {{cancel: (id: number) => void, again: (job: Object) => void}} act
 * @returns {{jobs: (all: Object[]) => void, job: (job: Object) => void, link: (up: boolean) => void,
 *   study: (study: Object) => void, say: (words: string) => void}}
 */
export function createJobBar(root, { cancel, again }) {
  const text = h("span", { class: "job-text", role: "status", text: "Nothing is running." });
  const time = h("span", { class: "job-time num", "data-testid": "job-time" });
  const meter = h("progress", { class: "job-meter", max: "1", value: 0, "aria-label": "progress of the work" });
  const small = (testid, words, onclick) => h("button", { type: "button", class: "small", "data-testid": testid, onclick, text: words });
  const button = small("job-cancel", "Cancel", () => present() && cancel(present().id));
  const restart = small("job-again", "Start again", () => lost().forEach(again));
  const dismiss = small("job-dismiss", "Dismiss", () => lost().forEach((job) => cancel(job.id)));
  const state = h("span", { class: "job-state", role: "status", "aria-live": "polite" });
  const note = h("span", { class: "job-note" });
  root.setAttribute("data-testid", "job-bar");
  root.append(state, text, time, meter, button, restart, dismiss, note);
  const open = new Map(); // jobs that wait, run or were lost, by number
  const over = new Set();
  let said = "";
  let last = null;
  let up = true;
  let other = false;
  let warnings = [];

  const inState = (...states) => [...open.values()].filter((job) => states.includes(job.state));
  const present = () => inState("running")[0] ?? inState("waiting")[0] ?? null;
  const lost = () => inState("lost");

  function tick() {
    const job = present();
    time.textContent = up && job?.state === "running" ? timeOf(job) : "";
  }

  /** What is shown, in words: state of the bar, what it is about, what is to say of it. */
  function words() {
    const job = present();
    if (!up) return ["down", "No answer from the server", "Trying again. Is lacet ui still running?"];
    if (job) {
      const count = job.total && !/\d of \d/.test(job.text ?? "") ? ` (${job.done} of ${job.total})` : "";
      const more = inState("running", "waiting").length - 1;
      const step = job.state === "waiting" ? "waits for its turn" : job.text || "at work";
      return [job.state, doing(job), `${step}${count}${more ? `; ${more} more waiting` : ""}`];
    }
    if (lost().length) return ["lost", "Lost when the server ended", lost().map(doing).join("; ")];
    if (said) return ["idle", "Ready", said];
    if (!last) return ["idle", "Ready", "Nothing is running."];
    const ended = { done: "done", failed: "failed", cancelled: "cancelled" }[last.state];
    return [last.state === "failed" ? "failed" : "idle", `${doing(last)}: ${ended}`, last.state === "failed" ? (last.error ?? "") : ""];
  }

  function draw() {
    const job = present();
    const [kind, about, says] = words();
    tick();
    root.dataset.state = kind;
    state.textContent = about;
    text.textContent = text.title = says;
    button.hidden = kind === "lost";
    button.disabled = !up || !job;
    restart.hidden = dismiss.hidden = kind !== "lost";
    // work without a plan shows its seconds; a bar that only swings says nothing and costs a processor's time
    meter.classList.toggle("unseen", !up || !job || part(job) === null);
    meter.value = (job && part(job)) ?? 0;
    note.textContent = note.title = other
      ? "Another program is writing to this study. If none is and this message stays, remove the file .writing from its folder."
      : warnings.join("; ");
    note.classList.toggle("bad", other);
  }

  /** Takes over what the server says of a job. */
  function take(job) {
    if (over.has(job.id)) return; // a late event of work that is done
    job.heard = Date.now();
    if (["running", "waiting", "lost"].includes(job.state)) open.set(job.id, job);
    else {
      over.add(job.id);
      open.delete(job.id);
    }
  }

  draw();
  setInterval(tick, 1000);
  return {
    /** All that the server has open, at every connection: nothing else is at work. */
    jobs(all) {
      open.clear();
      for (const job of all) take(job);
      draw();
    },
    job(job) {
      const dismissed = open.get(job.id)?.state === "lost";
      take(job);
      said = "";
      last = open.has(job.id) || dismissed ? null : job;
      draw();
    },
    /** What came of the last work, in a sentence; it stays until other work begins. */
    say(sentence) {
      said = sentence;
      draw();
    },
    link(now) {
      if (now === up) return;
      up = now;
      draw();
    },
    study(study) {
      other = Boolean(study.other_writer);
      warnings = study.warnings ?? [];
      draw();
    },
  };
}

/**
 * Messages: errors over the page, until they are closed; everything else in the bar, where it hides nothing.
 * @param {HTMLElement} root
 * @param {(text: string) => void} say
 * @returns {(text: string, kind?: "good"|"error"|"note") => void}
 */
export function createToasts(root, say) {
  return (text, kind = "note") => {
    if (kind !== "error") {
      say(text);
      return;
    }
    if ([...root.children].some((t) => t.dataset.text === text)) return;
    const close = h("button", {
      type: "button",
      class: "small quiet",
      "aria-label": "Close this message",
      text: "Close",
      onclick: () => box.remove(),
    });
    const box = h("div", { class: "toast error", role: "alert", data: { text } }, h("span", { text }), close);
    root.append(box);
  };
}
