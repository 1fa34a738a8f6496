/** What is missing: the verdict, the ranked effects, the model's effects, an effect of one's own, the next run. */

import { h } from "../widgets/dom.js";
import { short, times } from "../widgets/format.js";
import { createNextRun } from "./next_run.js";
import { createOwnLine } from "./user_effect.js";
import { createPreview } from "./preview.js";
import { createRanking } from "./ranking.js";

const VERDICTS = {
  missing: { mark: "!", kind: "warn", text: (best) => `Missing: ${best}` },
  "nothing missing": { mark: "✓", kind: "good", text: () => "Nothing is missing" },
  "unlisted cause": { mark: "?", kind: "bad", text: () => "Something is missing that is not in the catalogue" },
};

/**
 * Show the view.
 * @param {HTMLElement} root
 * @param {Object} app
 * @returns {Promise<() => void>}
 */
export async function show(root, app) {
  let busy = false;
  const verdict = h("div", { class: "verdict-text" });
  const screen = h("button", {
    type: "button",
    class: "primary",
    "data-testid": "diagnose",
    text: "Look for what is missing",
    onclick: () => void work("diagnose", {}),
  });
  const auto = h("button", {
    type: "button",
    "data-testid": "diagnose-auto",
    text: "Add until nothing is missing",
    title: "Look, add the best, fit again, and so on",
    onclick: () => void work("diagnose", { auto: true }),
  });
  const undo = h("button", {
    type: "button",
    "data-testid": "undo",
    text: "Undo",
    onclick: () => void work("undo", {}),
  });
  const model = h("ul", { class: "effects" });
  const lead = h(
    "section",
    { class: "panel verdict", "data-testid": "verdict", "aria-live": "polite" },
    verdict,
    h("div", { class: "bar verdict-acts" }, screen, auto),
  );
  const about = { effects: new Map() };

  const preview = createPreview(app, about);
  const ranking = createRanking(app, about, {
    point: (candidate) => preview.show(candidate),
    add: (candidate) => void work("add", { effect: candidate.effect, shape: candidate.shape }),
  });
  const own = createOwnLine(app, { add: (effect) => work("add", { effect }), written: readEffects });
  const next = createNextRun(app);
  root.append(
    h("h1", { class: "sr", text: "What is missing" }),
    h(
      "div",
      { class: "missing" },
      h("div", { class: "missing-main" }, lead, ranking.element),
      h(
        "div",
        { class: "missing-side" },
        preview.element,
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

  /** One job at a time from here; its words are shown where the verdict will be. */
  async function work(name, args) {
    if (busy) return;
    if (!app.state.study?.exists) {
      app.toast("There is no model yet: choose runs first.", "note");
      return;
    }
    busy = true;
    draw();
    const before = present();
    try {
      await app.api.run(name, args, { onProgress: (job) => progress(job) });
      await app.refresh();
      announce(name, args, before, present());
    } catch (cause) {
      app.complain(cause);
      await app.refresh();
    }
    busy = false;
    draw();
    own.refresh();
  }

  function progress(job) {
    if (job.do !== "diagnose") return;
    const count = job.total ? `: ${job.done} of ${job.total}` : "";
    verdict.replaceChildren(
      h("p", { class: "verdict-big muted", text: "Looking for what is missing" }),
      h("p", {
        text: `${job.text || "at work"}${job.text?.includes(" of ") ? "" : count}. It can be cancelled below.`,
      }),
    );
  }

  function present() {
    const { study, version } = app.state;
    return study?.versions?.find((v) => v.version === version) ?? null;
  }

  function announce(name, args, before, after) {
    if (!before || !after || before.version === after.version) return;
    const fall = (key) =>
      Number.isFinite(before[key]) && Number.isFinite(after[key])
        ? `${times(before[key])} → ${times(after[key])}`
        : null;
    const held = fall("held_error");
    const what =
      {
        add: `Added ${args.effect}`,
        remove: `Removed ${args.effect}`,
        undo: `Back to version ${after.version}`,
        diagnose: "Done",
      }[name] ?? name;
    app.toast(
      `${what}: error ÷ floor ${fall("used_error")} on the runs used${held ? `, ${held} on those held out` : ""}.`,
      "good",
    );
  }

  function draw() {
    const { study } = app.state;
    const now = present();
    const ready = Boolean(study?.exists) && !busy;
    for (const button of [screen, auto]) button.disabled = !ready;
    undo.disabled = !ready || !now?.parent;
    root.querySelector(".undo-says").textContent = now?.parent
      ? `back to version ${now.parent}`
      : "this is the first version";
    const effects = Array.isArray(now?.effects) ? now.effects : Object.keys(now?.effects ?? {});
    model.replaceChildren(
      ...effects.map((key) =>
        h(
          "li",
          null,
          h("span", { class: "code", text: key }),
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
    if (!effects.length) model.append(h("li", { class: "muted", text: study?.exists ? "none" : "no model yet" }));
    if (!busy) say(study, now);
    preview.element.classList.toggle("nothing", !study?.diagnosis);
    ranking.update(study?.diagnosis ?? null, ready);
    own.ready(ready);
    next.ready(ready, study?.diagnosis ?? null);
  }

  function say(study, now) {
    lead.dataset.kind = "";
    if (!study?.exists) {
      verdict.replaceChildren(
        h("p", { class: "verdict-big", text: "There is no model yet" }),
        h("p", { text: "Choose the runs to fit it on in the view Runs." }),
      );
      return;
    }
    const d = study.diagnosis;
    if (!d) {
      const error = `Error ÷ floor: ${times(now?.used_error)} on the runs used`;
      verdict.replaceChildren(
        h("p", { class: "verdict-big", text: `Not looked for yet in version ${study.current}` }),
        h("p", {
          text: `${error}${Number.isFinite(now?.held_error) ? `, ${times(now.held_error)} on those held out` : ""}. Every effect of the catalogue and every sensor fault is tried, against ${study.draws} simulated runs that lack nothing.`,
        }),
      );
      return;
    }
    const known = VERDICTS[d.verdict] ?? { mark: "?", kind: "", text: () => d.verdict };
    lead.dataset.kind = known.kind;
    verdict.replaceChildren(
      h(
        "p",
        { class: `verdict-big ${known.kind}` },
        h("span", { class: "verdict-mark", "aria-hidden": "true", text: known.mark }),
        known.text(d.best ?? ""),
      ),
      h("p", { text: d.says }),
      h("p", {
        class: "muted sub",
        text: `Version ${study.current}; ${d.draws} simulations, so p is at least ${short(1 / (d.draws + 1), 2)}. Held-out runs were not looked at.`,
      }),
      formulas(d),
    );
  }

  function formulas(d) {
    if (!d.formulas?.length) return "";
    return h(
      "div",
      { class: "formulas" },
      h("p", { text: "Laws the residual follows; one can be taken as an effect of your own:" }),
      h(
        "ul",
        null,
        d.formulas.map((f) =>
          h(
            "li",
            null,
            h("button", { type: "button", class: "small", onclick: () => own.propose(f.text), text: "Take" }),
            " ",
            h("code", { text: f.text }),
            h("span", { class: "muted", text: ` ${short(f.gain_rms)} N, p ${short(f.p, 2)}` }),
          ),
        ),
      ),
    );
  }

  async function readEffects() {
    if (!app.state.study?.exists) return;
    try {
      const list = await app.api.get("api/effects");
      about.effects = new Map((Array.isArray(list) ? list : (list.effects ?? [])).map((e) => [e.effect, e]));
    } catch {
      about.effects = new Map(); // signs and texts are then left out; before there are runs there is no catalogue
    }
    ranking.update(app.state.study?.diagnosis ?? null, Boolean(app.state.study?.exists) && !busy, true);
  }

  const off = app.on((patch) => {
    if ("study" in patch) {
      draw();
      if (!about.effects.size) void readEffects();
    }
    if ("run" in patch || "row" in patch || "version" in patch) preview.refresh();
    if ("theme" in patch) preview.theme();
  });
  draw();
  void readEffects();
  return () => {
    off();
    preview.destroy();
    own.destroy();
  };
}
