/** The ranked list of candidates: one line each, the chosen one in full beside its preview. */

import { h } from "../widgets/dom.js";
import { number, percent, short } from "../widgets/format.js";
import { term } from "../widgets/terms.js";

const FEW = 10;
const ANSWERS = {
  missing: { mark: "!", kind: "warn" },
  undecided: { mark: "?", kind: "" },
  "stands in": { mark: "≈", kind: "muted" },
  "implausible size": { mark: "×", kind: "muted" },
  "smaller than asked for": { mark: "<", kind: "muted" },
  "not needed": { mark: "–", kind: "muted" },
  "not testable": { mark: "·", kind: "muted" },
};

/**
 * @param {Object} app
 * @param {{effects: Map<string, Object>}} about the catalogue by effect
 * @param {{point: (candidate: Object|null, byHand: boolean) => void, add: (candidate: Object) => void}} act
 */
export function createRanking(app, about, act) {
  const body = h("tbody");
  const filter = h("input", {
    type: "search",
    placeholder: "filter",
    title: "by name or row",
    "aria-label": "filter the effects",
    class: "filter",
  });
  const which = h(
    "select",
    { "aria-label": "which answers" },
    ["all answers", ...Object.keys(ANSWERS)].map((t) =>
      h("option", { value: t, text: t }),
    ),
  );
  const more = h("button", { type: "button", class: "small", text: "Show all" });
  const head = [
    [
      "Effect and its estimate",
      "",
      "estimate with half of its 95 % interval and the sign physics expects; ties: what cannot be told apart from it on these runs",
    ],
    ["Answer", "", "", "answer"],
    ["Gain", "num", "RMS it takes away in its rows, in parts of the runs it was not fitted to, and the part of their weighted residual", "gain"],
    ["p", "num", "family-wise probability of such a fall by chance", "p"],
    ["Blocks", "num", "coverage: number of 2 s blocks it acts in", "blocks"],
    ["", ""],
  ];
  const element = h(
    "section",
    { class: "panel flush ranking", "aria-label": "Ranked effects" },
    h(
      "div",
      { class: "bar inset" },
      h("h2", { text: "Ranked" }),
      filter,
      which,
      h("span", { class: "end muted count" }),
      more,
    ),
    h(
      "div",
      { class: "scroll rank-scroll", tabindex: "0", role: "region", "aria-label": "ranked effects" },
      h(
        "table",
        { class: "rank-table" },
        h(
          "thead",
          null,
          h(
            "tr",
            null,
            head.map(([text, kind, title, key]) =>
              h("th", { scope: "col", class: kind, title: title || null }, `${text} `, key ? term(app, key) : null),
            ),
          ),
        ),
        body,
      ),
    ),
  );
  let diagnosis = null;
  let ready = false;
  let all = false;
  let chosen = null;
  let of = "";

  const wanted = () => {
    const text = filter.value.trim().toLowerCase();
    return (diagnosis?.candidates ?? []).filter(
      (c) =>
        (which.value === "all answers" || c.answer === which.value) &&
        (!text || `${c.effect} ${c.label}`.toLowerCase().includes(text) || c.rows.some((r) => r.includes(text))),
    );
  };

  function draw() {
    const found = wanted();
    const few = all || filter.value || which.value !== "all answers" ? found : found.slice(0, FEW);
    element.querySelector(".count").textContent = diagnosis ? `${few.length} of ${diagnosis.candidates.length}` : "";
    more.disabled = few.length === found.length && !all;
    more.textContent = all ? "Show few" : "Show all";
    body.replaceChildren(...few.map(line));
    if (!diagnosis)
      body.append(
        h(
          "tr",
          null,
          h("td", {
            colspan: 6,
            class: "empty",
            text: "Every effect of the catalogue is listed here, with its answer, once you have looked for what is missing.",
          }),
        ),
      );
    else if (!few.length)
      body.append(h("tr", null, h("td", { colspan: 6, class: "empty", text: "No effect fits this filter." })));
  }

  function line(c) {
    const answer = ANSWERS[c.answer] ?? { mark: "", kind: "" };
    const point = () => choose(c);
    const tested = c.answer !== "not testable";
    return h(
      "tr",
      {
        "data-testid": `candidate-${c.effect}`,
        tabindex: "0",
        class: chosen === c.effect ? "chosen" : "",
        "aria-label": `${c.label}: ${c.answer}. ${c.why}`,
        onfocus: point,
        onclick: point,
        onkeydown: (e) => {
          if (e.key === "Enter" && e.target === e.currentTarget && ready) act.add(c);
          const to =
            e.key === "ArrowDown"
              ? e.currentTarget.nextElementSibling
              : e.key === "ArrowUp"
                ? e.currentTarget.previousElementSibling
                : null;
          if (
            e.target === e.currentTarget &&
            e.key.startsWith("Arrow") &&
            (e.key === "ArrowDown" || e.key === "ArrowUp")
          ) {
            to?.focus();
            e.preventDefault();
          }
        },
      },
      h(
        "th",
        { scope: "row" },
        c.label,
        h("div", { class: "more" }, h("span", { class: "code", text: c.effect }), h("span", { text: estimates(c).join(", ") })),
        c.ties?.length
          ? h("div", {
              class: "more",
              text: `ties with ${c.ties.map((t) => `${t.effect} (${t.correlation.toFixed(2)})`).join(", ")}`,
            })
          : null,
      ),
      h("td", { class: answer.kind }, h("span", { "aria-hidden": "true", text: `${answer.mark} ` }), c.answer),
      h("td", { class: "num" }, tested ? `${short(c.gain_rms)} ${c.unit}` : "–", tested ? h("div", { class: "more", text: percent(c.gain) }) : null),
      h("td", { class: "num", text: tested && Number.isFinite(c.p) ? short(c.p, 2) : "–" }),
      h("td", { class: "num", text: Number.isFinite(c.coverage) ? short(c.coverage, 2) : "–" }),
      h(
        "td",
        { class: "act" },
        h("button", {
          type: "button",
          class: "small",
          "data-testid": `add-${c.effect}`,
          disabled: !ready,
          text: "Add",
          "aria-label": `Add ${c.label}`,
          onclick: (e) => {
            e.stopPropagation();
            act.add(c);
          },
        }),
      ),
    );
  }

  /** `k = 19 800 ± 80 N·m/rad`, with a word where the sign is not the one physics expects. */
  function estimates(c) {
    const parameters = about.effects.get(c.effect)?.parameters ?? [];
    const shown = c.values.slice(0, 2).map((value, k) => {
      const p = parameters[k];
      const sign =
        !p || p.expect === "any"
          ? ""
          : value > 0 === (p.expect === "positive")
            ? ", sign ✓"
            : `, ! ${p.expect} expected`;
      return `${number(value, c.half95?.[k])} ± ${number(c.half95?.[k], c.half95?.[k])} ${p?.unit ?? ""}${sign}`;
    });
    return c.values.length > 2 ? [...shown, `and ${c.values.length - 2} more`] : shown.length ? shown : ["–"];
  }

  function choose(c) {
    chosen = c.effect;
    for (const row of body.children) row.classList.toggle("chosen", row.dataset.testid === `candidate-${c.effect}`);
    act.point(c, true);
  }

  filter.addEventListener("input", draw);
  which.addEventListener("change", draw);
  more.addEventListener("click", () => {
    all = !all;
    draw();
  });

  return {
    element,
    /** Draw what changed; the list keeps focus and scrolling when the ranking is the same. */
    update(now, may, again = false) {
      const key = JSON.stringify([now?.best, now?.candidates?.length, app.state.version, now?.says]);
      if (key !== of || again) {
        const focus = document.activeElement?.dataset?.testid;
        of = key;
        diagnosis = now;
        ready = may;
        const first = now?.candidates?.[0] ?? null;
        const same = again && now?.candidates?.find((c) => c.effect === chosen);
        chosen = (same || first)?.effect ?? null;
        draw();
        act.point(same || first, false);
        if (focus) body.querySelector(`[data-testid="${focus}"]`)?.focus();
      } else if (may !== ready) {
        ready = may;
        for (const button of body.querySelectorAll("button")) button.disabled = !may;
      }
    },
  };
}
