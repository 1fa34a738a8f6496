// Marked times of a chart: upright lines with a letter.

import { resolved } from "./colours.js";

/**
 * Draws marks over a chart.
 * @param {object} u uPlot
 * @param {Array<{t: number, label: string}>} marks
 */
export function drawMarks(u, marks) {
  if (!marks.length) return;
  const { ctx, bbox } = u;
  const px = devicePixelRatio || 1;
  ctx.save();
  ctx.fillStyle = ctx.strokeStyle = resolved("--accent");
  ctx.lineWidth = 1.5 * px;
  ctx.textAlign = "left";
  ctx.textBaseline = "alphabetic";
  ctx.font = `bold ${11 * px}px system-ui, sans-serif`;
  for (const { t, label } of marks) {
    if (t < u.scales.x.min || t > u.scales.x.max) continue;
    const x = Math.round(u.valToPos(t, "x", true));
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
    ctx.fillText(label, x + 3 * px, bbox.top + 11 * px);
  }
  ctx.restore();
}
