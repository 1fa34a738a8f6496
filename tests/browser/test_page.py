"""The page as an instrument: keyboard, focus, contrast, nothing that moves by itself, both themes, a tablet."""

from __future__ import annotations

import re
from typing import Any

import pytest

from tests.browser.bench import LONG, Opened, Watch

VIEWS = ("runs", "compare", "where", "missing", "falls", "live")
THEMES = ("light", "dark")
_CONTRAST = """
() => {
  const rgba = (text) => {
    const parts = text.match(/[\\d.]+/g)?.map(Number) ?? [0, 0, 0, 0];
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
      const svg = at instanceof SVGGElement ? at.querySelector(':scope > rect') : null;
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
"""
_RING = """
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
"""


def _settled(watch: Watch, view: str) -> None:
    """A view with all that it shows."""
    watch.go(view)
    watch.page.wait_for_selector(f"[data-view={view}] > *")
    watch.page.wait_for_function(
        "document.querySelector('[data-testid=job-bar]').dataset.state === 'idle'", timeout=LONG
    )
    watch.quiet(900)


@pytest.mark.parametrize("theme", THEMES)
def test_contrast_and_pictures(opened: Opened, theme: str) -> None:
    watch = opened(theme=theme)
    for view in VIEWS:
        _settled(watch, view)
        found = watch.page.evaluate(_CONTRAST)
        assert found["seen"] > 20, view
        assert not found["out"], (view, found["out"])
        watch.picture(f"{theme}-{view}")
    line = watch.page.evaluate(
        """() => { const s = getComputedStyle(document.documentElement); return ['accent', 'panel', 'page'].map((n) =>
        s.getPropertyValue('--' + n).trim()); }"""
    )
    ring, *grounds = ([int(c[k : k + 2], 16) for k in (1, 3, 5)] for c in line)
    assert all(_ratio(ring, ground) >= 3.0 for ground in grounds)


def _ratio(a: list[int], b: list[int]) -> float:
    def light(colour: list[int]) -> float:
        parts = [x / 255 / 12.92 if x / 255 <= 0.03928 else ((x / 255 + 0.055) / 1.055) ** 2.4 for x in colour]
        return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2]

    low, high = sorted((light(a), light(b)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (820, 1180)])
def test_nothing_moves_and_nothing_is_cut(opened: Opened, width: int, height: int) -> None:
    watch = opened(width, height)
    for view in VIEWS:
        _settled(watch, view)
        shifts = watch.shifts()
        assert sum(s["value"] for s in shifts) < 0.05, (view, shifts)
        wide = watch.page.evaluate(
            "() => [document.scrollingElement, document.getElementById('main')].map((e) => e.scrollWidth - e.clientWidth)"
        )
        assert max(wide) <= 1, (view, wide)
        watch.picture(f"{width}-{view}")


def test_keyboard_only(opened: Opened) -> None:
    watch = opened()
    page = watch.page
    _settled(watch, "runs")
    for key, view in enumerate(VIEWS, 1):
        page.keyboard.press(str(key))
        page.wait_for_url(re.compile(f"#/{view}"))
        assert page.locator("#tabs [aria-current=page]").get_attribute("data-view") == view
    page.keyboard.press("4")
    rows = page.evaluate("[...document.querySelectorAll('.row-list [data-row]')].map((e) => e.dataset.row)")
    first = page.locator(".row-list [aria-selected=true]").get_attribute("data-row")
    page.keyboard.press("ArrowDown")
    now = page.locator(".row-list [aria-selected=true]").get_attribute("data-row")
    assert now == rows[(rows.index(first) + 1) % len(rows)]
    run = watch.at("run-select").input_value()
    page.keyboard.press("ArrowRight")
    assert watch.at("run-select").input_value() != run
    page.keyboard.press("/")
    page.wait_for_function("document.activeElement?.dataset.testid === 'own-line'")
    page.keyboard.type("2 4 ?")
    assert watch.at("own-line").input_value() == "2 4 ?"
    assert "#/missing" in page.url
    page.keyboard.press("Escape")
    page.keyboard.press("?")
    assert page.locator("dialog.keys").is_visible()
    page.keyboard.press("Escape")
    assert not page.locator("dialog.keys").is_visible()
    page.keyboard.press("t")
    assert page.locator("html").get_attribute("data-theme") == "dark"
    page.reload()
    assert page.locator("html").get_attribute("data-theme") == "dark"


@pytest.mark.parametrize("view", ["runs", "missing", "falls"])
def test_focus_is_seen_wherever_tab_goes(opened: Opened, view: str) -> None:
    watch = opened()
    _settled(watch, view)
    names: list[str] = []
    for _ in range(70):
        watch.page.keyboard.press("Tab")
        found: dict[str, Any] | None = watch.page.evaluate(_RING)
        if found is None or found["name"] in names[:1]:
            break
        assert found["wide"] >= 2.0, found
        assert found["seen"], found
        names.append(found["name"])
    assert len(names) > 30, names
    wanted = {"runs": "choose-files", "missing": "own-line", "falls": "export-csv"}[view]
    assert wanted in names, names
    assert any(name.startswith("car-") for name in names)


def test_a_row_chosen_with_the_keyboard_on_the_car(opened: Opened) -> None:
    watch = opened()
    _settled(watch, "missing")
    watch.at("car-tyre.rr").focus()
    watch.page.keyboard.press("Enter")
    assert watch.page.locator(".row-list [aria-selected=true]").get_attribute("data-row") == "tyre.rr"
    assert watch.at("car-tyre.rr").get_attribute("aria-pressed") == "true"


def test_a_tablet(opened: Opened) -> None:
    watch = opened(820, 1180, touch=True)
    _settled(watch, "missing")
    assert not watch.page.locator("#rail").is_visible()
    watch.page.locator("#car-button").tap()
    watch.at("car-suspension.rl").tap()
    assert watch.at("car-suspension.rl").get_attribute("aria-pressed") == "true"
    watch.picture("tablet-car")
    watch.page.locator("#car-button").tap()
    small = watch.page.evaluate(
        """() => [...document.querySelectorAll('button, select, a, input')].filter((e) => e.checkVisibility() && !e.closest('.sr, .skip'))
        .map((e) => [e.textContent || e.id, e.getBoundingClientRect()]).filter(([, b]) => b.width > 0 && (b.height < 24 || b.width < 17))
        .map(([t, b]) => `${t} ${b.width}x${b.height}`)"""
    )
    assert not small, small


def test_a_locale_that_no_browser_knows(opened: Opened) -> None:
    watch = opened(locale="en-US@posix")
    _settled(watch, "compare")
    assert watch.at("chart-measured").locator("canvas").first.is_visible()
