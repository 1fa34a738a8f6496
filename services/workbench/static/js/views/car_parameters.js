/** Parameters in plain words with the paper's symbols, beside those of another version, what differs marked. */

import { h } from "../widgets/dom.js";
import { minus, number, short } from "../widgets/format.js";
import { term } from "../widgets/terms.js";

/**
 * The table in its panel.
 * @param {object} app
 * @param {{sheet: boolean, moved: boolean}} kept what is chosen: intervals with the sheet, only what differs
 * @returns {{element: HTMLElement, draw: (found: object) => void}} `found` : answer of /api/values
 */
export function parameterTable(app, kept) {
  let found = null;
  const filter = h("input", { type: "search", class: "filter", placeholder: "filter", title: "by name, symbol or effect", "aria-label": "filter the parameters",
    "data-testid": "values-filter", oninput: () => draw() });
  const moved = h("input", { type: "checkbox", checked: kept.moved, "data-testid": "values-moved", onchange: () => {
    kept.moved = moved.checked;
    draw();
  } });
  const only = h("label", { class: "check" }, moved, "only what differs");
  const count = h("span", { class: "muted" });
  const box = h("div", { class: "scroll" });
  const element = h("section", { class: "panel", "data-testid": "values-parameters" },
    h("h2", null, "Parameters", count, h("span", { class: "bar end" }, only, filter)), box);

  function draw() {
    if (!found) return;
    const beside = found.against;
    only.hidden = beside === null;
    const words = filter.value.trim().toLowerCase().split(/\s+/).filter(Boolean);
    const fits = (p) => words.every((w) => `${p.label} ${p.symbol} ${p.name} ${p.effect}`.toLowerCase().includes(w));
    const list = found.parameters.filter((p) => fits(p) && (beside === null || !kept.moved || p.differs || !p.other));
    count.textContent = `${list.length} of ${found.parameters.length}`;
    const head = ["Parameter", "Symbol", "Value", kept.sheet ? "± 95 %, with sheet" : "± 95 %, noise", "Unit", "A priori",
      ...(beside === null ? [] : [`Version ${beside}`, "Change"])];
    const terms = { 3: "interval", 5: "apriori", 6: "version" };
    box.replaceChildren(h("table", { class: "value-table" },
      h("thead", null, h("tr", null, head.map((t, k) => h("th", { scope: "col", class: [2, 3, 5, 6].includes(k) ? "num" : "" }, `${t} `, terms[k] ? term(app, terms[k]) : null)))),
      h("tbody", null, list.map((p) => line(p, beside)), beside === null || kept.moved ? null : found.gone.filter(fits).map((p) =>
        h("tr", { class: "muted" }, h("th", { scope: "row", text: p.label }), h("td", { class: "code", text: p.symbol }),
          h("td", { class: "num", colspan: 4, text: "not in this version" }), h("td", { class: "num", text: number(p.value, half(p)) }), h("td"))))));
    if (!list.length) box.append(h("p", { class: "muted", text: kept.moved ? "No parameter differs by more than noise explains." : "No parameter fits this filter." }));
  }

  const half = (p) => (kept.sheet ? p.half95_sheet : null) ?? p.half95;

  function line(p, beside) {
    return h("tr", { data: { parameter: p.name } },
      h("th", { scope: "row", title: [p.effect, p.group && `stands for ${p.group}`].filter(Boolean).join("; "), text: p.label }),
      h("td", { class: "code", title: p.name, text: p.sum || p.symbol }),
      h("td", { class: "num strong", text: number(p.value, half(p)) }),
      h("td", { class: "num", text: `± ${number(half(p), half(p))}` }),
      h("td", { text: p.unit || "–" }),
      h("td", { class: "num muted", text: number(p.apriori) }),
      beside === null ? null : h("td", { class: "num muted", text: p.other ? number(p.other.value, half(p.other)) : "–" }),
      beside === null ? null : h("td", { class: p.differs ? "differs" : "muted", title: p.other ? differs(p.differs, beside) : null,
        text: p.other ? (p.differs ? `● ${arrow(p)}` : "○ same") : "new" }));
  }

  return {
    element,
    draw(next) {
      found = next;
      draw();
    },
  };
}

/** In words whether a value differs from that of another version. */
export function differs(yes, against) {
  return yes
    ? `version ${against}: differs by more than both versions' noise explains`
    : `version ${against}: the same within both versions' noise`;
}

/** How a value moved since another version. */
export function arrow({ change }) {
  if (change === null || Math.abs(change) >= 1000) return "↕";
  return minus(`${change > 0 ? "↑" : "↓"} ${short(Math.abs(change), 2)} %`);
}
