"""Labels of axes: none is cut, and enough of them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import pytest

from tests.services.workbench.browser.bench import Opened, opening, serving

_WRITTEN = """
const write = CanvasRenderingContext2D.prototype.fillText;
window.written = [];
CanvasRenderingContext2D.prototype.fillText = function (text, x, y, ...more) {
  const wide = this.measureText(text).width;
  const part = { left: 0, start: 0, center: 0.5, right: 1, end: 1 }[this.textAlign];
  const at = this.getTransform();
  const left = (x - part * wide) * at.a + at.e;
  window.written.push({ text, left, right: left + wide * at.a, upright: at.b === 0, width: this.canvas.width });
  return write.call(this, text, x, y, ...more);
};
"""
_TIME = """
async ([seconds, width]) => {
  const { timeChart } = await import("/js/charts/time_chart.js");
  const frame = () => new Promise((done) => requestAnimationFrame(done));
  const box = document.createElement("div");
  box.style.cssText = `position:fixed;left:0;top:0;width:${width}px;z-index:99;background:var(--panel)`;
  document.body.append(box);
  const t = Float64Array.from({ length: 201 }, (_, i) => (i / 200) * seconds);
  timeChart(box, { t, series: [{ name: "line", values: Float32Array.from(t), colour: "--modelled" }], height: 60 });
  while (!box.querySelector("canvas")) await frame();
  await frame();
  return window.written.filter((w) => w.text.endsWith(" s"));
}
"""
_POWER = """
async ([low, high]) => {
  const { xyPlot } = await import("/js/charts/xy_plot.js");
  const y = { label: "power density", unit: "N", log: true, range: [low, high] };
  const x = { label: "frequency", unit: "Hz", range: [0, 1] };
  window.written.length = 0;
  const line = { kind: "line", name: "line", colour: "--modelled", x: [0, 1], y: [low, high] };
  const box = document.createElement("div");
  document.getElementById("main").append(box);
  xyPlot(box, { title: "", x, y, items: [line], height: 190 });
  await new Promise((done) => setTimeout(done, 200));
  return window.written.map((w) => w.text);
}
"""
_MAP = """
async ([width, names]) => {
  const { residualMap } = await import("/js/charts/residual_map.js");
  const box = document.createElement("div");
  box.style.width = `${width}px`;
  document.getElementById("main").append(box);
  const cells = Array(16).fill(1);
  const runs = names.map((name) => ({ name, used: false, t0: 0, cells: 16, phases: [], rows: { "tyre.fl": cells } }));
  const map = residualMap(box, { onPick: () => {}, rows: 1 });
  map.update({ rows: ["tyre.fl"], cell: 1, runs }, "tyre.fl");
  await new Promise((done) => setTimeout(done, 200));
  return window.written.filter((w) => names.includes(w.text) || w.text === "held out");
}
"""


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A server without a study: axes need none."""
    cwd = tmp_path_factory.mktemp("axes")
    with serving(cwd / "none", cwd) as bench:
        yield bench.address


@pytest.fixture
def page(browser: object, address: str) -> Iterator[Any]:
    """A page that keeps what is written on its canvases."""
    with opening(browser, address) as pages:
        opened: Opened = pages
        watch = opened()
        watch.page.add_init_script(_WRITTEN)
        watch.go("live")
        yield watch.page


@pytest.mark.parametrize(("seconds", "width"), [(20.0, 700), (600.0, 1200), (15.0, 500)])
def test_the_last_time_is_not_cut(page: Any, seconds: float, width: int) -> None:
    found = page.evaluate(_TIME, [seconds, width])
    assert len(found) > 3
    assert f"{seconds:g} s" in [w["text"].replace(".0", "") for w in found], "the end has a label"
    assert all(w["right"] <= w["width"] and w["left"] >= 0 for w in found), found


@pytest.mark.parametrize(
    ("low", "high", "wanted"),
    [(0.12, 0.45, {"0.2", "0.3", "0.4"}), (1.5, 30.0, {"2", "5", "10", "20"}), (0.5, 5e3, {"1", "10", "100", "1000"})],
)
def test_a_logarithmic_axis_has_round_values_between_its_ends(
    page: Any, low: float, high: float, wanted: set[str]
) -> None:
    assert wanted <= set(page.evaluate(_POWER, [low, high]))


@pytest.mark.parametrize("width", [380, 450, 1100])
def test_headings_of_the_residual_map_do_not_run_into_each_other(page: Any, width: int) -> None:
    """Where there is no room for "held out" it is left out; it is read at the pointer and in the table."""
    names = ["sine", "braking", "rough"]
    found = page.evaluate(_MAP, [width, names])
    assert [w["text"] for w in found if w["text"] in names] == names
    assert all(a["right"] < b["left"] for a, b in itertools.pairwise(found)), found
    assert (len(found) == 6) == (width > 1000)
