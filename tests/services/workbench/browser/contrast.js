// Texts whose contrast with what is behind them is below WCAG AA.
() => {
  const rgba = (text) => {
    const parts = text.match(/[\d.]+/g)?.map(Number) ?? [0, 0, 0, 0];
    return parts.length === 3 ? [...parts, 1] : parts;
  };
  const over = (top, under) => top.slice(0, 3).map((c, k) => c * top[3] + under[k] * (1 - top[3]));
  const light = (c) => {
    const [r, g, b] = c.map((x) => (x / 255 <= 0.03928 ? x / 255 / 12.92 : ((x / 255 + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const ratio = (a, b) => {
    const [x, y] = [light(a), light(b)].sort((p, q) => q - p);
    return (x + 0.05) / (y + 0.05);
  };
  const ground = (element) => {
    const layers = [];
    for (let at = element; at; at = at.parentElement) {
      const svg = at instanceof SVGGElement && at.getAttribute('role') === 'button' ? at.querySelector(':scope > rect') : null;
      const colour = rgba(svg ? getComputedStyle(svg).fill : getComputedStyle(at).backgroundColor);
      if (colour[3] > 0) layers.push(colour);
      if (colour[3] === 1) break;
    }
    return layers.reverse().reduce((under, top) => over(top, under), [255, 255, 255]);
  };
  const out = [];
  let seen = 0;
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const node = walker.currentNode;
    const element = node.parentElement;
    if (!node.textContent.trim() || !element.checkVisibility({ checkOpacity: true, checkVisibilityCSS: true })) continue;
    if (element.closest('script, style, noscript, title, option, .sr, .waiting, :disabled, [aria-disabled=true], [inert]')) continue;
    const style = getComputedStyle(element);
    let faded = 1;
    for (let at = element; at; at = at.parentElement) faded *= Number(getComputedStyle(at).opacity);
    if (faded < 1) continue;
    const size = parseFloat(style.fontSize);
    const large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
    const under = ground(element);
    const colour = over(rgba(element instanceof SVGElement ? style.fill : style.color), under);
    const found = ratio(colour, under);
    seen += 1;
    if (found < (large ? 3 : 4.5)) out.push(`${node.textContent.trim().slice(0, 40)}: ${found.toFixed(2)} (${element.className?.baseVal ?? element.className})`);
  }
  return { seen, out };
}
