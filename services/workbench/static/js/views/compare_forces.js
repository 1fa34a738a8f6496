/** Wheel forces of a run held out, estimated without dynamometers and drawn beside what these measured. */

import { h } from "../widgets/dom.js";

/**
 * A panel that is folded up at first: the picture is made when it is opened.
 * @returns {{element: HTMLElement, of: (path: string) => void}} `of` : the picture's address, "" for a run used
 */
export function forcesPanel() {
  let path = "";
  const picture = h("img", { class: "forces", alt: "wheel forces with their 95 % bands, and as measured", hidden: true,
    onload: () => say(""), onerror: () => say("No wheel forces: the run has no dynamometers, its rows do not give them, or lacet is at work.") });
  const note = h("p", { class: "notice", hidden: true });
  const box = h("details", { class: "panel", "data-testid": "wheel-forces", ontoggle: () => draw() },
    h("summary", { text: "Wheel forces of this run, estimated without its dynamometers" }), note, picture);
  const say = (text) => {
    note.textContent = text;
    note.hidden = !text;
    picture.hidden = Boolean(text);
  };
  const draw = () => {
    if (!box.open || !path || picture.getAttribute("src") === path) return;
    say("Estimating …");
    picture.setAttribute("src", path);
  };
  return {
    element: box,
    of: (wanted) => {
      box.hidden = !wanted;
      if (wanted === path) return;
      path = wanted;
      picture.removeAttribute("src");
      draw();
    },
  };
}
