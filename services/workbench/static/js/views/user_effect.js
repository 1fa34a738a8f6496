/** An effect of one's own in one line: units are checked while it is written; kept in the study when asked. */

import { debounce, h } from "../widgets/dom.js";
import { term } from "../widgets/terms.js";

const WAIT = 300; // after the last key, before the line is checked [ms]
const EXAMPLE = "bump = suspension: p * travel**2 * sign(rate)";

/**
 * @param {Object} app
 * @param {{add: (effect: string) => Promise<void>, written: () => Promise<void>}} act
 */
export function createOwnLine(app, act) {
  const line = h("input", {
    type: "text",
    class: "code own-input",
    "data-testid": "own-line",
    spellcheck: "false",
    autocomplete: "off",
    autocapitalize: "off",
    placeholder: EXAMPLE,
    "aria-label": "an effect of your own, in one line",
    "aria-describedby": "own-says",
  });
  const says = h("div", { class: "own-says", id: "own-says", "data-testid": "own-check", role: "status" });
  const add = h("button", {
    type: "button",
    class: "primary",
    "data-testid": "own-add",
    disabled: true,
    text: "Keep and add",
  });
  const keep = h("button", {
    type: "button",
    "data-testid": "own-keep",
    disabled: true,
    text: "Keep only",
    title: "Keep the line in the study; the next search tries it with the others",
  });
  const variants = h("fieldset", { class: "own-variants", "data-testid": "own-variants" });
  const element = h(
    "section",
    { class: "panel own", "aria-label": "An effect of your own" },
    h("h2", null, "An effect of your own", term(app, "own"), h("span", { class: "muted" }, h("kbd", { text: "/" }))),
    line,
    says,
    variants,
    h("div", { class: "bar" }, add, keep),
  );
  let good = false;
  let may = false;
  let turn = 0;
  let chosen = "";
  const meant = new Set(); // names that are parameters, though a state's is nearly the same

  function buttons() {
    add.disabled = keep.disabled = !(good && may);
    add.textContent = chosen ? `Keep and add ${chosen}` : "Keep and add";
  }

  /** Where the effect acts: a line that holds for several places makes an effect for each. */
  function offer(made) {
    if (!made.includes(chosen)) chosen = made[0] ?? "";
    variants.replaceChildren(
      ...(made.length > 1 ? [h("legend", { text: "Where it is added" })] : []),
      ...(made.length > 1 ? made : []).map((key) =>
        h("label", { class: "check" },
          h("input", { type: "radio", name: "own-variant", value: key, checked: key === chosen,
            "data-testid": `own-variant-${key}`, onchange: () => { chosen = key; buttons(); } }),
          h("span", { class: "code", text: key })),
      ),
    );
  }

  const check = debounce(() => void checkIt(), WAIT);

  async function checkIt() {
    const text = line.value.trim();
    const mine = ++turn;
    good = false;
    if (!text) {
      hint();
      return;
    }
    try {
      const answer = await app.api.post("api/effect/check", { name: "", line: text });
      if (mine !== turn) return;
      const doubt = (answer.doubts ?? []).find((one) => !meant.has(one.name));
      good = Boolean(answer.ok) && !doubt;
      offer(good ? answer.variants : []);
      if (doubt) question(doubt, text);
      else say(answer, text);
    } catch (cause) {
      if (mine === turn) say({ ok: false, error: cause.message }, text);
    }
    buttons();
  }

  /** A name that is nearly a state's: never taken for a parameter without being asked about. */
  function question({ name, state, at, until }, text) {
    says.className = "own-says wrong";
    says.replaceChildren(
      h("p", null, h("b", { class: "warn", text: "? " }), `Did you mean ${state}? There is no state “${name}”.`),
      h("div", { class: "bar" },
        h("button", { type: "button", class: "small", "data-testid": "own-state", text: `Yes, ${state}`,
          onclick: () => {
            line.value = text.slice(0, at) + state + text.slice(until);
            line.focus();
            void checkIt();
          } }),
        h("button", { type: "button", class: "small", "data-testid": "own-parameter", text: `No, ${name} is a parameter`,
          onclick: () => {
            meant.add(name);
            line.focus();
            void checkIt();
          } })),
    );
  }

  function hint() {
    offer([]);
    says.className = "own-says";
    says.replaceChildren(
      h("span", {
        class: "muted",
        text: "NAME = WHERE: LAW. Units follow from the law and are checked as you write, for instance ",
      }),
      h("code", { text: EXAMPLE }),
    );
    buttons();
  }

  function say(answer, text) {
    says.className = `own-says ${answer.ok ? "ok" : "wrong"}`;
    line.setAttribute("aria-invalid", String(!answer.ok));
    if (answer.ok) {
      const units = (answer.parameters ?? []).map((p) => `${p.name} [${p.unit || "no unit"}]`).join(", ");
      says.replaceChildren(
        h("b", { class: "good", text: "✓ The units agree. " }),
        [
          answer.says ?? "",
          units ? `To be found: ${units}.` : "",
          answer.rows?.length ? ` In ${answer.rows.map((r) => (typeof r === "string" ? r : r.row)).join(", ")}.` : "",
        ].join(" "),
      );
    } else {
      const at = Number.isInteger(answer.at) ? answer.at : null;
      const until = Math.max(at + 1, answer.until ?? 0);
      says.replaceChildren(
        h("b", { class: "bad", text: "✕ " }),
        answer.error ?? answer.says ?? "this line cannot be read",
        at !== null && at <= text.length
          ? h(
              "code",
              { class: "own-at" },
              text.slice(0, at),
              h("mark", { text: text.slice(at, until) || "␣" }),
              text.slice(until),
            )
          : "",
      );
    }
  }

  async function write(andAdd) {
    if (!good || !may) return;
    may = false;
    buttons();
    try {
      const answer = await app.api.post("api/effect", { name: "", line: line.value.trim(), parameters: [...meant] });
      await act.written();
      if (andAdd && chosen) await act.add(chosen);
      else app.toast(`Kept in the study: ${answer.effect}, ${answer.tells}.`, "good");
    } catch (cause) {
      app.complain(cause);
    }
    may = Boolean(app.state.study?.exists);
    buttons();
  }

  line.addEventListener("input", () => {
    good = false;
    buttons();
    check();
  });
  line.addEventListener("keydown", (event) => {
    if (event.key === "Enter") void write(true);
  });
  add.addEventListener("click", () => void write(true));
  keep.addEventListener("click", () => void write(false));
  hint();

  return {
    element,
    ready(now) {
      may = now;
      buttons();
    },
    refresh: () => line.value.trim() && check(),
    propose(text) {
      line.value = text;
      line.focus();
      check();
    },
    destroy: () => check.cancel(),
  };
}
