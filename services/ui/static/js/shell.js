/** The bar of work at the foot of the page, and messages. */

import { h } from "./dom.js";

const DOING = {
  choose: "Making the model", compare: "Comparing model and measurement", where: "Looking where it fails",
  diagnose: "Looking for what is missing", add: "Adding an effect", remove: "Taking an effect out", undo: "Going back",
  goto: "Going to a version", next: "Looking for the next run", report: "Writing the report", decode: "Decoding a capture",
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

/**
 * The bar: always there and always as high, so that nothing moves when work begins.
 * @param {HTMLElement} root
 * @param {{cancel: (id: string) => void}} act
 * @returns {{job: (job: Object) => void, link: (up: boolean) => void, study: (study: Object) => void}}
 */
export function createJobBar(root, { cancel }) {
  const text = h("span", { class: "job-text", text: "Nothing is running." });
  const time = h("span", { class: "job-time num" });
  const meter = h("progress", { class: "job-meter", max: "1", value: 0, "aria-label": "progress of the work" });
  const button = h("button", { type: "button", class: "small", "data-testid": "job-cancel", disabled: true, text: "Cancel" });
  const state = h("span", { class: "job-state", role: "status", "aria-live": "polite" });
  const note = h("span", { class: "job-note" });
  root.setAttribute("data-testid", "job-bar");
  root.append(state, text, time, meter, button, note);
  const running = new Map();
  const began = new Map();
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
    time.textContent = since && job.state === "running" ? `${Math.floor((Date.now() - since) / 1000)} s` : "";
  }

  function draw(last) {
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
      // work that cannot be counted shows its seconds; a bar that only swings says nothing and costs a processor's time
      meter.hidden = !job.total;
      meter.value = job.total ? Math.min(1, job.done / job.total) : 0;
    } else {
      meter.value = 0;
      if (last) {
        state.textContent = `${doing(last)}: ${{ done: "done", failed: "failed", cancelled: "cancelled" }[last.state]}`;
        text.textContent = last.state === "failed" ? last.error ?? "" : "";
      } else {
        state.textContent = "Ready";
        text.textContent = "Nothing is running.";
      }
    }
    const said = !up
      ? "No answer from the server: trying again. Is lacet ui still running?"
      : other ? "Another program is writing to this study." : warnings.length ? warnings.join("; ") : "";
    note.textContent = said;
    note.title = said;
    note.classList.toggle("bad", !up || other);
  }

  draw();
  setInterval(tick, 1000);
  return {
    job(job) {
      if (job.state === "running" || job.state === "waiting") running.set(job.id, job);
      else {
        running.delete(job.id);
        began.delete(job.id);
      }
      draw(job);
    },
    link(now) {
      if (now === up) return;
      up = now;
      draw();
    },
    study(study) {
      other = Boolean(study.other_writer);
      warnings = study.warnings ?? [];
      if (study.busy && !running.has(study.busy.id)) running.set(study.busy.id, study.busy);
      draw();
    },
  };
}

/**
 * Messages over the page: errors stay until closed, others go by themselves.
 * @param {HTMLElement} root
 * @returns {(text: string, kind?: "good"|"error"|"note") => void}
 */
export function createToasts(root) {
  root.setAttribute("aria-live", "polite");
  return (text, kind = "note") => {
    if ([...root.children].some((t) => t.dataset.text === text)) return;
    const close = () => box.remove();
    const box = h("div", { class: `toast ${kind}`, role: kind === "error" ? "alert" : "status", data: { text } },
      h("span", { text }), h("button", { type: "button", class: "small quiet", "aria-label": "Close this message", onclick: close }, "Close"));
    root.append(box);
    if (kind !== "error") setTimeout(close, 6000);
  };
}
