/** Runs: what is there, bringing files in, and which runs the model is made from. */

import { h } from "../widgets/dom.js";
import { duration, short, size } from "../widgets/format.js";
import { jobId } from "../net/jobs.js";
import { showMap } from "./channel_map.js";
import { confirmed, fileActions } from "./run_actions.js";

const ROLES = [
  ["used", "used"],
  ["held", "held out"],
  ["unused", "not used"],
];
const READING = "being read";
const AT_ONCE = 3; // files sent at a time
const ACCEPT = ".mcap,.parquet,.csv,.mf4,.mdf,.toml,.json,.dbc,.txt,.tsv,.dat,.pq,.mat,.tdms,.log,.candump,.blf,.asc,.trc";

/**
 * Show the view.
 * @param {HTMLElement} root
 * @param {Object} app
 * @returns {Promise<() => void>}
 */
export async function show(root, app) {
  const picked = new Map(); // run → role chosen here and not yet made
  let runs = [];
  let open = null; // the run whose channels are shown; null where its map is
  let map = null;
  let of = null; // the run whose map is shown
  let warned = false;
  let making = false;
  let closed = false;

  const files = h("input", {
    type: "file",
    multiple: true,
    accept: ACCEPT,
    class: "sr",
    id: "files",
    "data-testid": "file-input",
    tabindex: "-1",
    "aria-hidden": "true",
  });
  const sent = h("ul", { class: "sent", "aria-live": "polite" });
  const drop = h(
    "div",
    { class: "drop", "data-testid": "drop-zone" },
    h(
      "div",
      null,
      h("b", { text: "Drop logs here" }),
      h("span", { class: "muted", text: " MCAP, decoded or raw; Parquet; CSV; MF4; also rig.toml and vehicle.toml" }),
    ),
    h("button", {
      type: "button",
      text: "Choose files …",
      "data-testid": "choose-files",
      onclick: () => files.click(),
    }),
    files,
  );
  const body = h("tbody");
  const table = h(
    "table",
    { class: "runs-table" },
    h(
      "thead",
      null,
      h(
        "tr",
        null,
        ["Run", "Used for the fit", "Manoeuvre", "Length", "Size", "Channels", "Quality", "Losses"].map((text, k) =>
          h("th", { scope: "col", class: `${k > 2 && k < 6 ? "num" : ""}${k === 2 || k === 4 ? " if-wide" : ""}`, text }),
        ),
      ),
    ),
    body,
  );
  const says = h("p", { class: "choice-says", role: "status" });
  const make = h("button", {
    type: "button",
    class: "primary",
    "data-testid": "make-study",
    disabled: true,
    text: "Make the study",
    onclick: () => void makeStudy(),
  });
  const describedBy = h("ul", { class: "described", hidden: true, "data-testid": "described" });
  const detail = h("section", { class: "panel detail", hidden: true, "aria-label": "Channels of a run" });
  root.append(
    h(
      "header",
      { class: "view-head" },
      h("h1", { text: "Runs" }),
      h("p", {
        class: "muted",
        text: "Fit the model on some runs and hold others out: an error that falls on runs the fit has never seen is a real one.",
      }),
    ),
    drop,
    sent,
    h(
      "section",
      { class: "panel flush" },
      h("div", { class: "scroll runs-scroll" }, table),
      h("div", { class: "bar choice" }, says, make),
    ),
    describedBy,
    detail,
  );

  const role = (run) => picked.get(run.name) ?? run.role;

  /** Files that describe the runs: name, what it is, and the name in it. */
  const describing = () =>
    [["rig.toml", "instruments", app.state.study?.rig], ["vehicle.toml", "car", app.state.study?.vehicle]].filter(([, , there]) => there);

  function draw() {
    const focused = body.contains(document.activeElement) ? document.activeElement.dataset.testid : null;
    body.replaceChildren(...runs.map(line));
    if (focused) body.querySelector(`[data-testid="${CSS.escape(focused)}"]`)?.focus(); // the lines are made anew
    const { study } = app.state;
    const described = describing();
    describedBy.replaceChildren(...described.map(([file, what, named]) => h("li", null, h("b", { text: `${what}: ` }), named, h("span", { class: "muted", text: ` (${file})` }),
      fileActions(app, { name: file, file, may: !study.exists }, { replace: (sent, as) => void take([sent], as), done: () => void app.refresh() }))));
    describedBy.hidden = !described.length;
    if (!runs.length)
      body.append(
        h(
          "tr",
          null,
          h("td", {
            colspan: 8,
            class: "empty",
            text: "No runs yet. Drop at least two logs above: one to fit the model on, one to hold out.",
          }, h("br"), h("button", { type: "button", "data-testid": "invite-tour", text: "Or take the tour on example runs (five minutes)",
            onclick: () => app.tour() })),
        ),
      );
    choice();
  }

  function line(run) {
    const waits = run.quality === READING;
    const unreadable = waits || run.quality === "cannot be read";
    const radios = h(
      "div",
      { class: "roles", role: "radiogroup", "aria-label": `what ${run.name} is used for` },
      ROLES.map(([value, text]) =>
        h(
          "label",
          { class: "role" },
          h("input", {
            type: "radio",
            name: `role-${run.name}`,
            value,
            checked: role(run) === value,
            disabled: unreadable && value !== "unused",
            "data-testid": `role-${run.name}-${value}`,
            onchange: () => {
              picked.set(run.name, value);
              choice();
            },
          }),
          h("span", { text }),
        ),
      ),
    );
    return h(
      "tr",
      { "data-testid": `run-row-${run.name}`, class: `${open === run.name ? "open" : ""}${waits ? " reading" : ""}` },
      h(
        "th",
        { scope: "row" },
        h("b", { text: run.name }),
        h("div", { class: "sub muted", text: [run.format, run.vehicle].filter(Boolean).join(" · ") }),
        h("div", { class: "bar run-files" },
          run.by_map ? h("button", { type: "button", class: "small", "data-testid": `map-of-${run.name}`, text: "Channel map …", onclick: () => void mapOf(run.name) }) : null,
          fileActions(app, run, { replace: (file, as) => void take([file], as), done: () => void read() })),
      ),
      h("td", null, radios),
      h("td", { class: "if-wide", text: run.manoeuvre || (waits ? "" : "–") }, waits ? h("i", { class: "skeleton" }) : null),
      h("td", { class: "num", text: waits ? "" : duration(run.seconds) }, waits ? h("i", { class: "skeleton" }) : null),
      h("td", { class: "num if-wide", text: size(run.bytes) }),
      h(
        "td",
        { class: "num" },
        h("button", {
          type: "button",
          class: "small",
          "aria-expanded": String(open === run.name),
          "data-testid": `channels-${run.name}`,
          disabled: unreadable,
          "aria-label": `channels of ${run.name}`,
          onclick: () => void channels(run.name),
          text: waits ? "…" : count(run.channels),
        }),
      ),
      h("td", null, quality(run), (run.says ?? []).map((text) => h("div", { class: "sub", text }))),
      h("td", { class: lost(run.losses) ? "warn" : "", text: waits ? "" : losses(run.losses) }),
    );
  }

  function choice() {
    const names = { used: [], held: [], unused: [] };
    for (const run of runs) names[role(run)]?.push(run.name);
    const { study } = app.state;
    const changed = runs.some((run) => picked.has(run.name) && picked.get(run.name) !== run.role);
    const text = `${names.used.length} used, ${names.held.length} held out`;
    make.textContent = study?.exists ? "Fit to this choice" : "Make the study";
    make.disabled = making || !names.used.length || (study?.exists && !changed);
    if (making) says.textContent = `${text}. The model is being fitted; the bar below says how far it is.`;
    else if (!runs.length) says.textContent = "";
    else if (!names.used.length) says.textContent = "Choose at least one run to fit the model on.";
    else if (study?.exists && !changed)
      says.textContent = `${text}: the model stands on these. ${[...study.warnings, "Choose otherwise to fit anew."].join(". ")}`;
    else
      says.textContent = `${text}.${names.held.length ? "" : " Without a run held out nothing checks the fit."}${study?.exists ? " A new version with the same effects is made; the old ones stay." : ""}`;
  }

  async function makeStudy() {
    const used = runs.filter((r) => role(r) === "used").map((r) => r.name);
    const held = runs.filter((r) => role(r) === "held").map((r) => r.name);
    making = true;
    choice();
    try {
      const first = !app.state.study?.exists;
      const job = jobId(await app.api.post("api/study/runs", { used, held }));
      await app.api.follow(job);
      picked.clear();
      await app.refresh();
      app.toast(
        first ? "The study is made: see where the model fails." : "The model is fitted to the new choice of runs.",
        "good",
      );
    } catch (cause) {
      app.complain(cause);
    }
    making = false;
    if (!closed) await read();
  }

  async function channels(name) {
    if (open === name) {
      open = null;
      detail.hidden = true;
      draw();
      return;
    }
    open = name;
    detail.hidden = false;
    detail.replaceChildren(
      h("h2", { text: `Channels of ${name}` }),
      h("p", { class: "waiting", text: "Reading the log …" }),
    );
    draw();
    body.querySelector(`[data-testid="channels-${name}"]`)?.focus();
    try {
      const run = await app.api.get(`api/runs/${encodeURIComponent(name)}`);
      if (open !== name || closed) return;
      detail.replaceChildren(
        h(
          "h2",
          null,
          `Channels of ${name}`,
          h("span", { class: "muted", text: `${run.vehicle || "vehicle not named"}, ${run.rig || "rig not named"}` }),
        ),
        h(
          "div",
          { class: "scroll channels" },
          h(
            "table",
            null,
            h(
              "thead",
              null,
              h(
                "tr",
                null,
                h("th", { scope: "col", text: "Channel" }),
                h("th", { scope: "col", text: "Components" }),
                h("th", { scope: "col", text: "Unit" }),
                ["Rate", "Samples", "Flagged"].map((text) => h("th", { scope: "col", class: "num", text })),
              ),
            ),
            h(
              "tbody",
              null,
              (run.channels ?? []).map((c) =>
                h(
                  "tr",
                  null,
                  h("th", { scope: "row", class: "code", text: c.name }),
                  h("td", { text: [c.components ?? []].flat().join(", ") || "1" }),
                  h("td", { text: c.unit || "–" }),
                  h("td", { class: "num", text: c.rate ? `${short(c.rate, 3)} Hz` : "–" }),
                  h("td", { class: "num", text: String(c.samples ?? "–") }),
                  h("td", { class: c.flagged ? "num warn" : "num", text: flagged(c) }),
                ),
              ),
            ),
          ),
        ),
      );
    } catch (cause) {
      if (open === name && !closed)
        detail.replaceChildren(
          h("h2", { text: `Channels of ${name}` }),
          h("p", { class: "notice bad", text: cause.message }),
        );
    }
  }

  async function mapOf(name) {
    open = null;
    of = name;
    detail.hidden = false;
    map = null;
    warned = false;
    const found = await showMap(detail, app, name, () => {
      detail.hidden = true;
      void read();
    }, shut);
    if (open === null) map = found;
    detail.scrollIntoView({ block: "nearest" });
  }

  /** Escape closes what is shown of a run. In a field it leaves the field alone (keys.js). */
  function escape(event) {
    if (event.key !== "Escape") warned = false;
    if (event.key !== "Escape" || event.defaultPrevented || detail.hidden || document.querySelector("dialog[open]")) return;
    if (event.target.matches?.("input, select, textarea")) return;
    shut();
  }
  document.addEventListener("keydown", escape);

  /** Closes what is shown of a run; a map with changes when asked twice. */
  function shut() {
    if (open === null && map?.changed() && !warned) {
      warned = true;
      map.warn();
      return;
    }
    const back = open === null ? `map-of-${of}` : `channels-${open}`;
    open = null;
    detail.hidden = true;
    draw();
    root.querySelector(`[data-testid="${back}"]`)?.focus();
  }

  /** Sends files, several at a time; `as` : in place of the file of that name. */
  async function take(list, as = null) {
    const waiting = [...list].map((file) => sending(file, as));
    const next = async () => {
      for (let send = waiting.shift(); send; send = waiting.shift()) await send();
    };
    await Promise.all(Array.from({ length: AT_ONCE }, next));
    files.value = "";
  }

  /** The line of a file that is to be sent, and what sends it. */
  function sending(file, as) {
    const name = as ?? file.name;
    const text = h("span", { text: `${name}: waits` });
    const item = h("li", { data: { file: name } }, text);
    sent.append(item);
    const refused = (why, there) => {
      item.className = "bad";
      text.textContent = `${name}: ${why}`;
      if (there) item.append(" ", h("button", { type: "button", class: "small", text: "Replace …", "data-testid": `replace-sent-${name}`,
        onclick: async () => {
          if (!(await confirmed(app, byFile(name), "Replace").catch(app.complain))) return;
          item.remove();
          void take([file], name);
        } }));
      item.append(" ", h("button", { type: "button", class: "small", text: "Close", onclick: () => item.remove() }));
    };
    return async () => {
      // of what is known to be there nothing is sent in vain
      if (!as && isThere(name)) {
        refused("there is one already: replace it, or give this one another name", true);
        return;
      }
      try {
        const answer = await app.api.upload(`api/runs/${encodeURIComponent(name)}${as ? "?replace=true" : ""}`, file, (part) => {
          text.textContent = `${name}: sending, ${Math.round(100 * part)} %`;
        });
        if (answer.job) {
          text.textContent = `${name}: arrived; the raw capture is being decoded`;
          await app.api.follow(jobId(answer));
        }
        text.textContent = `${name}: arrived`;
        if (!closed) await read();
        item.remove();
      } catch (cause) {
        refused(cause.message, cause.status === 409);
        if (!closed) await read();
      }
    };
  }

  const isThere = (name) => runs.some((run) => run.file === name) || describing().some(([file]) => file === name);
  const byFile = (file) => runs.find((run) => run.file === file)?.name ?? file;

  async function read() {
    try {
      runs = await app.api.get("api/runs?wait=false");
    } catch (cause) {
      app.complain(cause);
    }
    if (!closed) draw();
  }

  files.addEventListener("change", () => void take(files.files));
  let inside = 0;
  const over = (event) => {
    if (![...(event.dataTransfer?.types ?? [])].includes("Files")) return;
    event.preventDefault();
    if (event.type === "dragenter") inside += 1;
    if (event.type === "dragleave") inside -= 1;
    drop.classList.toggle("over", event.type !== "drop" && inside > 0);
    if (event.type === "drop") {
      inside = 0;
      void take(event.dataTransfer.files);
    }
  };
  // the whole page takes files: a drop beside the zone must not make the browser open the log instead of the workbench
  const kinds = ["dragenter", "dragover", "dragleave", "drop"];
  for (const kind of kinds) document.addEventListener(kind, over);
  const off = app.on((patch) => {
    if ("study" in patch && !making) void read();
  });
  body.append(h("tr", null, h("td", { colspan: 8, class: "empty", text: "Reading what is in the study's folder …" })));
  await read();
  return () => {
    closed = true;
    off();
    for (const kind of kinds) document.removeEventListener(kind, over);
    document.removeEventListener("keydown", escape);
  };
}

function count(channels) {
  const n = Array.isArray(channels) ? channels.length : channels;
  return Number.isFinite(n) ? String(n) : "show";
}

function quality(run) {
  const mark = { good: "✓", flagged: "!", "cannot be read": "✕", [READING]: "…" }[run.quality] ?? "?";
  const kind = { good: "good", flagged: "warn", "cannot be read": "bad", [READING]: "muted" }[run.quality] ?? "warn";
  return h("span", { class: kind }, h("span", { "aria-hidden": "true", text: `${mark} ` }), run.quality ?? "not known");
}

function total(value) {
  if (typeof value === "number") return value;
  if (value && typeof value === "object") return Object.values(value).reduce((sum, v) => sum + total(v), 0);
  return 0;
}

function lost(value) {
  return total(value) > 0;
}

function losses(value) {
  if (value === null || value === undefined) return "not known";
  if (!lost(value)) return "none";
  if (typeof value === "number") return String(value);
  return Object.entries(value)
    .filter(([, v]) => lost(v))
    .map(
      ([name, v]) =>
        `${name}: ${
          typeof v === "number"
            ? v
            : Object.entries(v)
                .map(([cause, n]) => `${n} ${cause}`)
                .join(", ")
        }`,
    )
    .join("; ");
}

function flagged(channel) {
  if (!channel.flagged) return "0";
  if (!channel.samples) return String(channel.flagged);
  return `${channel.flagged} (${((100 * channel.flagged) / channel.samples).toFixed(1)} %)`;
}
