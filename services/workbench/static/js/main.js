/** The workbench page: views, keyboard, theme, and what the views share (`app`). */

import * as api from "./net/api.js";
import { h } from "./widgets/dom.js";
import { createJobs } from "./net/jobs.js";
import { installKeys } from "./widgets/keys.js";
import { createRail } from "./widgets/rail.js";
import { createJobBar, createToasts } from "./widgets/shell.js";
import { createTour } from "./widgets/tour.js";
import { createState, LAYOUT, readHash, rowsOf, runsOf, writeHash } from "./net/state.js";

const VIEWS = {
  runs: { title: "Runs", load: () => import("./views/runs.js") },
  compare: { title: "Compare", load: () => import("./views/compare.js") },
  where: { title: "Where it fails", load: () => import("./views/where.js") },
  missing: { title: "What is missing", load: () => import("./views/missing.js") },
  falls: { title: "The error falls", load: () => import("./views/error_history.js") },
  car: { title: "The car", load: () => import("./views/car_values.js") },
  live: { title: "Live", load: () => import("./views/live.js") },
};
const NAMES = Object.keys(VIEWS);

const { state, set, on, notify } = createState();
const main = document.getElementById("main");
let shown = { view: "", close: null };
let turn = 0;
let addressTimer = 0;

const jobs = createJobs({
  onJobs: (all) => bar.jobs(all),
  onJob: (job) => {
    bar.job(job);
    notify({ job });
  },
  onStudy: () => void readStudy(),
  onLive: (live) => notify({ live }),
  onLiveFit: (liveFit) => notify({ liveFit }),
  onLink: (up) => bar.link(up),
});
const bar = createJobBar(document.getElementById("jobs"), {
  cancel: (id) => jobs.cancel(id).catch(complain),
  again: (job) => api.post("api/jobs", { do: job.do, args: job.args }).catch(complain),
});

const toast = createToasts(document.getElementById("toasts"), bar.say);

/** What the views are given. */
const app = {
  api: {
    get: api.get,
    post: api.post,
    remove: api.remove,
    binary: api.binary,
    upload: api.upload,
    run: jobs.run,
    follow: jobs.follow,
    cancel: jobs.cancel,
  },
  state,
  set: choose,
  on,
  go,
  toast,
  palette,
  complain,
  refresh: readStudy,
  rows: () => rowsOf(state.study, state.version),
  runs: () => runsOf(state.study),
  views: NAMES,
  tour: () => document.getElementById("tour-button").click(),
};

function choose(patch) {
  const before = state.study;
  set(patch);
  if (state.study !== before) fitChoice();
  if (["run", "row", "t0", "t1", ...LAYOUT].some((key) => key in patch)) keepAddress();
}

function keepAddress() {
  // zooming by wheel makes many changes, and browsers limit how often an address may change
  clearTimeout(addressTimer);
  addressTimer = setTimeout(() => {
    const hash = writeHash(shown.view || "runs", state);
    if (hash !== location.hash) history.replaceState(null, "", hash);
    links();
  }, 150);
}

function go(view, patch = {}) {
  set(patch);
  const hash = writeHash(view, state);
  if (location.hash === hash) void route();
  else location.hash = hash;
}

function complain(cause) {
  if (cause?.name === "AbortError" || cause?.constructor?.name === "Cancelled") return;
  toast(cause?.message ?? String(cause), "error");
}

async function readStudy() {
  try {
    const study = await api.get("api/study");
    const version = study.exists ? study.current : null;
    Object.assign(state, { study, version });
    fitChoice();
    notify({ study, version });
    heading();
  } catch (cause) {
    complain(cause);
  }
}

/** A run or row that the study does not have (another study, an old address) gives way to the worst. */
function fitChoice() {
  const rows = rowsOf(state.study, state.version);
  if (!rows.length) return;
  const patch = {};
  const worst = rows.reduce((a, b) => (b.ratio > a.ratio ? b : a));
  const row = rows.find((r) => r.row === state.row) ?? worst;
  if (row.row !== state.row) patch.row = row.row;
  const runs = runsOf(state.study);
  if (!runs.includes(state.run)) patch.run = runs.includes(row.worst_run) ? row.worst_run : (runs[0] ?? null);
  if (Object.keys(patch).length) {
    set(patch);
    keepAddress();
  }
}

async function route() {
  const { view, patch } = readHash(location.hash);
  if (!VIEWS[view]) {
    location.replace(writeHash(state.study?.exists && view === "" ? "compare" : "runs", state));
    return;
  }
  // an address without a run or row leaves the choice as it is; without a window it means the whole run
  for (const key of ["run", "row"]) if (patch[key] === null) delete patch[key];
  set(patch);
  fitChoice();
  if (view === shown.view) {
    links();
    return;
  }
  const mine = ++turn;
  shown.close?.();
  shown = { view, close: null };
  links();
  document.title = `${VIEWS[view].title} · lacet`;
  const root = h("div", { class: `view view-${view}`, "data-view": view });
  main.replaceChildren(root);
  main.scrollTop = 0;
  try {
    const module = await VIEWS[view].load();
    if (mine !== turn) return;
    const close = await module.show(root, app);
    if (mine === turn) shown.close = close;
    else close?.();
  } catch (cause) {
    if (mine !== turn) return;
    console.error(cause);
    root.append(h("p", { class: "notice bad", role: "alert", text: `This view could not be drawn: ${cause.message}` }));
  }
}

function links() {
  const tabs = document.getElementById("tabs");
  if (!tabs.childElementCount) {
    tabs.append(
      ...NAMES.map((name, k) =>
        h(
          "a",
          {
            href: `#/${name}`,
            "data-testid": `nav-${name}`,
            "aria-keyshortcuts": String(k + 1),
            data: { view: name },
          },
          h("span", { class: "key", "aria-hidden": "true", text: String(k + 1) }),
          VIEWS[name].title,
        ),
      ),
    );
  }
  for (const link of tabs.children) {
    link.href = writeHash(link.dataset.view, state);
    if (link.dataset.view === shown.view) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
}

function heading() {
  const { study } = state;
  document.getElementById("study-name").textContent = study.name || "no study";
  document.getElementById("study-name").title = study.folder ?? "";
  const version = study.versions?.find((v) => v.version === study.current);
  const list = Object.keys(version?.effects ?? {});
  const added = list.length ? `${list.length} effect${list.length > 1 ? "s" : ""}` : "base model";
  const text = version ? `Version ${version.version} of ${study.versions.length}: ${added}` : "no model yet";
  const place = document.getElementById("version");
  place.textContent = text;
  place.title = version ? ["base model", ...list].join(" + ") : "";
  bar.study(study);
}

/**
 * Colours of the present theme, for what is drawn on a canvas.
 * @returns {{measured: string, modelled: string, residual: string, floor: string, effect: string[]}}
 */
function palette() {
  const style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue(`--${name}`).trim();
  return {
    measured: colour("measured"),
    modelled: colour("modelled"),
    residual: colour("residual"),
    floor: colour("floor"),
    effect: [0, 1, 2, 3, 4, 5, 6, 7].map((k) => colour(`effect-${k}`)),
    ink: colour("ink"),
    muted: colour("muted"),
    line: colour("line"),
    panel: colour("panel"),
    accent: colour("accent"),
    ramp: [0, 1, 2, 3, 4].map((k) => colour(`ramp-${k}`)),
  };
}

function theme(name, keep) {
  document.documentElement.dataset.theme = name;
  const button = document.getElementById("theme-button");
  button.textContent = name === "dark" ? "Light" : "Dark";
  button.setAttribute("aria-label", name === "dark" ? "Change to light colours" : "Change to dark colours");
  if (keep) {
    try {
      localStorage.setItem("lacet.theme", name);
    } catch {
      // not kept then: private windows
    }
    notify({ theme: name });
  }
}

function start() {
  theme(document.documentElement.dataset.theme, false);
  document
    .getElementById("theme-button")
    .addEventListener("click", () => theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark", true));
  createRail(document.getElementById("rail"), document.getElementById("car-button"), app);
  const tour = createTour(app, document.getElementById("tour-button"));
  installKeys(app, document.getElementById("keys-button"), () => shown.view);
  // the address is the view's: a link within the page would leave it
  document.querySelector(".skip").addEventListener("click", (event) => {
    event.preventDefault();
    main.focus();
  });
  window.addEventListener("hashchange", () => void route());
  set(readHash(location.hash).patch);
  links();
  readStudy().finally(() => {
    void route();
    void tour.resume();
  });
}

start();
