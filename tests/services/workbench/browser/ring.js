// What has the focus, how wide its ring is [px], and whether it is in sight.
() => {
  const at = document.activeElement;
  if (!at || at === document.body) return null;
  const style = getComputedStyle(at);
  const part = at instanceof SVGGElement ? getComputedStyle(at.querySelector('rect')) : null;
  const label = at.closest('label');
  const around = label ? getComputedStyle(label) : null;
  const wide = Math.max(
    style.outlineStyle !== 'none' ? parseFloat(style.outlineWidth) : 0,
    part && part.stroke !== 'none' ? parseFloat(part.strokeWidth) : 0,
    around && around.outlineStyle !== 'none' ? parseFloat(around.outlineWidth) : 0,
  );
  const box = at.getBoundingClientRect();
  return { name: at.dataset.testid || at.id || at.getAttribute('aria-label') || at.textContent.slice(0, 30), wide,
    seen: box.width > 0 && box.bottom > 0 && box.top < innerHeight };
}
