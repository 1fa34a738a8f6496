/** The side of the page: the car as a picture, and its rows with their errors; both choose the row. */

import { createCar } from "./car.js";
import { h } from "./dom.js";
import { times } from "./format.js";
import { term } from "./terms.js";
import { runsOf } from "../net/state.js";

/**
 * Fill the side and keep it up to date.
 * @param {HTMLElement} root
 * @param {HTMLButtonElement} button shows and hides the side where the page is narrow
 * @param {Object} app
 */
export function createRail(root, button, app) {
  const picture = h("div", { class: "car-box", "data-testid": "car-picture" });
  const runSelect = h("select", { "aria-label": "run", "data-testid": "run-select" });
  const list = h("ul", {
    class: "row-list",
    role: "listbox",
    "aria-label": "rows with their error ÷ floor over all runs used, and in their worst run",
    tabindex: "0",
    "data-own-arrows": "",
  });
  const error = h("span", null, "error ÷ floor ", term(app, "error"));
  const worst = h("span", null, "worst run ", term(app, "worst"));
  root.append(
    picture,
    h("label", { class: "rail-run" }, h("span", { text: "Run" }), runSelect),
    h(
      "div",
      { class: "rail-head" },
      h("span", null, "Row ", term(app, "row")),
      error,
      worst,
    ),
    list,
  );
  const car = createCar(picture, app);

  runSelect.addEventListener("change", () => app.set({ run: runSelect.value }));
  list.addEventListener("keydown", (event) => {
    if (event.key !== "ArrowUp" && event.key !== "ArrowDown") return;
    const rows = app.rows().map((r) => r.row);
    const to = rows.indexOf(app.state.row) + (event.key === "ArrowUp" ? -1 : 1);
    if (rows[to]) app.set({ row: rows[to] });
    event.preventDefault();
  });
  button.addEventListener("click", () => {
    const open = document.body.classList.toggle("rail-open");
    button.setAttribute("aria-expanded", String(open));
  });
  const shut = () => {
    document.body.classList.remove("rail-open");
    button.setAttribute("aria-expanded", "false");
  };
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape" && document.body.classList.contains("rail-open")) shut();
  });
  document.getElementById("main").addEventListener("pointerdown", shut);

  function draw() {
    const { study, row, run } = app.state;
    const runs = runsOf(study);
    const used = (study?.used ?? []).length;
    const label = (name, k) => `${name} (${k < used ? "used" : "held out"})`;
    if (runSelect.dataset.of !== JSON.stringify([runs, used])) {
      runSelect.dataset.of = JSON.stringify([runs, used]);
      runSelect.replaceChildren(
        ...(runs.length
          ? runs.map((n, k) => h("option", { value: n, text: label(n, k) }))
          : [h("option", { value: "", text: "no runs chosen" })]),
      );
    }
    runSelect.disabled = !runs.length;
    if (run) runSelect.value = run;
    error.title = study?.meanings?.error ?? "";
    worst.title = study?.meanings?.worst ?? "";
    list.replaceChildren(
      ...app.rows().map((r) =>
        h(
          "li",
          {
            role: "option",
            id: `rail-${r.row}`,
            "aria-selected": String(r.row === row),
            class: r.fails ? "fails" : "",
            data: { row: r.row },
            title: `${r.row}: ${times(r.ratio)} times its noise floor over all runs used; ${times(r.worst)} in its worst run, ${r.worst_run}`,
            onclick: () => app.set({ row: r.row }),
          },
          h("span", { class: "mark", "aria-hidden": "true", text: r.fails ? "!" : "" }),
          h("span", { class: "name", text: r.row }),
          h("span", { class: `num${r.level ? " ill" : ""}`, text: times(r.ratio) }),
          h("span", { class: `num${r.fails ? " ill" : ""}`, text: times(r.worst) }),
        ),
      ),
    );
    if (!list.childElementCount) list.append(h("li", { class: "empty", text: "Rows appear once there is a model." }));
    if (row) list.setAttribute("aria-activedescendant", `rail-${row}`);
    list.querySelector("[aria-selected=true]")?.scrollIntoView({ block: "nearest" });
  }

  app.on((patch) => {
    if ("study" in patch || "row" in patch || "run" in patch) draw();
    if ("study" in patch || "row" in patch || "theme" in patch) car.update();
  });
  draw();
}
