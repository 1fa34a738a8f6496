/** The car in numbers: derived values on a drawing of the car, damper curves, and parameters of version against version. */

import { xyPlot } from "../charts/xy_plot.js";
import { h } from "../widgets/dom.js";
import { number } from "../widgets/format.js";
import { term } from "../widgets/terms.js";
import { drawing, halfOf } from "./car_drawing.js";
import { arrow, differs, parameterTable } from "./car_parameters.js";

const CORNERS = { fl: "front left", fr: "front right", rl: "rear left", rr: "rear right" };
const AT_CORNERS = ["ride_rate", "damping_ratio", "static_load"];
const kept = { against: null, sheet: true, moved: false };

/**
 * @param {HTMLElement} root
 * @param {object} app
 * @returns {() => void} takes the view down
 */
export function show(root, app) {
  let turn = 0;
  let found = null;
  const against = h("select", { "aria-label": "version beside", "data-testid": "values-against", onchange: () => {
    kept.against = against.value ? Number(against.value) : null;
    void read();
  } });
  const sheet = h("input", { type: "checkbox", checked: kept.sheet, "data-testid": "values-sheet", onchange: () => {
    kept.sheet = sheet.checked;
    draw();
  } });
  const boxed = h("p", { class: "muted sub", hidden: true, "data-testid": "values-boxed" });
  const place = h("section", { class: "panel car-place", "data-testid": "car-drawing" });
  const axles = h("section", { class: "panel" });
  const dampers = h("section", { class: "panel" });
  const whole = h("section", { class: "panel" });
  const parameters = parameterTable(app, kept);
  const below = h("div", { class: "car-below" }, axles, h("div", { class: "car-right" }, dampers, whole));
  below.hidden = parameters.element.hidden = true; // until there is a model
  root.append(
    h("header", { class: "view-head" }, h("h1", { text: "The car in numbers" }),
      h("div", { class: "bar end" },
        h("label", { class: "check", title: "the intervals also count what the sensors' gains and latencies leave open" }, sheet,
          "± with the sensor sheet"), term(app, "interval"),
        h("label", { class: "check" }, "beside", against))),
    boxed, place, below, parameters.element);
  const plot = xyPlot(dampers, { title: "Damper force at the wheel", x: { label: "travel rate, compression positive", unit: "mm/s" },
    y: { label: "force", unit: "N" }, items: [], height: 300, testid: "dampers" });

  async function read() {
    const { study, version } = app.state;
    if (!study?.exists) {
      place.replaceChildren(h("p", { class: "notice", text: "There is no model yet: choose runs in the view Runs and make the model." }));
      return;
    }
    choices(study, version);
    const mine = ++turn;
    try {
      const beside = kept.against === null ? "" : `&against=${kept.against}`;
      const next = await app.api.get(`api/values?version=${version}${beside}`);
      if (mine !== turn) return;
      found = next;
      draw();
    } catch (cause) {
      if (mine === turn) app.complain(cause);
    }
  }

  function choices(study, version) {
    const others = study.versions.filter((v) => v.version !== version);
    if (!others.some((v) => v.version === kept.against)) kept.against = null;
    against.replaceChildren(h("option", { value: "", text: others.length ? "no other version" : "no other version yet" }),
      ...others.map((v) => h("option", { value: v.version, text: `version ${v.version}: ${v.note}` })));
    against.value = kept.against ?? "";
    against.disabled = !others.length;
  }

  function draw() {
    if (!found) return;
    parameters.element.hidden = false;
    boxed.hidden = found.against === null;
    boxed.textContent = `Boxed: the value in version ${found.against}. ↑ ↓: how far that of version ${found.version} is above or below it, where noise does not explain it.`;
    const at = new Map(found.derived.map((d) => [`${d.kind} ${d.place}`, d]));
    const value = (d, as) => valueOf(d, as, found.against, kept.sheet);
    place.replaceChildren(...(found.derived.length
      ? [h("div", { class: "car-sides" }, ["fl", "rl"].map((c) => corner(c, at, value))), h("div", { class: "car-numbers-box" }, drawing(at, kept.sheet), atCorners(app, found.derived)),
        h("div", { class: "car-sides" }, ["fr", "rr"].map((c) => corner(c, at, value)))]
      : [h("p", { class: "notice", text: "No values of wheels, axles and body are derived from these runs: that takes measured wheel loads. The parameters are below." })]));
    const [ofAxles, ofCar] = axleTables(app, found.derived, value);
    axles.replaceChildren(h("h2", { text: "Axles" }), ofAxles);
    whole.replaceChildren(h("h2", { text: "Body" }), ofCar);
    const curves = Object.entries(found.dampers);
    dampers.hidden = !curves.length;
    below.hidden = !found.derived.length && !curves.length;
    plot.update({ items: curves.flatMap(([c, d], k) => [
      { kind: "band", name: "", colour: `--effect-${k}`, x: d.rate, low: d.low, high: d.high },
      { kind: "line", name: CORNERS[c], colour: `--effect-${k}`, x: d.rate, y: d.force }]),
    hint: "95 % bands of noise; over the rates seen, at each corner's mean travel" });
    parameters.draw(found);
  }

  const off = app.on((patch) => {
    if ("study" in patch || "version" in patch) void read();
  });
  void read();
  return () => {
    turn += 1;
    off();
    plot.destroy();
  };
}

/** A derived value with its interval, and what it was in the other version, as an element `as`. */
function valueOf(d, as, against, sheet) {
  if (!d) return h(as, { class: "muted", text: "–" });
  if (!d.determined) return h(as, { class: "muted", title: d.why, text: "not determined" });
  if (d.none) return h(as, { class: "muted", text: "none" });
  const half = halfOf(d, sheet);
  const beside = against !== null && d.other ? h("span", { class: `was${d.differs ? " differs" : ""}`, title: differs(d.differs, against),
    text: `${number(d.other.value, halfOf(d.other, sheet))}${d.differs ? ` ${arrow(d)}` : ""}` }) : null;
  return h(as, { data: { value: d.name } }, h("b", { text: number(d.value, half) }), h("span", { class: "half", text: ` ± ${number(half, half)}` }),
    d.unit ? h("span", { class: "unit", text: ` ${d.unit}` }) : null, beside);
}

function corner(c, at, value) {
  const lines = AT_CORNERS.map((kind) => at.get(`${kind} ${c}`)).filter(Boolean);
  return h("div", { class: "car-corner", "data-testid": `values-${c}` }, h("h3", { text: CORNERS[c] }),
    h("dl", null, lines.map((d) => [h("dt", { title: d.symbol, text: d.label }), value(d, "dd")])));
}

/** What the values at the corners are. */
function atCorners(app, derived) {
  const terms = new Map(derived.filter((d) => d.place === "fl" && d.term).map((d) => [d.label, d.term]));
  return terms.size ? h("p", { class: "car-key" }, [...terms].map(([label, key]) => [h("span", null, label, " ", term(app, key)), " "])) : null;
}

/** A table of the axles' values in two columns, and one of the whole car's. */
function axleTables(app, derived, value) {
  const kinds = new Map();
  for (const d of derived) if (d.place === "front" || d.place === "rear") kinds.set(d.kind, { ...kinds.get(d.kind), [d.place]: d });
  const whole = derived.filter((d) => d.place === "car" || (d.place === "front" && !kinds.get(d.kind)?.rear));
  const name = (d) => h("th", { scope: "row", title: d.symbol, class: d.label.startsWith("of it") ? "of-it" : "" },
    `${d.label} `, d.term ? term(app, d.term) : null);
  const both = [...kinds.values()].filter((pair) => pair.front && pair.rear);
  return [
    h("table", { class: "axle-table", "data-testid": "axle-table" },
      h("thead", null, h("tr", null, ["", "front", "rear"].map((t) => h("th", { scope: "col", text: t })))),
      h("tbody", null, both.map(({ front, rear }) => h("tr", null, name(front), value(front, "td"), value(rear, "td"))))),
    h("table", { class: "axle-table", "data-testid": "body-table" }, h("tbody", null, whole.map((d) => h("tr", null, name(d), value(d, "td"))))),
  ];
}
