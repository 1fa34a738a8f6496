/** The fit of the car that is recording: error of each row, and which parameters are known well enough. */

import { h } from "../widgets/dom.js";
import { number, percent, times } from "../widgets/format.js";
import { term } from "../widgets/terms.js";

const KEPT = "lacet.live-target";
const USUAL = "2"; // [%]

/**
 * The panel; the server makes numbers and words.
 * @param {Object} app
 * @returns {{element: HTMLElement, begin: () => void, update: (found: Object) => void}} `begin` asks for the fit, `update`
 *   shows an answer or event
 */
export function liveFit(app) {
  const target = h("input", { type: "number", id: "live-target", min: 0.1, max: 99, step: "any", value: kept(), data: { testid: "live-target" } });
  const line = h("p", { role: "status", class: "live-sum", data: { testid: "live-fit-line" } });
  const rows = h("tbody", { data: { testid: "live-fit-rows" } });
  const parameters = h("tbody", { data: { testid: "live-fit-parameters" } });
  const open = h("details", { class: "muted sub", hidden: true });
  const of = h("p", { class: "muted sub" });
  const tables = h(
    "div",
    { class: "live-fit-tables", hidden: true },
    table("Error by row", rows, [["Row"], ["Error ÷ floor", "num", "error"], ["State"]]),
    table("Parameters", parameters, [["Parameter"], ["Still needed", "", "enough"], ["Value", "num"], ["± 95 %", "num", "interval"], ["Unit"], ["± %", "num"]]),
  );
  const element = h(
    "section",
    { class: "panel live-fit", hidden: true, data: { testid: "live-fit" } },
    h("div", { class: "bar" }, h("h2", null, "Is it enough? ", term(app, "enough")), h("label", { for: "live-target", text: "Enough is ±" }), target, h("span", { text: "% of the value" })),
    line,
    of,
    tables,
    open,
  );
  target.addEventListener("change", () => {
    keep(target.value);
    begin();
  });

  function table(name, body, columns) {
    return h("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": name },
      h("table", { "aria-label": name }, h("thead", null, h("tr", null, columns.map(([text, kind, key]) =>
        h("th", { scope: "col", class: kind || null }, `${text} `, key ? term(app, key) : null)))), body));
  }

  async function begin() {
    try {
      update(await app.api.post("api/live/fit", { target: Number(target.value) }));
    } catch (cause) {
      line.textContent = cause.message;
    }
  }

  function update({ state, note }) {
    line.textContent = note || state?.line || "";
    of.textContent = model();
    tables.hidden = !state?.rows.length;
    open.hidden = !state?.not_identifiable.length;
    if (tables.hidden) return;
    const worst = [...state.rows].sort((a, b) => b.ratio - a.ratio);
    rows.replaceChildren(...worst.map((one) => h("tr", null,
      h("th", { scope: "row", class: "code", text: one.row }),
      h("td", { class: "num", text: times(one.ratio) }),
      h("td", { class: one.fails ? "bad" : "good" }, h("span", { "aria-hidden": "true", text: one.fails ? "✕ " : "✓ " }), one.fails ? "fails" : "fits"))));
    parameters.replaceChildren(...state.parameters.map((one) => {
      const done = one.seconds_needed === 0;
      return h("tr", null,
        h("th", { scope: "row" }, one.words, " ", h("span", { class: "muted code", text: one.symbol })),
        h("td", { class: done ? "good" : one.seconds_needed === null ? "warn" : null }, h("span", { "aria-hidden": "true", text: done ? "✓ " : one.seconds_needed === null ? "! " : "… " }), one.answer.replace(/± (\S+) %/, "±\u00a0$1\u00a0%")),
        h("td", { class: "num", text: number(one.value, one.half95_sheet) }),
        h("td", { class: "num", text: number(one.half95_sheet, one.half95_sheet) }),
        h("td", { text: one.unit }),
        h("td", { class: "num", text: one.relative > 1 ? "> 100 %" : percent(one.relative) }));
    }));
    const many = state.not_identifiable.length;
    if (open.dataset.many === String(many)) return; // it stays open as it is
    open.dataset.many = many;
    open.replaceChildren(h("summary", { text: `${many} not identifiable so far` }), state.not_identifiable.map((one) => one.name).join(", "));
  }

  /** Which model is fitted to what: the numbers beside the car are of other runs. */
  function model() {
    const { study, version } = app.state;
    return study?.exists
      ? `The model of version ${version}, fitted to this recording alone. The numbers beside the car are those of the study's runs.`
      : "The base model, fitted to this recording.";
  }

  return { element, begin, update };
}

/** The target that was chosen before on this machine. */
function kept() {
  try {
    return localStorage.getItem(KEPT) ?? USUAL;
  } catch {
    return USUAL;
  }
}

function keep(value) {
  try {
    localStorage.setItem(KEPT, value);
  } catch {
    // a browser that keeps nothing
  }
}
