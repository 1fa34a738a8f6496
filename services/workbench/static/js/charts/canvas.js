// A canvas that is sharp on every screen, follows its box and the theme, and reports where the pointer is.

import { onTheme } from "./colours.js";

/**
 * Puts a canvas of fixed height into a box and draws it whenever its width or the theme changes.
 * @param {HTMLElement} box
 * @param {number} height [px]
 * @param {(ctx: CanvasRenderingContext2D, width: number, height: number) => void} paint
 * @returns {{canvas: HTMLCanvasElement, width: () => number, draw: () => void, resize: (height: number) => void,
 *   destroy: () => void}}
 */
export function sharpCanvas(box, height, paint) {
  const canvas = document.createElement("canvas");
  canvas.className = "sharp";
  box.appendChild(canvas);
  let width = 0;
  let tall = height;
  let queued = 0;
  canvas.style.height = `${tall}px`;

  function now() {
    queued = 0;
    if (!width) return;
    const ratio = window.devicePixelRatio || 1;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(tall * ratio);
    const ctx = canvas.getContext("2d");
    ctx.scale(ratio, ratio);
    ctx.clearRect(0, 0, width, tall);
    ctx.font = FONT;
    paint(ctx, width, tall);
  }

  function draw() {
    queued ||= requestAnimationFrame(now);
  }

  const sized = new ResizeObserver((entries) => {
    const found = Math.floor(entries[0].contentRect.width);
    if (found === width) return;
    width = found;
    draw();
  });
  sized.observe(box);
  const off = onTheme(draw);
  return {
    canvas,
    width: () => width,
    draw,
    resize(to) {
      tall = to;
      canvas.style.height = `${tall}px`;
      draw();
    },
    destroy() {
      cancelAnimationFrame(queued);
      sized.disconnect();
      off();
      canvas.remove();
    },
  };
}

export const FONT = "12px system-ui, sans-serif";

/**
 * Reports where pointer and touch are on a canvas.
 * @param {HTMLCanvasElement} canvas
 * @param {{move: (x: number, y: number) => void, leave: () => void, pick?: (x: number, y: number) => void}} act in px
 */
export function pointer(canvas, act) {
  const at = (call) => (event) => {
    const box = canvas.getBoundingClientRect();
    call(event.clientX - box.left, event.clientY - box.top);
  };
  canvas.addEventListener("pointermove", at(act.move));
  canvas.addEventListener("pointerdown", at(act.move));
  canvas.addEventListener("pointerleave", act.leave);
  if (act.pick) canvas.addEventListener("click", at(act.pick));
}
