/** The run to drive next: the one that tells tied candidates apart, or shows an effect these runs cannot. */

import { h } from "../widgets/dom.js";
import { short } from "../widgets/format.js";
import { xyPlot } from "../charts/xy_plot.js";
import { term } from "../widgets/terms.js";

/**
 * @param {Object} app
 */
export function createNextRun(app) {
  const effect = h("select", { "aria-label": "to tell apart or to show" });
  const go = h("button", { type: "button", "data-testid": "next-run-go", disabled: true, text: "Find the run" });
  const says = h("div", {
    class: "next-says",
    role: "status",
    text: "Which run would tell tied effects apart, or show one that these runs cannot.",
  });
  const element = h(
    "section",
    { class: "panel next", "data-testid": "next-run", "aria-label": "Recommended next run" },
    h("h2", null, "Which run to drive next", term(app, "next")),
    h("div", { class: "bar" }, effect, go),
    says,
  );
  const box = h("div", { class: "next-picture" });
  let picture = null;
  let may = false;
  let asking = false;
  let of = "";

  async function ask() {
    asking = true;
    go.disabled = true;
    says.replaceChildren(h("p", { class: "muted", text: "Simulating the runs of the library …" }));
    try {
      const result = await app.api.run(
        "next",
        { effects: effect.value ? [effect.value] : [] },
        {
          onProgress: (job) => {
            says.replaceChildren(
              h("p", {
                class: "muted",
                text: `${job.text || "Simulating the runs of the library"} …`,
              }),
            );
          },
        },
      );
      show(result && "next" in result ? result.next : result);
    } catch (cause) {
      says.replaceChildren(h("p", { class: "muted", text: cause.message }));
    }
    asking = false;
    go.disabled = !may;
  }

  function show(found) {
    if (!found) {
      says.replaceChildren(
        h("p", {
          text: "Nothing is tied with the best candidate: no run is needed to tell them apart. Choose an effect to see which run would show it.",
        }),
      );
      return;
    }
    picture?.destroy();
    picture = null;
    const parts = [
      h("p", { text: found.says }),
      box,
      found.runs?.length
        ? h(
            "table",
            null,
            h(
              "thead",
              null,
              h(
                "tr",
                null,
                h("th", { scope: "col", text: "Run" }),
                h("th", { scope: "col", class: "num", text: "now" }),
                h("th", { scope: "col", class: "num", text: "then" }),
                h("th", { scope: "col", class: "num", text: "at least" }),
              ),
            ),
            h(
              "tbody",
              null,
              found.runs
                .slice(0, 4)
                .map((r) =>
                  h(
                    "tr",
                    null,
                    h("th", { scope: "row", text: r.run }),
                    h("td", { class: "num", text: short(found.now, 2) }),
                    h("td", { class: "num", text: short(r.after, 2) }),
                    h("td", { class: "num", text: r.seconds ? `${r.seconds.toFixed(0)} s` : "–" }),
                  ),
                ),
            ),
          )
        : null,
      found.runs?.length
        ? h("p", {
            class: "sub muted",
            text: `${found.quantity === "size" ? "How far it would stand out of its noise" : "Separation"}; ${short(found.needed, 2)} is needed.`,
          })
        : null,
      ...(found.warnings ?? []).map((w) => h("p", { class: "sub warn", text: w })),
    ];
    says.replaceChildren(...parts.filter(Boolean));
    draw(found.picture);
  }

  /** What the sizes may be, now and after the best run: a region for two effects, a bar for one. */
  function draw({ effects, now, after }) {
    if (!after) return;
    const alone = effects.length === 1;
    const edge = (points, y) => ({ x: points.map((p) => p[0]), y: points.map((p) => (alone ? y : p[1])) });
    const reach = Math.min(4, Math.max(0.5, ...after.flat().map((v) => Math.abs(v - 1)))) * 2;
    const range = [1 - reach, 1 + reach];
    picture = xyPlot(box, {
      title: "What these sizes may be, 95 %", height: alone ? 120 : 240, testid: "next-picture",
      x: { label: `${effects[0]} ÷ its size`, unit: "", range },
      y: alone ? { label: "", unit: "", range: [0, 3] } : { label: `${effects[1]} ÷ its size`, unit: "", range },
      items: [
        { kind: "line", name: "now", colour: "--residual", ...edge(now, 2), dash: [5, 3], width: 2 },
        { kind: "line", name: "after the run", colour: "--modelled", ...edge(after, 1), width: 2.4 },
      ],
    });
  }

  go.addEventListener("click", () => void ask());
  return {
    element,
    ready(now, diagnosis) {
      may = now && Boolean(diagnosis);
      go.disabled = !may || asking;
      const key = JSON.stringify((diagnosis?.candidates ?? []).map((c) => [c.effect, c.answer]));
      if (key === of) return;
      of = key;
      const groups = new Map(); // manoeuvre → effects that it would show
      for (const c of diagnosis?.candidates ?? []) {
        if (c.answer !== "not testable") continue;
        groups.set(c.shown_by, [...(groups.get(c.shown_by) ?? []), c.effect]);
      }
      effect.replaceChildren(
        h("option", {
          value: "",
          text: diagnosis ? "the best and those tied with it" : "look for what is missing first",
        }),
        ...[...groups.entries()]
          .sort((a, b) => b[1].length - a[1].length)
          .map(([shown, keys]) =>
            h("optgroup", { label: `shown by: ${shown || "other runs"}` }, keys.sort().map((key) => h("option", { value: key, text: key }))),
          ),
      );
      effect.disabled = !diagnosis;
    },
  };
}
