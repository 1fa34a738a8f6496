/** Charts of measured channels and of formulas in the states, on the time of the rows. */

import { timeChart } from "../charts/time_chart.js";
import { readChannels } from "../net/run_channels.js";
import { h } from "../widgets/dom.js";
import { veil } from "../widgets/pending.js";

const KEPT = 90; // series of two runs
const measured = new Map();

function keep(path, one) {
  measured.set(path, one);
  if (measured.size > KEPT) measured.delete(measured.keys().next().value);
}

/**
 * The charts beneath the rows.
 * @param {object} app
 * @param {{sync: string, onZoom: Function, onClose: (kind: string, name: string) => void, onDrawn: () => void}} act
 * @returns {{element: HTMLElement, show: (run: string, version: number, channels: string[], formulas: string[]) => Promise<void>,
 *   figures: () => object[], reveal: (name: string) => void, close: () => void}}
 */
export function channelCharts(app, { sync, onZoom, onClose, onDrawn }) {
  const element = h("div", { class: "channels" });
  const plots = new Map(); // "channel NAME" or "formula TEXT" → its chart
  let turn = 0;
  let reading = null;

  function box(kind, name) {
    const close = h("button", { type: "button", class: "small quiet stack-close", "aria-label": `Close the chart of ${name}`, text: "Close",
      onclick: () => onClose(kind, name) });
    const section = h("section", { class: "panel stack", "aria-label": `${kind} ${name}` }, close);
    element.append(section);
    const chart = timeChart(section, { t: new Float32Array(0), series: [], title: name, sync, height: 130, onZoom,
      testid: `chart-${kind}-${name}` });
    return { section, chart, veil: veil(section) };
  }

  function arrange(channels, formulas) {
    const wanted = [...channels.map((name) => ["channel", name]), ...formulas.map((name) => ["formula", name])];
    const keys = new Set(wanted.map((one) => one.join(" ")));
    for (const [key, plot] of plots) {
      if (keys.has(key)) continue;
      plot.chart.destroy();
      plot.section.remove();
      plots.delete(key);
    }
    for (const [kind, name] of wanted) if (!plots.has(`${kind} ${name}`)) plots.set(`${kind} ${name}`, box(kind, name));
  }

  function draw(found, mine) {
    if (mine !== turn) return;
    for (const [key, { t, parts, unit, rough }] of found) {
      const plot = plots.get(key);
      if (!plot) continue; // closed meanwhile
      plot.veil.clear();
      plot.chart.update({ t, unit, rough, series: parts.map(([part, values], k) =>
        ({ name: part === "value" ? "measured" : part, values, colour: `--effect-${k % 8}` })) });
    }
    onDrawn();
  }

  async function readFormula(run, version, text) {
    const path = `formula ${version} ${run} ${text}`;
    if (!measured.has(path)) {
      const { meta, arrays } = await app.api.binary(`api/formula/${version}/${encodeURIComponent(run)}?text=${encodeURIComponent(text)}`);
      keep(path, { t: arrays.t, parts: [["formula", arrays.values]], unit: meta.unit, rough: false });
    }
    return measured.get(path);
  }

  return {
    element,
    async show(run, version, channels, formulas) {
      const mine = ++turn;
      arrange(channels, formulas);
      reading?.abort();
      const path = (name) => `${run} ${name}`;
      draw(channels.filter((name) => measured.has(path(name))).map((name) => [`channel ${name}`, measured.get(path(name))]), mine);
      const fail = (key, cause) => mine === turn && cause.name !== "AbortError" && plots.get(key)?.veil.fail(cause);
      const lacking = channels.filter((name) => !measured.has(path(name)));
      const work = formulas.map((text) => readFormula(run, version, text).then((one) => draw([[`formula ${text}`, one]], mine))
        .catch((cause) => fail(`formula ${text}`, cause)));
      if (lacking.length) {
        reading = new AbortController();
        work.push(readChannels(run, lacking, (found) => {
          for (const [name, one] of found) if (!one.rough) keep(path(name), one);
          draw([...found].map(([name, one]) => [`channel ${name}`, one]), mine);
        }, reading.signal).catch((cause) => lacking.forEach((name) => fail(`channel ${name}`, cause))));
      }
      await Promise.all(work);
    },
    figures: () => [...plots.values()].map(({ chart }) => chart.figure()),
    reveal: (key) => plots.get(key)?.section.scrollIntoView({ block: "nearest" }),
    close() {
      turn += 1;
      reading?.abort();
      for (const plot of plots.values()) plot.chart.destroy();
    },
  };
}
