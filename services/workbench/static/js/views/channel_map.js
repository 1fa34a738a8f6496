/** The channel map of a log of another system: its names on one side, lacet's channels on the other. */

import { debounce, h } from "../widgets/dom.js";
import { percent, short } from "../widgets/format.js";

/** What may be said of a channel beside its expression: key → label, example, meaning. */
const MORE = {
  unit: ["unit", "g", "unit of the one name in the expression, over what the log says"],
  delay: ["delay", "12 ms", "it is stamped that much later than measured"],
  table: ["table", "steering.csv", "a text table beside the log, in which the value is looked up"],
};

/**
 * Shows the map of a run in a panel.
 * @param {HTMLElement} root
 * @param {object} app
 * @param {string} name of the run
 * @param {() => void} done after the map was stored
 * @param {() => void} close when the panel is to be closed
 * @returns {Promise<{changed: () => boolean, warn: () => void} | null>} whether there is something to lose, and says so;
 *   null where the log cannot be read
 */
export async function showMap(root, app, name, done, close) {
  const path = `api/runs/${encodeURIComponent(name)}/map`;
  root.replaceChildren(h("h2", { text: `Channel map of ${name}` }), h("p", { class: "waiting", text: "Reading the log's names …" }));
  let found = null;
  try {
    found = await app.api.get(path);
  } catch (cause) {
    root.replaceChildren(h("h2", { text: `Channel map of ${name}` }), h("p", { class: "notice bad", text: cause.message }));
    return null;
  }
  const about = new Map(found.columns.map((c) => [c.column, c]));
  const units = { ...found.units };
  const lines = new Map(); // column → its line
  let focus = null;
  let turn = 0;

  const says = h("p", { class: "muted", role: "status", "data-testid": "map-says" });
  const all = h("button", { type: "button", "data-testid": "map-all", title: "All that the names, units and the car's behaviour propose, also what is not probable enough by itself",
    onclick: () => takeAll() });
  const body = h("tbody");
  const keep = h("button", { type: "button", class: "primary", "data-testid": "map-keep", disabled: true, text: "Keep the map", onclick: () => void store() });
  const shut = h("button", { type: "button", class: "quiet", "data-testid": "map-close", text: "Close", onclick: () => close() });
  const add = h("select", { "aria-label": "add a channel", "data-testid": "map-add", onchange: () => {
    const proposal = found.proposals[add.value];
    if (proposal?.unit) units[proposal.name] = proposal.unit;
    line(add.value, proposal?.expression ?? "").input.focus();
    fill();
    check();
  } });

  const entries = () => Object.fromEntries([...lines].map(([column, { entry }]) => [column, entry()]).filter(([, one]) => one.from));
  const later = debounce(() => void ask(false), 350);
  let warned = false; // what the user is asked stays until the next change
  const check = () => {
    warned = false;
    later();
  };

  async function ask(store) {
    const mine = ++turn;
    try {
      const answer = await app.api.post(`${path}${store ? "?keep=true" : ""}`, { entries: entries(), units });
      if (mine !== turn) return null;
      for (const [column, { state, input }] of lines) {
        const one = answer.columns[column];
        const bad = Boolean(one?.fault) || (one && one.low === null);
        input.setAttribute("aria-invalid", String(bad));
        state.className = bad ? "bad" : "good";
        state.textContent = !one ? "" : one.fault ? `✕ ${one.fault}` : one.low === null ? "✕ not in the run: see below"
          : `✓ ${short(one.low)} to ${short(one.high)} ${about.get(column)?.unit ?? ""}`;
      }
      keep.disabled = !answer.makes_run || Object.values(answer.columns).some((one) => one.fault);
      if (!warned) says.textContent = [answer.makes_run ? `Makes a run of ${short(answer.seconds)} s.` : "Makes no run yet.", ...answer.notes].join(" ");
      return answer;
    } catch (cause) {
      if (mine === turn) says.textContent = cause.message;
      return null;
    }
  }

  async function store() {
    keep.disabled = true;
    if ((await ask(true))?.kept) {
      app.toast(`The map is kept as ${found.own}: the run can be used.`, "good");
      done();
    }
  }

  /** A line of the map; made where the column has none. */
  function line(column, entry) {
    const there = lines.get(column);
    if (there) return there;
    const said = typeof entry === "string" ? { from: entry } : entry;
    const expression = said.from;
    const proposal = found.proposals[column];
    const input = h("input", { type: "text", class: "map-expression code", value: expression, "aria-label": `${column} is`, "data-testid": `map-${column}`,
      spellcheck: "false", oninput: check, onfocus: () => { focus = input; } });
    const state = h("span", { class: "muted", "data-testid": `map-state-${column}` });
    const guess = proposal && proposal.expression === expression ? h("span", { class: proposal.probability >= found.accepted ? "good" : "warn",
      title: "probability that column, unit and sign are right", text: percent(proposal.probability) }) : null;
    const more = Object.fromEntries(Object.entries(MORE).map(([key, [label, example, title]]) => [key, h("input", { type: "text", class: "map-more code",
      value: said[key] ?? "", placeholder: example, title, "aria-label": `${label} of ${column}`, "data-testid": `map-${column}-${key}`, spellcheck: "false", oninput: check })]));
    const extra = h("div", { class: "bar map-extra", hidden: Object.keys(said).length < 2 }, Object.entries(more).map(([key, field]) => h("label", null, `${MORE[key][0]} `, field)));
    const open = h("button", { type: "button", class: "small quiet", "aria-label": `unit, delay and table of ${column}`, "aria-expanded": String(!extra.hidden),
      "data-testid": `map-${column}-more`, text: "More", onclick: () => {
        extra.hidden = !extra.hidden;
        open.setAttribute("aria-expanded", String(!extra.hidden));
        if (!extra.hidden) more.unit.focus();
      } });
    const row = h("tr", null, h("th", { scope: "row", class: "code", title: about.get(column)?.about ?? "", text: column }),
      h("td", { text: about.get(column)?.unit || "–" }), h("td", null, h("div", { class: "map-is" }, input, open), extra), h("td", { class: "num" }, guess), h("td", { class: "map-state" }, state),
      h("td", null, h("button", { type: "button", class: "small quiet", "aria-label": `Leave ${column} out`, text: "Leave out", onclick: () => {
        row.remove();
        lines.delete(column);
        fill();
        check();
      } })));
    body.append(row);
    const fields = Object.entries({ from: input, ...more });
    const made = { input, state, entry: () => Object.fromEntries(fields.map(([key, field]) => [key, field.value.trim()]).filter(([, text]) => text)) };
    lines.set(column, made);
    return made;
  }

  /** Channels that are proposed and have no line yet. */
  const proposed = () => found.columns.map((c) => c.column).filter((column) => found.proposals[column] && !lines.has(column) && !found.kept.includes(column));

  function takeAll() {
    const taken = proposed();
    for (const column of taken) {
      const { name: source, unit, expression } = found.proposals[column];
      if (unit) units[source] = unit;
      line(column, expression);
    }
    const doubtful = taken.filter((column) => found.proposals[column].probability < found.accepted).length;
    app.toast(`${taken.length} proposals taken${doubtful ? `; ${doubtful} below ${percent(found.accepted)} are marked: check them` : ""}.`, "note");
    fill();
    check();
  }

  function fill() {
    const left = proposed().length;
    all.disabled = !left;
    all.textContent = left ? `Take all proposals (${left} more)` : "All proposals are taken";
    const free = found.columns.filter((c) => !lines.has(c.column) && !found.kept.includes(c.column));
    const option = (c) => h("option", { value: c.column, text: `${c.column}${c.unit ? ` [${c.unit}]` : ""}${found.proposals[c.column]
      ? `: ${found.proposals[c.column].expression}, ${percent(found.proposals[c.column].probability)}` : ""}` });
    const group = (label, list) => (list.length ? h("optgroup", { label }, list.map(option)) : null);
    add.replaceChildren(...[h("option", { value: "", text: "+ channel …" }), group("proposed", free.filter((c) => found.proposals[c.column])),
      group("others", free.filter((c) => !found.proposals[c.column]))].filter(Boolean));
    add.value = "";
  }

  const sources = h("tbody", null, found.names.map((n) => {
    const unit = h("input", { type: "text", class: "map-unit", value: units[n.name] ?? "", placeholder: n.unit || "unit?", "aria-label": `unit of ${n.name}`,
      oninput: () => {
        if (unit.value.trim()) units[n.name] = unit.value.trim();
        else delete units[n.name];
        check();
      } });
    const insert = () => {
      if (!focus) return;
      const text = /^[A-Za-z_]\w*(\.\w+)*$/.test(n.name) ? n.name : `\`${n.name}\``;
      focus.setRangeText(text, focus.selectionStart, focus.selectionEnd, "end");
      focus.focus();
      check();
    };
    return h("tr", null, h("th", { scope: "row" }, h("button", { type: "button", class: "link code", title: "write it into the expression chosen", onclick: insert, text: n.name })),
      h("td", null, unit), h("td", { class: "num", text: n.low === null ? "–" : `${short(n.low)} to ${short(n.high)}` }),
      h("td", { class: "num", text: n.rate ? `${short(n.rate)} Hz` : "–" }));
  }));
  const head = (...texts) => h("thead", null, h("tr", null, texts.map((text) => h("th", { scope: "col", text }))));
  for (const [column, entry] of Object.entries(found.entries)) line(column, entry);
  fill();
  root.replaceChildren(...[
    h("h2", null, `Channel map of ${found.file}`, h("span", { class: "muted", text: found.map ? `from ${found.map}` : "proposed from names, units and the car's behaviour: look through it, signs first" })),
    h("div", { class: "map-sides" },
      h("div", { class: "scroll map-side" }, h("table", null, head("In the log", "Unit", "Range", "Rate"), sources)),
      h("div", { class: "scroll map-side" }, h("table", { class: "map-table" }, head("Channel", "Unit", "Is", "Guess", "Check", ""), body), h("div", { class: "bar" }, add, all))),
    found.kept.length ? h("p", { class: "muted", text: `Kept as they are in the file: ${found.kept.join(", ")}.` }) : null,
    h("div", { class: "bar" }, says, h("span", { class: "end" }, shut, keep)),
  ].filter(Boolean));
  void ask(false);
  const now = () => JSON.stringify([entries(), units]);
  const begun = now();
  const warn = () => {
    warned = true;
    says.textContent = "The map has changes that are not kept: Esc or Close once more closes it without them.";
  };
  return { changed: () => now() !== begun, warn };
}
