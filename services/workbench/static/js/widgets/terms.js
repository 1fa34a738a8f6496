/** A question mark beside a term: a sentence on it, and where the documentation says more. */

import { h } from "./dom.js";

let known = null;
let box = null;

/** @param {Object} app reads the terms, once */
export function readTerms(app) {
  known ??= app.api.get("api/terms").catch(() => {
    known = null;
    return { terms: {}, examples: null };
  });
  return known;
}

/**
 * The button of a term; the sentence opens below it.
 * @param {Object} app
 * @param {string} key of the server's terms
 * @returns {HTMLElement}
 */
export function term(app, key) {
  const button = h("button", {
    type: "button",
    class: "term",
    "aria-label": "what is this?",
    "aria-expanded": "false",
    data: { term: key },
    onclick: () => void open(app, key, button),
  });
  void readTerms(app).then(({ terms }) => {
    if (terms[key]) button.setAttribute("aria-label", `what is “${terms[key].name}”?`);
  });
  return button;
}

async function open(app, key, button) {
  if (box?.button === button) {
    close();
    return;
  }
  close();
  const found = (await readTerms(app)).terms[key];
  if (!found) return;
  const element = h(
    "div",
    { class: "term-box", role: "dialog", "aria-label": found.name, tabindex: "-1", "data-testid": "term" },
    h("p", null, h("b", { text: found.name }), h("br"), found.says),
    h(
      "div",
      { class: "bar" },
      found.page
        ? h("a", { href: `api/docs/${found.page}`, target: "_blank", rel: "noopener", text: `More: ${found.page}` })
        : null,
      h("button", { type: "button", class: "small end", text: "Close", onclick: close }),
    ),
  );
  document.body.append(element);
  box = { element, button };
  button.setAttribute("aria-expanded", "true");
  place(element, button);
  element.focus();
}

/** Below the button, inside the window. */
function place(element, button) {
  const at = button.getBoundingClientRect();
  const own = element.getBoundingClientRect();
  const left = Math.max(8, Math.min(at.left - 12, innerWidth - own.width - 8));
  const below = at.bottom + 6 + own.height < innerHeight;
  element.style.left = `${left}px`;
  element.style.top = `${below ? at.bottom + 6 : Math.max(8, at.top - own.height - 6)}px`;
}

function close() {
  if (!box) return;
  const { element, button } = box;
  box = null;
  const inside = element.contains(document.activeElement);
  element.remove();
  button.setAttribute("aria-expanded", "false");
  if (inside && button.isConnected) button.focus();
}

document.addEventListener("pointerdown", (event) => {
  if (box && !box.element.contains(event.target) && event.target !== box.button) close();
});
document.addEventListener(
  "keydown",
  (event) => {
    if (event.key === "Escape" && box) {
      close();
      event.stopPropagation();
    }
  },
  true,
);
window.addEventListener("hashchange", close);
