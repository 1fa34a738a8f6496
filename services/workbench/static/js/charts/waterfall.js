/** The waterfall: how far above the noise floor every version stands, on the runs used and on those held out. */

import { h, s } from "../widgets/dom.js";
import { times } from "../widgets/format.js";

const WIDTH = 520;
const HEIGHT = 226;
const LEFT = 48;
const TOP = 22;
const FOOT = 58;
/** Columns narrower than this have upright values, and their note upright below, shortened in its middle. */
const NARROW = 76;
const DEEP = 130; // foot of such columns
const LETTERS = 15; // of such a note
const TICKS = [1, 2, 3, 5, 10, 20, 50, 100, 200, 500, 1000];

/**
 * @param {(version: number) => void} choose called with the version clicked
 * @returns {{element: SVGElement, update: (versions: Array<Object>, current: number|null, busy: boolean) => void}}
 */
export function createWaterfall(choose) {
  const element = s("svg", {
    viewBox: `0 0 ${WIDTH} ${HEIGHT}`,
    class: "waterfall",
    "data-testid": "waterfall",
    role: "group",
    "aria-label": "error ÷ noise floor by version; the floor is 1",
  });

  function update(versions, current, busy) {
    const errors = versions.flatMap((v) => [v.used_error, v.held_error]).filter((e) => Number.isFinite(e) && e > 0);
    const top = Math.max(2, ...errors) * 1.12;
    const low = Math.min(0.9, ...errors) * 0.97;
    const step = Math.min(120, (WIDTH - LEFT - 8) / Math.max(1, versions.length));
    const base = HEIGHT - (step < NARROW ? DEEP : FOOT);
    const head = step < NARROW ? TOP + 18 : TOP;
    // the floor is the foot of the bars and the scale is logarithmic: twice as high is the square, and 1 is nothing to see
    const y = (ratio) => base - ((Math.log(ratio) - Math.log(low)) / (Math.log(top) - Math.log(low))) * (base - head);
    const grid = TICKS.filter((t) => t < top)
      .filter((t, k, all) => k === 0 || y(all[k - 1]) - y(t) > 13 || t === 2 || t === 10)
      .map((t) =>
        s(
          "g",
          null,
          s("line", { class: t === 1 ? "floor" : "grid", x1: LEFT, x2: WIDTH - 4, y1: y(t), y2: y(t) }),
          s("text", {
            class: "axis",
            x: LEFT - 6,
            y: y(t) + 4,
            "text-anchor": "end",
            text: t === 1 ? "floor 1" : String(t),
          }),
        ),
      );
    const line = ancestry(versions, current);
    const bars = versions.map((v, k) =>
      column(v, LEFT + 4 + k * step, step, y, base, { current, busy, on: line.has(v.version) }),
    );
    element.replaceChildren(pattern(), ...grid, ...bars);
    if (!versions.length)
      element.append(
        s("text", {
          class: "axis",
          x: WIDTH / 2,
          y: HEIGHT / 2,
          "text-anchor": "middle",
          text: "The first bar shows once there is a model.",
        }),
      );
  }

  function column(v, x, step, y, base, { current, busy, on }) {
    const w = Math.min(34, step * 0.34);
    const narrow = step < NARROW;
    const mid = x + step / 2;
    const present = v.version === current;
    const words = `Version ${v.version}, ${v.note}: ${times(v.used_error)} on the runs used, ${times(v.held_error)} on those held out${v.runs_differ ? ", on other runs" : ""}${present ? "; the present version" : "; press to go there"}`;
    const group = s(
      "g",
      {
        class: `column${present ? " present" : ""}${on ? "" : " aside"}${v.runs_differ ? " other" : ""}`,
        role: "button",
        tabindex: "0",
        "aria-label": words,
        "aria-disabled": String(busy || present),
        "data-testid": `column-${v.version}`,
        onclick: () => choose(v.version),
        onkeydown: (e) => {
          if (e.key !== "Enter" && e.key !== " ") return;
          choose(v.version);
          e.preventDefault();
        },
      },
      s("title", { text: words }),
      s("rect", { class: "hit", x: x + 2, y: TOP - 18, width: step - 4, height: HEIGHT - TOP + 16, rx: 4 }),
    );
    const place = (x, y) =>
      narrow
        ? { x: x + 4, y, transform: `rotate(-90 ${x + 4} ${y})`, "text-anchor": "start" }
        : { x, y, "text-anchor": "middle" };
    const bar = (ratio, at, kind) => {
      if (!Number.isFinite(ratio) || ratio <= 0) return;
      const from = Math.min(y(1), y(ratio));
      const tall = Math.max(2, Math.abs(y(1) - y(ratio)));
      group.append(
        s("rect", { class: kind, x: at, y: from, width: w, height: tall }),
        s("text", { class: "value", ...place(at + w / 2, from - 4), text: times(ratio) }),
      );
    };
    bar(v.used_error, mid - w - 1, "used");
    bar(v.held_error, mid + 1, "held");
    group.append(
      s("text", {
        class: "number",
        x: mid,
        y: base + 16,
        "text-anchor": "middle",
        text: present && !narrow ? `${v.version} present` : String(v.version),
      }),
      ...(narrow
        ? [s("text", { class: "note", transform: `translate(${mid - 3} ${base + 22}) rotate(90)`, text: shortened(v.note) })]
        : lines(v.note, Math.floor(step / 6.8)).map((text, k) =>
            s("text", { class: "note", x: mid, y: base + 31 + 14 * k, "text-anchor": "middle", text }),
          )),
    );
    return group;
  }

  return { element, update };
}

/** A note without its verb, its beginning and its end: effects of one family differ in their place, at the end. */
function shortened(note) {
  const text = sign(note);
  if (text.length <= LETTERS) return text;
  const half = Math.floor((LETTERS - 1) / 2);
  return `${text.slice(0, half)}…${text.slice(-half)}`;
}

function sign(note) {
  return String(note ?? "")
    .replace(/^added /, "+ ")
    .replace(/^removed /, "− ");
}

/** What was done, in two lines of so many letters: `+ anti_roll_bar`, `.front`. */
function lines(note, fits) {
  const text = sign(note);
  const cut = (part) => (part.length > fits ? `${part.slice(0, Math.max(1, fits - 1))}…` : part);
  if (text.length <= fits) return [text];
  const dot = text.indexOf(".");
  const at = dot > 0 && dot <= fits ? dot : Math.max(text.lastIndexOf(" ", fits), 0) || fits;
  return [cut(text.slice(0, at)), cut(text.slice(at).trim())];
}

/** The two kinds of bars, to be read beside the title. */
export function legend() {
  const key = (kind, text) =>
    h(
      "span",
      { class: "key-entry" },
      s(
        "svg",
        { class: "waterfall key", viewBox: "0 0 16 12", "aria-hidden": "true" },
        s("rect", { class: kind, x: 1, y: 1, width: 14, height: 10 }),
      ),
      text,
    );
  return [key("used", "runs used"), key("held", "runs held out")];
}

/** Held out differs from used by stripes too, for eyes and screens that show little colour. */
function pattern() {
  return s(
    "defs",
    null,
    s(
      "pattern",
      { id: "stripes", width: 6, height: 6, patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)" },
      s("rect", { class: "stripe-ground", width: 6, height: 6 }),
      s("rect", { class: "stripe", width: 2.6, height: 6 }),
    ),
  );
}

/** The versions the present one was made from: the others are pale. */
function ancestry(versions, current) {
  const by = new Map(versions.map((v) => [v.version, v]));
  const out = new Set();
  for (let at = by.get(current); at && !out.has(at.version); at = by.get(at.parent)) out.add(at.version);
  return out;
}
