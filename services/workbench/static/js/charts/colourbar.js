/** What the colours of a map stand for. */

import { sharpCanvas } from "./canvas.js";
import { resolved } from "./colours.js";
import { h } from "../widgets/dom.js";

const SIDE = 16;
const BAR = 12;

/**
 * A bar of colours with its ticks.
 * @param {HTMLElement} root
 * @param {string} label with its unit
 * @returns {{update: (scale: {at: (part: number) => string}, marks: Array<[number, string]>, label?: string) => void,
 *   destroy: () => void}} marks: place 0 to 1 and text
 */
export function colourBar(root, label) {
  const text = h("span", { class: "bar-label", text: label });
  const box = h("div", { class: "bar-box", role: "img", "aria-label": `colours: ${label}` });
  const element = h("div", { class: "colour-bar" }, text, box);
  root.append(element);
  let scale = null;
  let marks = [];
  const sheet = sharpCanvas(box, 32, (ctx, width) => {
    if (!scale) return;
    const long = width - 2 * SIDE;
    for (let x = 0; x < long; x += 1) {
      ctx.fillStyle = scale().at(x / (long - 1));
      ctx.fillRect(SIDE + x, 1, 1.5, BAR);
    }
    ctx.strokeStyle = resolved("--edge");
    ctx.strokeRect(SIDE + 0.5, 1.5, long - 1, BAR - 1);
    ctx.fillStyle = resolved("--chart-ink");
    ctx.textAlign = "center";
    ctx.textBaseline = "top";
    for (const [place, name] of marks) {
      const x = Math.round(SIDE + place * (long - 1)) + 0.5;
      ctx.beginPath();
      ctx.moveTo(x, BAR);
      ctx.lineTo(x, BAR + 4);
      ctx.stroke();
      ctx.fillText(name, x, BAR + 6);
    }
  });
  return {
    update(make, at, name) {
      scale = make;
      marks = at;
      if (name) {
        text.textContent = name;
        box.setAttribute("aria-label", `colours: ${name}`);
      }
      sheet.draw();
    },
    destroy: () => sheet.destroy(),
  };
}
