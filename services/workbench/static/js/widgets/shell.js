/** The bar of work at the foot of the page, and messages. */

import { h } from "./dom.js";

const DOING = {
  choose: "Making the model",
  compare: "Comparing model and measurement",
  where: "Looking where it fails",
  diagnose: "Looking for what is missing",
  add: "Adding an effect",
  remove: "Taking an effect out",
  undo: "Going back",
  goto: "Going to a version",
  next: "Looking for the next run",
  report: "Writing the report",
  decode: "Decoding a capture",
};

/**
 * What a job does, in words.
 * @param {Object} job
 * @returns {string}
 */
export function doing(job) {
  const of = job.args?.effect ?? job.args?.name ?? job.args?.run ?? "";
  return `${DOING[job.do] ?? job.do}${typeof of === "string" && of ? `: ${of}` : ""}`;
}

/** Share of the whole work that is done, or of the parts that are counted; null where nothing is known. */
function part(job) {
  return job.share ?? (job.total ? Math.min(1, job.done / job.total) : null);
}

/** Share done and time left, which runs down between two events; else the seconds since it began. */
function timeOf(job, seconds) {
  if (job.share === null || job.share === undefined) return `${seconds} s`;
  const share = `${Math.round(100 * job.share)} %`;
  if (job.remaining === null || job.remaining === undefined) return share;
  const wait = Math.max(1, Math.round(job.remaining - (Date.now() - job.heard) / 1000));
  return `${share}, about ${wait < 100 ? `${wait} s` : `${(wait / 60).toFixed(wait < 600 ? 1 : 0)} min`} left`;
}

/**
 * The bar: always there and always as high, so that nothing moves when work begins.
 * @param {HTMLElement} root
 * @param {{cancel: (id: string) => void}} act
 * @returns {{job: (job: Object) => void, link: (up: boolean) => void, study: (study: Object) => void}}
 */
export function createJobBar(root, { cancel }) {
  const text = h("span", { class: "job-text", role: "status", text: "Nothing is running." });
  const time = h("span", { class: "job-time num" });
  const meter = h("progress", { class: "job-meter", max: "1", value: 0, "aria-label": "progress of the work" });
  const button = h("button", {
    type: "button",
    class: "small",
    "data-testid": "job-cancel",
    disabled: true,
    text: "Cancel",
  });
  const state = h("span", { class: "job-state", role: "status", "aria-live": "polite" });
  const note = h("span", { class: "job-note" });
  root.setAttribute("data-testid", "job-bar");
  root.append(state, text, time, meter, button, note);
  const running = new Map();
  const began = new Map();
  const over = new Set();
  let said = "";
  let last = null;
  let up = true;
  let other = false;
  let warnings = [];

  button.addEventListener("click", () => {
    const job = present();
    if (job) cancel(job.id);
  });

  function present() {
    const all = [...running.values()];
    return all.find((j) => j.state === "running") ?? all[0] ?? null;
  }

  function tick() {
    const job = present();
    const since = job && began.get(job.id);
    time.textContent = since && job.state === "running" ? timeOf(job, Math.floor((Date.now() - since) / 1000)) : "";
  }

  function draw(now) {
    last = now ?? null;
    const job = present();
    if (job && !began.has(job.id)) began.set(job.id, Date.now());
    tick();
    root.dataset.state = job ? job.state : last?.state === "failed" ? "failed" : "idle";
    button.disabled = !job;
    if (job) {
      const count = job.total && !/\d of \d/.test(job.text ?? "") ? ` (${job.done} of ${job.total})` : "";
      const behind = running.size > 1 ? `; ${running.size - 1} more waiting` : "";
      state.textContent = doing(job);
      text.textContent = `${job.state === "waiting" ? "waits for its turn" : job.text || "at work"}${count}${behind}`;
      // work without a plan shows its seconds; a bar that only swings says nothing and costs a processor's time
      meter.hidden = part(job) === null;
      meter.value = part(job) ?? 0;
    } else {
      meter.value = 0;
      if (said) {
        state.textContent = "Ready";
        text.textContent = said;
      } else if (last) {
        state.textContent = `${doing(last)}: ${{ done: "done", failed: "failed", cancelled: "cancelled" }[last.state]}`;
        text.textContent = last.state === "failed" ? (last.error ?? "") : "";
      } else {
        state.textContent = "Ready";
        text.textContent = "Nothing is running.";
      }
    }
    text.title = text.textContent;
    const warning = !up
      ? "No answer from the server: trying again. Is lacet ui still running?"
      : other
        ? "Another program is writing to this study. Does that stay and none is? Remove the file .writing of its folder."
        : warnings.length
          ? warnings.join("; ")
          : "";
    note.textContent = warning;
    note.title = warning;
    note.classList.toggle("bad", !up || other);
  }

  draw();
  setInterval(tick, 1000);
  return {
    job(job) {
      if (over.has(job.id)) return; // a late event of work that is done
      job.heard = Date.now();
      said = "";
      if (job.state === "running" || job.state === "waiting") running.set(job.id, job);
      else {
        over.add(job.id);
        running.delete(job.id);
        began.delete(job.id);
      }
      draw(job);
    },
    /** What came of the last work, in a sentence; it stays until other work begins. */
    say(words) {
      said = words;
      draw();
    },
    link(now) {
      if (now === up) return;
      up = now;
      draw(last);
    },
    study(study) {
      other = Boolean(study.other_writer);
      warnings = study.warnings ?? [];
      if (study.busy && !running.has(study.busy.id) && !over.has(study.busy.id)) running.set(study.busy.id, study.busy);
      draw(last);
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
