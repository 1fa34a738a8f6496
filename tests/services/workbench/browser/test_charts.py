"""What charts are drawn from: no sample is lost where many share a pixel, and shares stack up to their sum."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

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
