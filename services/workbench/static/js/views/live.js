/** Live: the channels of a car that is recording now, and how well each arrives. */

import { h } from "../widgets/dom.js";
import { term } from "../widgets/terms.js";
import { short } from "../widgets/format.js";
import { link } from "../charts/linked_axes.js";
import { timeChart } from "../charts/time_chart.js";
import { liveFit } from "./live_fit.js";

const SYNC = "live";
const FIRST = ["correvit.speed", "imu.accel"]; // channels shown as curves until others are chosen
const kept = { chosen: null }; // names of the channels that the user chose as curves
const TERMS = { Flagged: "flagged", Losses: "losses" };
const MARKS = { good: "✓", warn: "!", bad: "✕" };

/**
 * Show the view.
 * @param {HTMLElement} root
 * @param {Object} app
 * @returns {Promise<() => void>}
 */
export async function show(root, app) {
  const head = h("p", { class: "live-head", role: "status", text: "Asking for the car …" });
  const sum = h("p", { class: "live-sum", "data-testid": "live-channels" });
  const body = h("tbody");
  const text = h("input", { type: "text", id: "live-mark", maxlength: 120, placeholder: "slalom begins" });
  const marking = h(
    "form",
    { class: "bar", hidden: true },
    h("label", { for: "live-mark", text: "Marker" }),
    term(app, "marker"),
    text,
    h("button", { type: "submit", text: "Mark now" }),
  );
  const marked = h("p", { class: "muted", role: "status" });
  const marks = h("p", { class: "live-marks", hidden: true, "data-testid": "live-marks" });
  marking.addEventListener("submit", async (event) => {
    event.preventDefault();
    try {
      const found = await app.api.post("api/live/mark", { text: text.value });
      marked.textContent = `Marked “${found.text}” at ${found.seconds.toFixed(1)} s of the recording.`;
      text.value = "";
    } catch (cause) {
      marked.textContent = cause.message;
    }
  });
  const wanted = h("input", { type: "checkbox", id: "live-ill" });
  const sensors = h("ul", { class: "sensor-states", "data-testid": "live-sensors" });
  const states = h("div", { class: "sensor-bar", hidden: true }, h("span", null, "Sensors ", term(app, "sensor_state")), sensors);
  const curves = h("section", { class: "panel live-curves", hidden: true, "data-testid": "live-curves" });
  const steps = h("section", { class: "panel live-steps", hidden: true, "aria-label": "how to see a recording", "data-testid": "live-steps" });
  const charts = new Map();
  const fit = liveFit(app);
  let listed = null;
  let begun = false;
  let asking = false;
  let closed = false;
  root.append(
    h(
      "header",
      { class: "view-head" },
      h("h1", { text: "Live" }),
      h("p", {
        class: "muted",
        text: "What the car sends while it is recording: is every channel there, at its rate, without flags?",
      }),
    ),
    h("section", { class: "panel" }, head, sum, states, marking, marked, marks),
    steps,
    fit.element,
    curves,
    (listed = h(
      "section",
      { class: "panel flush", hidden: true },
      h(
        "div",
        { class: "bar inset" },
        h("label", { class: "check" }, wanted, h("span", { text: "only channels with something wrong" })),
      ),
      h(
        "div",
        { class: "scroll live-scroll" },
        h(
          "table",
          null,
          h(
            "thead",
            null,
            h(
              "tr",
              null,
              h("th", { scope: "col", text: "Curve" }),
              h("th", { scope: "col", text: "Channel" }),
              h("th", { scope: "col", text: "Unit" }),
              h("th", { scope: "col", text: "State" }),
              ["Rate", "Expected", "Last heard", "Flagged", "Losses"].map((text) =>
                h("th", { scope: "col", class: "num" }, `${text} `, TERMS[text] ? term(app, TERMS[text]) : null),
              ),
            ),
          ),
          body,
        ),
      ),
    )),
  );
  let last = null;

  function draw(live) {
    last = live;
    const channels = live.channels ?? [];
    const recording = live.recording ?? Boolean(live.run);
    marking.hidden = !(live.connected && recording);
    if (!live.connected) {
      head.textContent = live.run ? `Nothing more is heard: ${live.run}` : "No recording is heard";
      sum.textContent = live.endpoint ? `The page listens at ${live.endpoint}, and shows the car by itself once it is recorded.` : "";
    } else {
      const named = [live.manoeuvre, live.run].filter(Boolean).join(", ");
      head.textContent = recording
        ? `Recording: ${named}`
        : live.run
          ? `The run is over: ${named}`
          : "Connected; the car is not recording.";
      sum.textContent = `${live.endpoint ?? ""}: ${live.channels_text}.${lost(live.losses)}${live.down?.length ? ` Not heard at all: ${live.down.join(", ")}.` : ""}`;
    }
    listed.hidden = !channels.length;
    drawSteps(live.steps ?? []);
    drawSensors(live.sensors ?? []);
    const set = live.marks ?? [];
    link(SYNC).setMarks(set.map(({ seconds, text: label }) => ({ t: seconds, label })));
    marks.hidden = !set.length;
    marks.textContent = `Markers: ${set.map((one) => `${one.text} at ${one.seconds.toFixed(1)} s`).join(", ")}.`;
    if (live.connected && live.run && !begun) {
      begun = true;
      fit.element.hidden = false;
      void fit.begin();
    }
    void drawCurves();
    const shown = channels.filter((c) => !wanted.checked || c.state.kind !== "good");
    const focused = document.activeElement?.dataset?.testid; // the lines are made anew each second
    body.replaceChildren(
      ...shown.map((c) => {
        return h(
          "tr",
          { "data-testid": `live-${c.name}` },
          h("td", null, h("input", { type: "checkbox", checked: drawn().has(c.name), disabled: !c.samples,
            "aria-label": `curve of ${c.name}`, "data-testid": `curve-${c.name}`, onchange: (e) => choose(c.name, e.target.checked) })),
          h("th", { scope: "row", class: "code", text: c.name }),
          h("td", { text: c.unit || "–" }),
          h("td", { class: c.state.kind }, h("span", { "aria-hidden": "true", text: `${MARKS[c.state.kind]} ` }), c.state.text),
          h("td", { class: "num", text: c.rate === null || c.rate === undefined ? "–" : `${short(c.rate, 3)} Hz` }),
          h("td", { class: "num", text: c.expected ? `${short(c.expected, 3)} Hz` : "–" }),
          h("td", {
            class: "num",
            text: c.age === null || c.age === undefined ? "never" : `${c.age.toFixed(1)} s ago`,
          }),
          h("td", {
            class: "num",
            text:
              typeof c.flagged === "number" && c.flagged > 0 && c.flagged < 1
                ? `${(100 * c.flagged).toFixed(1)} %`
                : String(c.flagged ?? 0),
          }),
          h("td", {
            class: "num",
            text:
              typeof c.losses === "object" && c.losses
                ? Object.entries(c.losses)
                    .map(([k, n]) => `${n} ${k}`)
                    .join(", ") || "0"
                : String(c.losses ?? 0),
          }),
        );
      }),
    );
    if (focused?.startsWith("curve-")) body.querySelector(`[data-testid="${CSS.escape(focused)}"]`)?.focus();
    if (!shown.length)
      body.append(
        h(
          "tr",
          null,
          h("td", {
            colspan: 9,
            class: "empty",
            text: channels.length ? "No channel has anything wrong." : "No channel has been heard.",
          }),
        ),
      );
  }

  /** What to do where there is nothing to show. */
  function drawSteps(list) {
    steps.hidden = !list.length;
    const key = JSON.stringify(list);
    if (steps.dataset.of === key) return; // what is selected in it to be copied stays selected
    steps.dataset.of = key;
    steps.replaceChildren(...list.map(({ says, commands }) => h("div", null, h("p", { text: `${says}${commands.length ? ":" : "."}` }),
      commands.map((text) => h("pre", { class: "command", tabindex: 0, text })))));
  }

  /** What the recorder says of each sensor. */
  function drawSensors(list) {
    states.hidden = !list.length;
    sensors.replaceChildren(...list.map(({ name, state, detail }) => {
      const good = state === "running";
      return h("li", { class: good ? "good" : state === "waiting" ? "muted" : "bad" },
        h("span", { "aria-hidden": "true", text: good ? "✓ " : state === "waiting" ? "… " : "✕ " }), `${name}: ${state}${detail ? ` (${detail})` : ""}`);
    }));
  }

  /** Channels drawn as curves: the user's, or those of `FIRST` that the car has; the first second may have others alone. */
  function drawn() {
    if (kept.chosen) return kept.chosen;
    const channels = last?.channels ?? [];
    const there = FIRST.filter((name) => channels.some((c) => c.name === name));
    return new Set(there.length ? there : channels.filter((c) => c.samples).map((c) => c.name).slice(0, FIRST.length));
  }

  function choose(name, yes) {
    kept.chosen ??= drawn();
    if (yes) kept.chosen.add(name);
    else kept.chosen.delete(name);
    void drawCurves();
  }

  /** Asks for the chosen channels' last seconds, one question at a time. */
  async function drawCurves() {
    const names = [...drawn()];
    curves.hidden = !names.length;
    for (const [name, chart] of charts) {
      if (names.includes(name)) continue;
      chart.destroy();
      charts.delete(name);
    }
    if (!names.length || asking) return;
    asking = true;
    try {
      const { meta, arrays } = await app.api.binary(`api/live/curves?names=${names.map(encodeURIComponent).join(",")}`);
      if (closed) return;
      for (const [name, { unit, t, parts }] of Object.entries(meta.channels)) {
        if (!drawn().has(name)) continue;
        const series = Object.entries(parts).map(([part, array], k) => ({ name: part === "value" ? "measured" : part, values: arrays[array], colour: `--effect-${k}` }));
        if (!charts.has(name)) charts.set(name, timeChart(curves, { t: new Float32Array(0), series: [], title: name, sync: SYNC, height: 110, testid: `live-chart-${name}` }));
        charts.get(name).update({ t: arrays[t], unit, series, rough: true });
      }
    } catch {
      // the next second asks again
    } finally {
      asking = false;
    }
  }

  wanted.addEventListener("change", () => last && draw(last));
  const off = app.on((patch) => {
    if (patch.live) draw(patch.live);
    if (patch.liveFit) fit.update(patch.liveFit);
    if ("version" in patch && begun) void fit.begin();
  });
  try {
    draw(await app.api.get("api/live"));
  } catch (cause) {
    head.textContent = cause.message;
  }
  return () => {
    closed = true;
    off();
    for (const chart of charts.values()) chart.destroy();
  };
}

/** @param {Object|undefined} losses by bus and cause @returns {string} them in words */
function lost(losses) {
  const parts = Object.entries(losses ?? {}).flatMap(([bus, causes]) =>
    Object.entries(typeof causes === "object" && causes ? causes : { lost: causes })
      .filter(([, n]) => n > 0)
      .map(([cause, n]) => `${bus}: ${n} ${cause}`),
  );
  return parts.length ? ` Lost: ${parts.join("; ")}.` : "";
}
