/** The car from above with what its axles do in roll: roll stiffness and load transfer as bars across them. */

import { h, s } from "../widgets/dom.js";
import { number } from "../widgets/format.js";

const WIDE = 300;
const TALL = 400;
const LONGEST = 150; // bar of the stiffer axle [px]
const AXLES = { front: 96, rear: 304 };
const STIFFNESS = [["roll_stiffness_springs", "springs", "part-0"], ["roll_stiffness_bars", "anti-roll bar", "part-1"]];
const TRANSFER = [["load_transfer_elastic", "springs and bar", "part-2"], ["load_transfer_geometric", "roll centre", "part-3"],
  ["load_transfer_unsprung", "unsprung", "part-4"]];

/**
 * Half of the 95 % interval of a derived value, the sensor sheet's tolerances included where they are asked for and known.
 * @returns {number}
 */
export function halfOf(d, sheet) {
  return (sheet ? d.half95_sheet : null) ?? d.half95;
}

/**
 * Draws the car; its numbers are rounded as in the tables beside it.
 * @param {Map<string, object>} at "kind place" → derived value
 * @param {boolean} sheet intervals with the sensor sheet
 * @returns {HTMLElement}
 */
export function drawing(at, sheet) {
  const said = (d) => `${number(d.value, halfOf(d, sheet))} ${d.unit}`;
  const get = (kind, place) => {
    const found = at.get(`${kind} ${place}`);
    return found?.determined ? found : null;
  };
  const gradient = get("roll_gradient", "car");
  return h("div", null, s("svg", { class: "car-numbers", viewBox: `0 0 ${WIDE} ${TALL}`, role: "img", "aria-label": about(get, said) },
    s("path", { class: "outline", d: `M90 60 Q90 14 150 12 Q210 14 210 60 L214 330 Q212 384 150 388 Q88 384 86 330 Z` }),
    s("path", { class: "glass", d: "M100 140 Q150 122 200 140 L192 172 Q150 162 108 172 Z M106 268 Q150 280 194 268 L198 290 Q150 304 102 290 Z" }),
    Object.entries(AXLES).flatMap(([axle, y]) => [
      s("path", { class: "axle", d: `M52 ${y} H248` }),
      ...[34, 248].map((x) => s("rect", { class: "tyre", x, y: y - 34, width: 18, height: 68, rx: 5 })),
      ...bars("roll stiffness", STIFFNESS, "roll_stiffness", axle, y - 14, get, said),
      ...bars("load transfer", TRANSFER, "load_transfer", axle, y + 34, get, said),
    ]),
    gradient ? s("text", { class: "middle", x: WIDE / 2, y: 216, "text-anchor": "middle", text: `rolls ${said(gradient)}` }) : null,
    s("text", { class: "small", x: WIDE / 2, y: 34, "text-anchor": "middle", text: "front" })),
  keys("roll stiffness", STIFFNESS), keys("load transfer", TRANSFER));
}

/** What the colours of a bar's parts are. */
function keys(title, parts) {
  return h("p", { class: "car-key" }, `${title}: `, parts.map(([, words, colour]) => [h("span", null, h("i", { class: colour }), words), " "]));
}

/** A bar in parts, as long as its axle's value beside the larger of both axles; its number above it. */
function bars(title, parts, whole, axle, y, get, said) {
  const own = get(whole, axle);
  if (!own) return [];
  const most = Math.max(...["front", "rear"].map((a) => Math.abs(get(whole, a)?.value ?? 0)));
  const scale = LONGEST / most;
  let x = WIDE / 2 - (scale * Math.abs(own.value)) / 2;
  const out = [s("text", { class: "small", x: WIDE / 2, y: y - 4, "text-anchor": "middle", text: `${title} ${said(own)}` })];
  for (const [kind, words, colour] of parts) {
    const part = get(kind, axle);
    if (!part || !part.value) continue;
    const width = scale * Math.abs(part.value);
    out.push(s("rect", { x, y, width, height: 12, class: `part ${colour}` },
      s("title", { text: `${words}: ${said(part)}` })));
    x += width;
  }
  return out;
}

function about(get, said) {
  const parts = ["front", "rear"].flatMap((axle) => ["roll_stiffness", "load_transfer"].map((kind) => {
    const d = get(kind, axle);
    return d ? `${axle} ${d.label} ${said(d)}` : "";
  }));
  return `the car from above: ${parts.filter(Boolean).join(", ") || "no roll values determined"}`;
}
