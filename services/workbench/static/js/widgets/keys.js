/** Everything the page does by keyboard, and the table that says so. */

import { h } from "./dom.js";

const KEYS = [
  ["1 … 7", "choose a view"],
  ["↑ ↓", "the row before, the row after"],
  ["← →", "the run before, the run after"],
  ["/", "write an effect of your own"],
  ["d", "to the button that looks for what is missing (Enter presses it)"],
  ["u", "in “What is missing”: undo, back to the version before"],
  ["t", "dark or light"],
  ["?", "this table"],
  ["Esc", "leave a field; close this table, a map, a list of channels"],
];

/**
 * Listen to the keyboard.
 * @param {Object} app
 * @param {HTMLElement} button opens the table of keys
 * @param {() => string} view the view shown
 */
export function installKeys(app, button, view) {
  const dialog = h(
    "dialog",
    { class: "keys", "aria-labelledby": "keys-title" },
    h("h2", { id: "keys-title", text: "Keys" }),
    h(
      "table",
      null,
      h(
        "tbody",
        null,
        KEYS.map(([key, does]) =>
          h("tr", null, h("th", { scope: "row" }, h("kbd", { text: key })), h("td", { text: does })),
        ),
      ),
    ),
    h("form", { method: "dialog" }, h("button", { class: "primary", autofocus: true, text: "Close" })),
  );
  document.body.append(dialog);
  button.addEventListener("click", () => dialog.showModal());

  const step = (list, now, by) => (list.length ? list[(list.indexOf(now) + by + list.length) % list.length] : null);

  function act(key) {
    const { state } = app;
    const rows = app.rows().map((r) => r.row);
    if (/^[1-9]$/.test(key) && app.views[Number(key) - 1]) app.go(app.views[Number(key) - 1]);
    else if (key === "ArrowUp" || key === "ArrowDown") {
      if (!rows.length) return false;
      app.set({ row: step(rows, state.row, key === "ArrowUp" ? -1 : 1) });
    } else if (key === "ArrowLeft" || key === "ArrowRight") {
      if (!app.runs().length) return false;
      app.set({ run: step(app.runs(), state.run, key === "ArrowLeft" ? -1 : 1) });
    } else if (key === "/") {
      if (view() !== "missing") app.go("missing");
      focusOn("own-line", 60);
    } else if (key === "d") {
      if (view() !== "missing") app.go("missing");
      focusOn("diagnose", 60);
    } else if (key === "u") {
      if (view() !== "missing") app.go("missing");
      else document.querySelector("[data-testid=undo]:not(:disabled)")?.click();
    } else if (key === "t") document.getElementById("theme-button").click();
    else if (key === "?") dialog.showModal();
    else return false;
    return true;
  }

  /** The view may still be on its way: its module is loaded the first time. */
  function focusOn(testid, tries) {
    const place = document.querySelector(`[data-testid=${testid}]`);
    if (place) place.focus();
    else if (tries > 0) setTimeout(() => focusOn(testid, tries - 1), 50);
  }

  document.addEventListener("keydown", (event) => {
    if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey || dialog.open) return;
    const at = event.target;
    if (event.key === "Escape") {
      at.blur?.();
      return;
    }
    const arrow = event.key.startsWith("Arrow");
    // what uses the keys itself keeps them: fields always, radio buttons, sliders and scrolled boxes for the arrows
    if (
      at.isContentEditable ||
      at.matches?.("textarea, select, input:not([type=radio], [type=checkbox], [type=button])")
    )
      return;
    if (
      arrow &&
      (event.shiftKey || at.matches?.("input, [role=slider], [role=grid], [data-own-arrows], [data-own-arrows] *"))
    )
      return;
    if (act(event.key)) event.preventDefault();
  });
}
