/** What is missing: the verdict, the ranked effects, the model's effects, an effect of one's own, the next run. */

import { h } from "../widgets/dom.js";
import { createEffectPreviews } from "./effect_previews.js";
import { createNextRun } from "./next_run.js";
import { createOwnLine } from "./user_effect.js";
import { createPreview } from "./preview.js";
import { createRanking } from "./ranking.js";
import { createVerdictCard } from "./verdict_card.js";

/**
 * Show the view.
 * @param {HTMLElement} root
 * @param {Object} app
 * @returns {Promise<() => void>}
 */
export async function show(root, app) {
  let busy = "";
  let job = null;
  let stopping = false; // asked for, perhaps before the server's answer says which job it is
  let change = null;
  let closed = false;
  const about = { effects: new Map() };
  const previews = createEffectPreviews(app);
  const undo = h("button", { type: "button", "data-testid": "undo", text: "Undo", onclick: () => void work("undo", {}) });
  const model = h("ul", { class: "effects" });
  const card = createVerdictCard(app, previews, {
    add: (one) => void add(one.add, one.shape),
    search: () => void work("diagnose", {}),
    all: () => void work("diagnose", { auto: true }),
    stop,
    undo: () => void work("undo", {}),
    take: (law) => own.propose(law),
  });
  const preview = createPreview(app, about, previews);
  const ranking = createRanking(app, about, {
    // what the ranking shows by itself is fitted only where it is missing; anything else when it is chosen
    point: (candidate, byHand) => preview.show(candidate, byHand || candidate?.answer === "missing"),
    add: (candidate) => void add(candidate.effect, candidate.shape),
  });
  const own = createOwnLine(app, { add: (effect) => add(effect), written: readEffects });
  const next = createNextRun(app);
  root.append(
    h("h1", { class: "sr", text: "What is missing" }),
    card.element,
    h("div", { class: "missing-place" },
      h("div", { class: "missing" }, ranking.element, h("div", { class: "missing-side" }, preview.element)),
      h(
        "div",
        { class: "missing-more" },
        h(
          "section",
          { class: "panel" },
          h("h2", { text: "Effects added to the base model" }),
          model,
          h("div", { class: "bar" }, undo, h("span", { class: "muted undo-says" })),
        ),
        own.element,
        next.element,
      ),
    ),
  );

  /** Adds an effect; then the ranking goes on by itself, unless the effect helped no row. */
  async function add(effect, shape) {
    card.element.scrollIntoView({ block: "nearest" });
    const found = await work("add", shape && Object.keys(shape).length ? { effect, shape } : { effect });
    if (found?.helps && !closed) await work("diagnose", {});
  }

  /** One job at a time from here; its words are shown where the verdict will be. Its result; null where it failed. */
  async function work(name, args) {
    if (busy) return null;
    if (!app.state.study?.exists) {
      app.toast("There is no model yet: choose runs first.", "note");
      return null;
    }
    busy = name;
    job = null;
    stopping = false;
    draw();
    let found = null;
    try {
      found = await app.api.run(name, args, { onProgress: progress });
      if (name === "add" || name === "remove") change = found;
      if (name === "undo" || name === "remove" || name === "add") app.toast(found?.says ?? `Back to version ${found?.current}.`, "good");
    } catch (cause) {
      app.complain(cause);
    }
    await app.refresh();
    busy = "";
    job = null;
    if (closed) return found;
    draw();
    own.refresh();
    // the button that began it was disabled meanwhile, and lost the keyboard: it goes on with what is next
    if (document.activeElement === document.body) card.focus();
    return found;
  }

  function stop() {
    stopping = true;
    if (job) app.api.cancel(job).catch(app.complain);
  }

  function progress(state) {
    if (!job && stopping) app.api.cancel(state.id).catch(app.complain);
    job = state.id;
    if (busy === "diagnose") card.progress(state);
  }

  function present() {
    const { study, version } = app.state;
    return study?.versions?.find((v) => v.version === version) ?? null;
  }

  function draw() {
    const { study } = app.state;
    const now = present();
    const ready = Boolean(study?.exists) && !busy;
    undo.disabled = !ready || !now?.parent;
    root.querySelector(".undo-says").textContent = now?.parent
      ? `back to version ${now.parent}`
      : "this is the first version";
    const effects = Object.keys(now?.effects ?? {});
    model.replaceChildren(
      ...effects.map((key) =>
        h(
          "li",
          null,
          named(key),
          h("button", {
            type: "button",
            class: "small",
            "data-testid": `remove-${key}`,
            disabled: !ready,
            text: "Remove",
            "aria-label": `Remove ${key}`,
            onclick: () => void work("remove", { effect: key }),
          }),
        ),
      ),
    );
    if (!effects.length)
      model.append(
        h("li", {
          class: "muted",
          text: study?.exists ? "None yet: what is added above is listed here, and can be removed." : "No model yet.",
        }),
      );
    card.update(study, now, { busy, change });
    preview.element.classList.toggle("nothing", !study?.diagnosis);
    ranking.update(study?.diagnosis ?? null, ready);
    own.ready(ready);
    next.ready(ready, study?.diagnosis ?? null);
  }

  /** An effect in words where the catalogue is there, and as it is written in commands. */
  function named(key) {
    const label = about.effects.get(key)?.label;
    return label ? h("span", { title: key }, label) : h("span", { class: "code", text: key });
  }

  async function readEffects() {
    if (!app.state.study?.exists) return;
    try {
      const list = await app.api.get("api/effects");
      about.effects = new Map(list.effects.map((e) => [e.effect, e]));
    } catch {
      about.effects = new Map(); // signs and texts are then left out; before there are runs there is no catalogue
    }
    if (closed) return;
    ranking.update(app.state.study?.diagnosis ?? null, Boolean(app.state.study?.exists) && !busy, true);
    draw();
  }

  const off = app.on((patch) => {
    if ("study" in patch) {
      draw();
      if (!about.effects.size) void readEffects();
    }
    if ("theme" in patch) preview.theme();
  });
  draw();
  void readEffects();
  return () => {
    closed = true;
    off();
    card.destroy();
    preview.destroy();
    own.destroy();
  };
}
