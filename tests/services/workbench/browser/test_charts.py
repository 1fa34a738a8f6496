"""What charts are drawn from: no sample is lost where many share a pixel, and shares stack up to their sum."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from lacet.services.render.intervals import half_width, to_interval
from tests.services.workbench.browser.bench import Opened, opening, serving

_EXTREMES = """
async ([n, from, count, columns]) => {
  const { Pyramid } = await import("/js/charts/pyramid.js");
  let seed = 7;
  const random = () => { seed = (seed * 48271) % 2147483647; return seed / 2147483647 - 0.5; };
  const values = Float32Array.from({ length: n }, (_, i) => (i > 0.4 * n && i < 0.5 * n ? NaN : random()));
  values[from + Math.floor(count / 3)] = 9;
  values[from + Math.floor(count / 2) + 1] = -9;
  const found = new Pyramid(values).columns(from, count, columns);
  const each = count / columns;
  let [lost, wide, holes] = [0, 0, 0];
  for (let c = 0; c < columns; c += 1) {
    const [a, b] = [found[2 * c], found[2 * c + 1]];
    const own = values.slice(Math.ceil(from + c * each), Math.ceil(from + (c + 1) * each)).filter((v) => v === v);
    if (a === null) { holes += 1; lost += own.length; continue; }
    const [low, high] = [Math.min(a, b), Math.max(a, b)];
    if (own.some((v) => v < low || v > high)) lost += 1;
    // An extreme may come from a neighbour, by no more than a column.
    const near = values.slice(Math.max(0, Math.floor(from + (c - 1) * each)), Math.ceil(from + (c + 2) * each));
    if (!near.includes(Math.fround(low)) || !near.includes(Math.fround(high))) wide += 1;
  }
  const kept = [...found].filter((v) => v !== null);
  return { lost, wide, holes, low: Math.min(...kept), high: Math.max(...kept) };
}
"""
_COLUMNS = """
async ([wide, tall, thick]) => {
  const { drawColumns } = await import("/js/charts/lines.js");
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [wide + 20, tall + 10];
  const ctx = canvas.getContext("2d");
  let seed = 11;
  const random = () => { seed = (seed * 48271) % 2147483647; return seed / 2147483647 - 0.5; };
  const line = (shift) => Array.from({ length: 2 * wide }, (_, i) => shift + 0.3 * Math.sin(i / 40) + 0.1 * random());
  const lines = [line(0.4), line(-0.4)];
  for (let c = 100; c < 130; c += 1) lines[0][2 * c] = lines[0][2 * c + 1] = null;
  const u = { ctx, bbox: { left: 12, top: 5, width: wide, height: tall },
    scales: { x: { min: 0, max: wide }, y: { min: -1, max: 1 } } };
  const x = Float64Array.from({ length: 2 * wide }, (_, i) => i / 2);
  const colours = ["#ff0000", "#0000ff"];
  drawColumns(u, x, lines.map((extremes, k) => ({ extremes, colour: colours[k], thick })));
  const { data } = ctx.getImageData(0, 0, canvas.width, canvas.height);
  let [lost, strange, holes, loose] = [0, 0, 0, 0];
  const up = (v) => ((1 - v) / 2) * tall;
  lines.forEach((extremes, k) => {
    let before = null;
    for (let c = 0; c < wide; c += 1) {
      const rows = [];
      for (let y = 0; y < canvas.height; y += 1) {
        if (data[4 * (y * canvas.width + 12 + c) + 2 * k] === 255) rows.push(y - 5);
      }
      if (extremes[2 * c] === null) { holes += rows.length ? 0 : 1; before = null; continue; }
      const own = [up(extremes[2 * c]), up(extremes[2 * c + 1])].sort((a, b) => a - b);
      const [top, bottom] = [rows[0], rows[rows.length - 1] + 1];
      if (rows.length !== bottom - top || rows.length < Math.round(thick)) lost += 1;
      if (top > own[0] + 0.5 || bottom < own[1] - 0.5) lost += 1;
      const wanted = before ? [Math.min(own[0], before[1]), Math.max(own[1], before[0])] : own;
      if (top < wanted[0] - thick || bottom > wanted[1] + thick) strange += 1;
      if (before && (top > before[1] + 1 || bottom < before[0] - 1)) loose += 1;
      before = own;
    }
  });
  return { lost, strange, holes, loose };
}
"""
_STACK = """
async () => {
  const { stacked } = await import("/js/charts/area.js");
  const shares = [[3, -1, 2, 0], [-2, -4, 5, 1], [4, 2, -6, 0]].map((x) => Float32Array.from(x));
  const layers = stacked(shares);
  const off = (l, k, i) => Math.abs(l.high[i] - l.low[i] - Math.abs(shares[k][i]));
  const thick = layers.every((l, k) => [0, 1, 2, 3].every((i) => off(l, k, i) < 1e-6));
  const top = [0, 1, 2, 3].map((i) => Math.max(...layers.map((l) => l.high[i])));
  const bottom = [0, 1, 2, 3].map((i) => Math.min(...layers.map((l) => l.low[i])));
  const wanted = [0, 1, 2, 3].map((i) => shares.reduce((a, s) => a + s[i], 0));
  return { thick, wanted, sum: top.map((v, i) => v + bottom[i]) };
}
"""
_LANGUAGE = """
async () => {
  const { validLanguage } = await import("/js/charts/locale.js");
  return ["en-US@posix", "C", "de-DE"].map(validLanguage);
}
"""
_NUMBERS = """
async (pairs) => {
  const { number } = await import("/js/widgets/format.js");
  return pairs.map(([value, half]) => number(value, half).replace("\N{MINUS SIGN}", "-"));
}
"""
_NOTES = """
async (notes) => {
  const { createWaterfall } = await import("/js/charts/waterfall.js");
  const { element, update } = createWaterfall(() => {});
  element.style.width = "520px";
  document.body.append(element);
  const errors = (k) => ({ used_error: 9 / (k + 1), held_error: 2 });
  update(notes.map((note, k) => ({ version: k + 1, parent: k, note, ...errors(k) })), 12, false);
  const foot = element.getBoundingClientRect().bottom;
  const shown = [...element.querySelectorAll(".note")];
  const cut = shown.filter((e) => e.getBoundingClientRect().bottom > foot + 1).length;
  return { texts: shown.map((e) => e.textContent), cut };
}
"""
_NEXT = """
async (found) => {
  const { createNextRun } = await import("/js/views/next_run.js");
  let answer;
  const run = () => new Promise((done) => { answer = () => done({ next: found }); });
  const get = async () => ({ terms: {} });
  const next = createNextRun({ api: { run, get } });
  document.getElementById("main").append(next.element);
  const silent = (effect, shown_by) => ({ effect, label: effect, shown_by, answer: "not testable" });
  const ranked = { candidates: [silent("a.front", "rough road"), { ...silent("b", "braking"), answer: "missing" },
    silent("c", "rough road"), silent("d", "a spiral")] };
  next.ready(true, ranked);
  const groups = [...next.element.querySelectorAll("optgroup")].map((g) => [g.label, g.children.length]);
  const go = next.element.querySelector("[data-testid=next-run-go]");
  go.click();
  next.ready(true, ranked);
  const waits = go.disabled;
  answer();
  await new Promise((done) => setTimeout(done, 100));
  const text = next.element.querySelector(".next-says").innerText;
  return { groups, waits, again: !go.disabled, text,
    pictures: next.element.querySelectorAll("[data-testid=next-picture] :is(canvas, .size-bar)").length };
}
"""
_SURFACES = """
async () => {
  const { surfaceMaps } = await import("/js/charts/restoring_surface.js");
  const cells = (value) => [0, 1, 2, 3].map(() => [0, 1, 2, 3].map(() => value));
  const edges = (reach) => [-2, -1, 0, 1, 2].map((k) => (k * reach) / 2);
  const shown = (label, travel, rate) => ({ label, unit: "N", travel: edges(travel), rate: edges(rate),
    travel_unit: "mm", rate_unit: "mm/s" });
  const one = (...how) => ({ residual: cells(3), force: cells(3), count: cells(40), blocks: cells(5), scatter: 1,
    shown: shown(...how) });
  const box = document.createElement("div");
  document.getElementById("main").append(box);
  surfaceMaps(box).update({ fl: one("front left", 10, 400), rr: one("rear right", 20, 100) }, "residual", 10);
  await new Promise((done) => setTimeout(done, 300));
  return [...box.querySelectorAll(".surface")].map((figure) => {
    const canvas = figure.querySelector("canvas");
    const at = canvas.getBoundingClientRect();
    const [x, y] = [at.left + 58 + 0.6 * (at.width - 68), at.top + 6 + 0.45 * (at.height - 48)];
    canvas.dispatchEvent(new PointerEvent("pointermove", { clientX: x, clientY: y }));
    return figure.querySelector("output").textContent;
  });
}
"""


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A server without a study: what charts are drawn from needs none."""
    cwd = tmp_path_factory.mktemp("charts")
    with serving(cwd / "none", cwd) as bench:
        yield bench.address


@pytest.fixture
def opened(browser: Any, address: str) -> Iterator[Opened]:
    """Opens its pages."""
    with opening(browser, address) as pages:
        yield pages


def test_no_sample_is_lost_where_many_share_a_pixel(opened: Opened) -> None:
    watch = opened()
    watch.go("live")
    for n, start, count, columns in (
        (60_000, 0, 60_000, 1_200),
        (60_000, 20_011, 9_973, 611),
        (5_000, 3, 4_900, 1_203),
    ):
        found = watch.page.evaluate(_EXTREMES, [n, start, count, columns])
        assert found["lost"] == 0, (n, start, count, columns, found)
        assert found["wide"] == 0, (n, start, count, columns, found)
        assert found["holes"] > 0
        assert (found["low"], found["high"]) == (-9, 9)


@pytest.mark.parametrize("thick", [1.25, 2.5])
def test_columns_of_pixels_reach_from_lowest_to_highest(opened: Opened, thick: float) -> None:
    watch = opened()
    watch.go("live")
    found = watch.page.evaluate(_COLUMNS, [400, 90, thick])
    assert found == {"lost": 0, "strange": 0, "holes": 30, "loose": 0}


def test_shares_stack_up_to_their_sum(opened: Opened) -> None:
    watch = opened()
    watch.go("live")
    found = watch.page.evaluate(_STACK)
    assert found["thick"]
    assert found["sum"] == found["wanted"]


def test_a_language_that_is_no_tag_gives_way(opened: Opened) -> None:
    watch = opened()
    watch.go("live")
    assert watch.page.evaluate(_LANGUAGE) == ["en-GB", "en-GB", "de-DE"]


def test_a_number_with_its_interval_is_rounded_as_on_the_command_line(opened: Opened) -> None:
    pairs = [(51234.0, 2184.0), (0.01234, 0.00454), (-40.2, 6.04), (26773.2, 99.6), (9.996, 0.0996), (-0.4, 120.0)]
    watch = opened()
    watch.go("live")
    assert watch.page.evaluate(_NUMBERS, pairs) == [to_interval(*pair) for pair in pairs]
    assert watch.page.evaluate(_NUMBERS, [(half, half) for _, half in pairs]) == [half_width(half) for _, half in pairs]


def test_twelve_versions_are_told_apart(opened: Opened) -> None:
    watch = opened()
    watch.go("live")
    laws = ("damper_stroke_symmetric", "damper_knee_rebound", "anti_roll_bar")
    places = ("front", "rear", "fl", "rr")
    found = watch.page.evaluate(_NOTES, [f"added {law}.{place}" for law in laws for place in places])
    assert len(set(found["texts"])) == 12, found["texts"]
    assert found["cut"] == 0


@pytest.mark.parametrize("pictured", [1, 2])
def test_the_next_run_is_grouped_and_pictured(opened: Opened, pictured: int) -> None:
    watch = opened()
    watch.go("live")
    edge = [[0.5, 0.5][:pictured], [1.5, 1.5][:pictured]]
    picture = {"effects": ["a.front", "c"][:pictured], "now": edge, "after": edge}
    run = {"run": "rough class B", "after": 40.0, "seconds": 10.0}
    found = watch.page.evaluate(_NEXT, {
        "says": "To show it: drive.", "quantity": "size", "now": 1.0, "needed": 8.0, "runs": [run], "warnings": [],
        "picture": picture,
    })  # fmt: skip
    assert found["groups"] == [["shown by: rough road", 2], ["shown by: a spiral", 1]]
    assert found["waits"], "it may not be asked twice at once"
    assert found["again"]
    assert "rough class B" in found["text"]
    assert "null" not in found["text"]
    # a region of two sizes, or a bar each of one size now and after the run
    assert found["pictures"] == 3 - pictured
    assert ("0.50 to 1.50" in found["text"]) == (pictured == 1)
    if pictured == 2:
        watch.at("next-picture").locator("canvas").hover()
        assert watch.at("next-picture").locator("output").inner_text().strip() == "", "an outline has no y of an x"


def test_four_surfaces_have_common_axes(opened: Opened) -> None:
    """The same place of two pictures is in the cell of the same travel and rate, 4 mm and 40 mm/s here."""
    watch = opened()
    watch.go("live")
    narrow, wide = watch.page.evaluate(_SURFACES)
    assert narrow.startswith("2.50 mm, 100 mm/s"), narrow
    assert wide.startswith("5.00 mm, 25.0 mm/s"), wide
