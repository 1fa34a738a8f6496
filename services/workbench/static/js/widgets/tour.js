/** The guided tour: the whole story on example runs, one thing at a time; it can be ended at any step, and goes on after a reload. */

import { h } from "./dom.js";
import { readTerms } from "./terms.js";

const KEY = "lacet.tour";

/**
 * What is done at each step: `view`, `target` that is marked, `action` that a button does (`press`: another button), `may`
 * when there is that to do, `done` when it goes on.
 */
const STEPS = [
  {
    title: "Example runs",
    view: "runs",
    target: "drop-zone",
    text: "Your own logs are dropped here. For the tour there are three runs of a car with two effects hidden in it. They are raw captures, and are decoded on arrival.",
    action: { text: "Bring in the example runs", job: () => ["examples", {}] },
    done: (_, job) => job?.do === "examples" && job.state === "done",
  },
  {
    title: "Used and held out",
    view: "runs",
    target: "make-study",
    text: "The model is fitted to the runs used. A run held out is never fitted: an error that falls there too is a real one.",
    action: { text: "Use two, hold one out", job: (examples) => ["choose", examples] },
    done: (study) => study?.exists,
  },
  {
    title: "The car and its rows",
    view: "compare",
    target: "car-picture",
    text: "Every number on the car is an error ÷ noise floor: 1 is all that sensors allow. Where a row stands far above it something is missing: in the example car at all four suspensions. Press a number to see its row.",
  },
  {
    title: "Model and measurement",
    view: "compare",
    target: "chart-residual",
    text: "Measured and modelled row, what the model leaves, and the share of each effect. Drag over a chart to look closer.",
  },
  {
    title: "Where it fails",
    view: "where",
    target: "map",
    text: "Every row over time, in units of its floor. Below: in which phase of driving it fails and which state the error follows.",
  },
  {
    title: "What is missing",
    view: "missing",
    target: "diagnose",
    text: "Every effect of the catalogue is tried, against simulated runs that lack nothing. This takes about a minute.",
    action: { text: "Look for what is missing", press: "diagnose" },
    done: (study) => Boolean(study?.card) && study.busy?.do !== "diagnose",
  },
  {
    title: "The verdict",
    view: "missing",
    target: "add-best",
    text: "Which effect, its size with its interval, how far it is ahead of its best rival, and its form over this study's residual. Add it: the ranking then goes on by itself.",
    action: { text: "Add it", press: "add-best" },
    may: (study) => Boolean(study?.card?.add),
    done: (study) => Object.keys(study?.versions?.find((v) => v.version === study.current)?.effects ?? {}).length > 0,
  },
  {
    title: "The error falls",
    view: "falls",
    target: "waterfall",
    text: "Version by version, on the runs used and on those held out. Go on adding until nothing is missing; then export the report. This is the end of the tour: drop your own logs next.",
  },
];

/**
 * @param {Object} app
 * @param {HTMLElement} button starts it
 * @returns {{start: () => void, resume: () => void}}
 */
export function createTour(app, button) {
  const title = h("h2", { id: "tour-title" });
  const text = h("p");
  const count = h("span", { class: "muted" });
  const act = h("button", { type: "button", class: "primary", "data-testid": "tour-act", onclick: () => void doIt() });
  const back = h("button", { type: "button", class: "small", text: "Back", "data-testid": "tour-back", onclick: () => go(at - 1) });
  const next = h("button", { type: "button", class: "small", text: "Next", "data-testid": "tour-next", onclick: () => go(at + 1) });
  const skip = h("button", { type: "button", class: "small quiet end", text: "Leave the tour", "data-testid": "tour-leave", onclick: leave });
  const element = h(
    "section",
    { class: "tour", role: "dialog", "aria-modal": "false", "aria-labelledby": "tour-title", hidden: true, "data-testid": "tour" },
    h("div", { class: "bar" }, title, h("span", { class: "end" }, count)),
    text,
    h("div", { class: "bar" }, act, back, next, skip),
  );
  document.body.append(element);
  let at = -1;
  let examples = null;
  let marking = 0;

  async function start() {
    examples = (await readTerms(app)).examples;
    go(app.state.study?.exists ? 2 : 0);
    element.querySelector("button:not([hidden])")?.focus();
  }

  /** Goes on where this tab was before it was loaded anew. */
  async function resume() {
    const step = kept();
    if (step === null || !STEPS[step]) return;
    examples = (await readTerms(app)).examples;
    if (at < 0) go(step);
  }

  function go(step) {
    if (step >= STEPS.length || step < 0) {
      leave();
      return;
    }
    at = step;
    keep(String(at));
    const now = STEPS[at];
    element.hidden = false;
    title.textContent = now.title;
    text.textContent = at === 0 && !examples ? "Drop your own logs here: the example runs are not in this installation." : now.text;
    count.textContent = `${at + 1} of ${STEPS.length}`;
    const { study } = app.state;
    act.hidden = !now.action || (at === 0 && !examples) || now.may?.(study) === false || Boolean(now.done?.(study));
    act.disabled = Boolean(now.action?.press); // until the view is there
    act.textContent = now.action?.text ?? "";
    back.disabled = at === 0;
    next.textContent = at === STEPS.length - 1 ? "Finish" : "Next";
    next.classList.toggle("primary", act.hidden);
    app.go(now.view);
    mark(now.target, ++marking, 80);
  }

  /** The view may still be on its way: its module is loaded the first time. */
  function mark(target, mine, tries) {
    for (const old of document.querySelectorAll(".tour-target")) old.classList.remove("tour-target");
    if (mine !== marking || at < 0) return;
    const place = document.querySelector(`[data-testid="${target}"]`);
    if (place || tries === 0) act.disabled = false;
    if (place) {
      place.classList.add("tour-target");
      place.scrollIntoView({ block: "center" });
    } else if (tries > 0) setTimeout(() => mark(target, mine, tries - 1), 100);
  }

  async function doIt() {
    const { action } = STEPS[at];
    act.disabled = true;
    if (action.press) {
      press(action.press, ++marking, 50);
      return;
    }
    try {
      await app.api.run(...action.job(examples));
      await app.refresh();
    } catch (cause) {
      app.complain(cause);
      act.disabled = false;
    }
  }

  /** Presses a button of the view once it can be pressed: other work may be about to end. */
  function press(testid, mine, tries) {
    if (mine !== marking || at < 0) return;
    const there = document.querySelector(`[data-testid="${testid}"]:not(:disabled)`);
    if (there) there.click();
    else if (tries > 0) setTimeout(() => press(testid, mine, tries - 1), 100);
    else act.disabled = false;
  }

  function leave() {
    at = -1;
    marking += 1;
    keep("");
    element.hidden = true;
    for (const old of document.querySelectorAll(".tour-target")) old.classList.remove("tour-target");
    button.focus();
  }

  function keep(step) {
    try {
      sessionStorage.setItem(KEY, step);
    } catch {
      // not kept then: private windows
    }
  }

  function kept() {
    try {
      const step = sessionStorage.getItem(KEY);
      return step ? Number(step) : null;
    } catch {
      return null;
    }
  }

  app.on((patch) => {
    const now = STEPS[at];
    if (!now?.done || !("study" in patch || "job" in patch)) return;
    if (now.done(patch.study ?? app.state.study, patch.job)) setTimeout(() => STEPS[at] === now && go(at + 1), 400);
    else if (patch.job && ["failed", "cancelled"].includes(patch.job.state)) act.disabled = false;
  });
  button.addEventListener("click", () => void start());
  return { start, resume };
}
