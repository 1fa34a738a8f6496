"""The page teaches: a tour on example runs, a sentence on every term, and colours and names that all can use."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from lacet.services.render.terms import TERMS
from lacet.services.workbench.help_pages import DOCS
from tests.services.workbench.browser.bench import LONG, Opened, missing, opening, serving

STYLES = Path(__file__).parents[4] / "services" / "workbench" / "static" / "css" / "base.css"
_DEUTERANOPIA = ((0.367322, 0.860646, -0.227968), (0.280085, 0.672501, 0.047413), (-0.011820, 0.042940, 0.968881))
_PROTANOPIA = ((0.152286, 1.052583, -0.204868), (0.114503, 0.786281, 0.099216), (-0.003882, -0.048116, 1.051998))
"""Machado, Oliveira and Fernandes (2009), severity 1, linear RGB."""
APART = 20.0
"""Distance in CIE 1976 L*a*b* from which two colours are told apart at a glance."""


@pytest.mark.slow  # a minute; its steps are in other tests
def test_the_tour_makes_a_study_of_the_example_runs(browser: Any, tmp_path: Path) -> None:
    with serving(tmp_path / "study", tmp_path) as bench, opening(browser, bench.address) as opened:
        watch = opened()
        watch.page.goto(watch.address)
        watch.at("invite-tour").click()
        tour = watch.at("tour")
        watch.expect(tour).to_contain_text("1 of 8")
        watch.picture("tour-1")
        watch.at("tour-act").click()
        watch.expect(tour).to_contain_text("2 of 8", timeout=LONG)
        watch.expect(watch.at("run-row-spiral")).to_contain_text("good", timeout=LONG)
        watch.at("tour-act").click()
        watch.expect(tour).to_contain_text("3 of 8", timeout=LONG)
        watch.expect(watch.at("car-picture")).to_have_class(re.compile("tour-target"), timeout=LONG)
        watch.picture("tour-3")
        for step, target in ((4, "chart-residual"), (5, "map")):
            watch.at("tour-next").click()
            watch.expect(tour).to_contain_text(f"{step} of 8")
            watch.expect(watch.at(target)).to_have_class(re.compile("tour-target"), timeout=LONG)
        watch.page.reload()
        watch.expect(tour).to_contain_text("5 of 8")  # it goes on where it was
        watch.expect(watch.at("map")).to_have_class(re.compile("tour-target"), timeout=LONG)
        watch.at("tour-next").click()
        watch.expect(watch.at("tour-act")).to_have_text("Look for what is missing")
        watch.at("tour-act").click()
        watch.expect(tour).to_contain_text("7 of 8", timeout=LONG)
        watch.expect(watch.at("add-best")).to_have_class(re.compile("tour-target"))
        watch.picture("tour-7")
        watch.at("tour-act").click()
        watch.expect(tour).to_contain_text("8 of 8", timeout=LONG)
        watch.expect(watch.at("column-2")).to_have_attribute("aria-label", re.compile("present version"))
        watch.picture("tour-8")
        watch.at("tour-next").click()
        watch.expect(tour).to_be_hidden()
        watch.expect(watch.page.locator(".tour-target")).to_have_count(0)
        watch.page.reload()
        watch.expect(watch.at("version")).to_contain_text("Version 2 of 2")
        watch.expect(tour).to_be_hidden()


def test_every_term_has_a_sentence_and_a_page(opened: Opened) -> None:
    watch = opened()
    seen: set[str] = set()
    for view, term in (
        ("compare", "colour"),
        ("where", "map"),
        ("missing", "p"),
        ("falls", "interval"),
        ("car", "ride_rate"),
    ):
        watch.go(view)
        watch.expect(watch.page.locator(f"[data-view={view}] .term[data-term={term}]").first).to_be_visible()
        seen |= set(watch.page.evaluate("[...document.querySelectorAll('.term')].map((e) => e.dataset.term)"))
    assert seen <= set(TERMS)
    # those of the verdict, of Live (test_live.py) and of the parts that come with a ranking
    assert len(set(TERMS) - seen) < 12, set(TERMS) - seen
    assert all((DOCS / term.page).is_file() for term in TERMS.values())
    button = watch.page.locator(".rail .term[data-term=error]")
    button.focus()
    watch.page.keyboard.press("Enter")
    box = watch.at("term")
    watch.expect(box).to_contain_text("RMS of measured − modelled")
    text = watch.page.evaluate(f"fetch('{box.get_by_role('link').get_attribute('href')}').then((a) => a.text())")
    assert text.startswith("# ")
    watch.picture("term")
    watch.page.keyboard.press("Escape")
    watch.expect(box).to_have_count(0)
    watch.expect(button).to_be_focused()


@pytest.mark.parametrize("theme", [":root {", ':root[data-theme="dark"] {'])
def test_colours_are_told_apart_without_red_or_green(theme: str) -> None:
    part = STYLES.read_text(encoding="utf-8").split(theme, 1)[1].split("}", 1)[0]
    colours = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6});", part))
    pairs = [("good", "bad"), ("good", "warn"), ("ramp-0", "ramp-4"), ("modelled", "residual"), ("ramp-0", "ramp-2")]
    for matrix in (_DEUTERANOPIA, _PROTANOPIA):
        for one, other in pairs:
            a, b = (_lab(colours[name], matrix) for name in (one, other))
            far = sum((x - y) ** 2 for x, y in zip(a, b, strict=True)) ** 0.5
            assert far > APART, (one, other, far)


def _lab(colour: str, matrix: tuple[tuple[float, ...], ...]) -> tuple[float, float, float]:
    """CIE L*a*b* (D65) of a colour as an eye without one kind of cones sees it."""
    rgb = [int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in rgb]
    r, g, b = (min(1.0, max(0.0, sum(m * c for m, c in zip(row, linear, strict=True)))) for row in matrix)
    white = (
        (0.4124 * r + 0.3576 * g + 0.1805 * b) / 0.9505,
        0.2126 * r + 0.7152 * g + 0.0722 * b,
        (0.0193 * r + 0.1192 * g + 0.9505 * b) / 1.089,
    )
    x, y, z = (v ** (1 / 3) if v > 0.008856 else 7.787 * v + 16.0 / 116.0 for v in white)
    return 116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_finds_nothing_serious(opened: Opened, theme: str) -> None:
    try:
        from axe_playwright_python.sync_playwright import Axe
    except ImportError:
        missing("axe is not installed: make test installs it (requirements/dev.txt)")
        raise
    watch = opened(theme=theme)
    for view in ("runs", "compare", "where", "missing", "falls", "car", "live"):
        watch.go(view)
        watch.page.wait_for_selector(f"[data-view={view}] > *")
        watch.expect(watch.at("job-bar")).to_have_attribute("data-state", "idle", timeout=LONG)
        watch.quiet(300)
        found = Axe().run(watch.page).response["violations"]
        serious = [
            (one["id"], [node["html"][:120] for node in one["nodes"][:3]])
            for one in found
            if one["impact"] in ("serious", "critical")
        ]
        assert not serious, (view, serious)
