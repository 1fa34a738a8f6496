"""The page as an instrument: keyboard, focus, contrast, nothing that moves by itself, both themes, a tablet."""

from __future__ import annotations

import itertools
import re
from pathlib import Path
from typing import Any

import pytest

from tests.services.workbench.browser.bench import LONG, Opened, Watch

VIEWS = ("runs", "compare", "where", "missing", "falls", "car", "live")
THEMES = ("light", "dark")
_DRAWN = """() => [...document.querySelectorAll('.curves canvas')].map((c) => {
  const { data } = c.getContext('2d').getImageData(0, 0, c.width, c.height);
  let n = 0;
  for (let i = 3; i < data.length; i += 4) n += data[i] > 0;
  return n;
})"""
"""Pixels drawn of each curve of a report."""
_CUT = """() => {
  const boxes = [...document.querySelectorAll('.car, .runs-scroll, .car-place, .top-right')]
    .filter((e) => e.checkVisibility());
  const out = boxes.flatMap((box) => [...box.querySelectorAll('.chip, th, button, text, .car-key')].filter((e) => {
    const [a, b] = [e.getBoundingClientRect(), box.getBoundingClientRect()];
    return a.width && (a.bottom > b.bottom + 1 || a.right > b.right + 1);
  }));
  return out.map((e) => e.outerHTML.slice(0, 90));
}"""
"""What reaches beyond the picture or table that it is in."""
_PARTS = ("ranking", "missing-side", "missing-more")
"""What stands side by side in the view of what is missing."""
_CONTRAST, _RING, _SMALL = (
    (Path(__file__).parent / f"{name}.js").read_text(encoding="utf-8") for name in ("contrast", "ring", "small")
)


def _settled(watch: Watch, view: str) -> None:
    """A view with all that it shows."""
    watch.go(view)
    watch.page.wait_for_selector(f"[data-view={view}] > *")
    watch.expect(watch.at("job-bar")).to_have_attribute("data-state", "idle", timeout=LONG)
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


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (1024, 768), (820, 1180)])
def test_nothing_moves_and_nothing_is_cut(opened: Opened, width: int, height: int) -> None:
    watch = opened(width, height)
    for view in VIEWS:
        _settled(watch, view)
        shifts = watch.shifts()
        assert sum(s["value"] for s in shifts) < 0.05, (view, shifts)
        wide = watch.page.evaluate(
            "['html', '#main'].map((s) => document.querySelector(s)).map((e) => e.scrollWidth - e.clientWidth)"
        )
        assert max(wide) <= 1, (view, wide)
        assert not watch.page.evaluate(_CUT), (view, watch.page.evaluate(_CUT))
        watch.picture(f"{width}-{view}")


def test_a_wide_screen_is_filled(opened: Opened) -> None:
    """Ranking, preview and what else there is stand beside each other; the version's name is not cut anywhere."""
    watch = opened(2560, 1440)
    _settled(watch, "missing")
    boxes = [watch.page.locator(f".view-missing .{name}").bounding_box() for name in _PARTS]
    edges = [(box["x"], box["x"] + box["width"]) for box in boxes if box]
    assert len(edges) == len(_PARTS)
    assert all(before[1] <= after[0] for before, after in itertools.pairwise(edges)), edges
    assert edges[-1][1] > 2500
    assert all(box and box["y"] < 600 for box in boxes), "side by side"
    assert boxes[-1]
    assert boxes[-1]["width"] > 560
    watch.picture("2560-missing")


def test_the_version_is_not_cut(opened: Opened) -> None:
    """Beside the tabs of a small window, of a model with several effects."""
    watch = opened(1280, 720)
    effects = [f"anti_roll_bar.{k}" for k in range(12)]
    watch.page.route("**/api/study", lambda route: route.fulfill(json=_with_effects(route.fetch().json(), effects)))
    watch.go("missing")
    place = watch.page.locator("#version")
    watch.expect(place).to_have_text("Version 1 of 1: 12 effects")
    assert place.evaluate("(e) => e.scrollWidth <= e.clientWidth"), "cut"
    assert "anti_roll_bar.11" in (place.get_attribute("title") or "")


def _with_effects(study: dict[str, Any], effects: list[str]) -> dict[str, Any]:
    for version in study["versions"]:
        version["effects"] = {key: {} for key in effects}
    return study


def test_keyboard_only(opened: Opened) -> None:
    watch = opened()
    page = watch.page
    _settled(watch, "runs")
    for key, view in enumerate(VIEWS, 1):
        page.keyboard.press(str(key))
        page.wait_for_url(re.compile(f"#/{view}"))
        # The page follows its address a moment later.
        watch.expect(page.locator("#tabs [aria-current=page]")).to_have_attribute("data-view", view)
    page.keyboard.press("4")
    watch.expect(page.locator("#tabs [aria-current=page]")).to_have_attribute("data-view", VIEWS[3])
    rows = page.evaluate("[...document.querySelectorAll('.row-list [data-row]')].map((e) => e.dataset.row)")
    first = page.locator(".row-list [aria-selected=true]").get_attribute("data-row")
    page.keyboard.press("ArrowDown")
    now = page.locator(".row-list [aria-selected=true]").get_attribute("data-row")
    assert now == rows[(rows.index(first) + 1) % len(rows)]
    run = watch.at("run-select").input_value()
    page.keyboard.press("ArrowRight")
    assert watch.at("run-select").input_value() != run
    page.keyboard.press("/")
    watch.expect(watch.at("own-line")).to_be_focused()
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
    for _ in range(150):
        watch.page.keyboard.press("Tab")
        found: dict[str, Any] | None = watch.page.evaluate(_RING)
        if found is None:
            continue  # between the end of the page and its beginning
        if found["name"] in names[:1]:
            break
        assert found["wide"] >= 2.0, found
        assert found["seen"], found
        names.append(found["name"])
    assert len(names) > 20, names  # the car's picture is one
    wanted = {"runs": "choose-files", "missing": "own-line", "falls": "export-csv"}[view]
    assert wanted in names, names
    assert any(name.startswith("car-") for name in names)


def test_the_button_that_adds_is_a_few_presses_of_tab_away(opened: Opened) -> None:
    """By the link that skips to the view, which stays where it is; and the car's picture is one stop."""
    watch = opened()
    _settled(watch, "missing")
    watch.page.locator(".skip").focus()
    watch.page.keyboard.press("Enter")
    watch.expect(watch.page.locator("#main")).to_be_focused()
    assert "#/missing" in watch.page.url
    watch.page.keyboard.press("Tab")
    assert watch.page.evaluate("document.getElementById('main').contains(document.activeElement)")
    watch.page.locator(".skip").focus()
    stops = 0
    while not watch.page.evaluate("document.getElementById('main').contains(document.activeElement)"):
        watch.page.keyboard.press("Tab")
        stops += 1
    assert stops <= 17, stops


def test_arrows_on_the_car_take_the_keyboard_with_them(opened: Opened) -> None:
    watch = opened()
    _settled(watch, "missing")
    watch.page.locator(".car [tabindex='0']").focus()
    for _ in range(3):
        watch.page.keyboard.press("ArrowDown")
        row = watch.page.locator(".row-list [aria-selected=true]").get_attribute("data-row")
        if watch.at(f"car-{row}").count():
            watch.expect(watch.at(f"car-{row}")).to_be_focused()
            assert watch.page.locator(".car [tabindex='0']").count() == 1


_AT_WORK = """
async () => {
  const { createJobBar } = await import("/js/widgets/shell.js");
  const root = document.getElementById("jobs").cloneNode(false);
  document.getElementById("jobs").replaceWith(root);
  createJobBar(root, { cancel: () => {}, again: () => {} }).jobs([{ id: 1, state: "running", do: "preview",
    args: { effect: "damper_hysteresis.rear" }, share: 0.12, elapsed: 34, remaining: 2800, text: "12 of 200" }]);
  const seen = [...root.querySelectorAll("button:not([hidden])")];
  return seen.map((e) => [e.textContent, e.getBoundingClientRect().right]);
}
"""


@pytest.mark.parametrize("width", [320, 400, 620, 820])
def test_work_can_be_cancelled_on_a_narrow_page(opened: Opened, width: int) -> None:
    watch = opened(width, 800)
    _settled(watch, "missing")
    ((text, right),) = watch.page.evaluate(_AT_WORK)
    assert (text, right <= width) == ("Cancel", True), right
    watch.picture(f"job-bar-{width}")


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
    small = watch.page.evaluate(_SMALL)
    assert not small, small


def test_a_locale_that_no_browser_knows(opened: Opened) -> None:
    watch = opened(locale="en-US@posix")
    _settled(watch, "compare")
    assert watch.at("chart-measured").locator("canvas").first.is_visible()


def test_the_report_is_one_file_that_needs_nothing_else(opened: Opened, tmp_path: Path) -> None:
    watch = opened()
    _settled(watch, "falls")
    with watch.page.expect_download(timeout=2 * LONG) as download:
        watch.at("export-report").click()
        watch.expect(watch.at("job-bar")).to_contain_text("Writing the report")
    download.value.save_as(tmp_path / "report.html")
    report = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "suspension.fl" in report
    assert not re.search(r"""(src|href)\s*=\s*["']?https?:""", report)
    watch.expect(watch.at("export-report")).to_be_enabled()
    alone = watch.page.context.new_page()
    asked: list[str] = []
    errors: list[str] = []
    alone.on("pageerror", lambda error: errors.append(str(error)))
    alone.on("request", lambda request: asked.append(request.url))
    alone.goto((tmp_path / "report.html").as_uri())
    alone.evaluate("document.querySelectorAll('details').forEach((folded) => { folded.open = true; })")
    assert [url for url in asked if not url.startswith("data:")] == [(tmp_path / "report.html").as_uri()]
    assert not errors
    drawn = alone.evaluate(_DRAWN)
    assert len(drawn) > 10
    assert min(drawn) > 100, drawn
    canvas = alone.locator(".curves canvas").first
    before = canvas.screenshot()
    box = canvas.bounding_box()
    assert box is not None
    alone.mouse.move(box["x"] + 0.4 * box["width"], box["y"] + 60)
    alone.mouse.down()
    alone.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 60)
    alone.mouse.up()
    alone.mouse.move(5, 5)
    assert canvas.screenshot() != before
    alone.reload()
    pages = len(re.findall(rb"/Type\s*/Page\b", alone.pdf(prefer_css_page_size=True)))
    assert 1 <= pages <= 6
    alone.close()
