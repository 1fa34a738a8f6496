"""Charts of one window: what a zoom costs them, and where the cursor is afterwards."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.services.workbench.browser.bench import Opened, opening, serving

_WHEEL = """
async ([shift, plots]) => {
  const { timeChart } = await import("/js/charts/time_chart.js");
  const { link } = await import("/js/charts/linked_axes.js");
  const frame = () => new Promise((done) => requestAnimationFrame(done));
  const box = document.createElement("div");
  box.style.cssText = "position:fixed;inset:0;z-index:99;background:var(--panel)";
  document.body.append(box);
  const t = Float64Array.from({ length: 2001 }, (_, i) => i / 100);
  const values = Float32Array.from(t, (x) => Math.sin(x));
  const calls = Array(plots).fill(0);
  for (let k = 0; k < plots; k += 1) {
    timeChart(box, { t, series: [{ name: "line", values, colour: "--modelled" }], sync: "wheel", height: 60,
      onCursor: () => { calls[k] += 1; } });
  }
  while (box.querySelectorAll("canvas").length < plots) await frame();
  const over = box.querySelectorAll(".u-over")[1];
  const at = over.getBoundingClientRect();
  const [clientX, clientY] = [at.left + 0.4 * at.width, at.top + 0.5 * at.height];
  const mouse = { bubbles: true, cancelable: true, view: window, clientX, clientY };
  const wheel = async (more) => {
    over.dispatchEvent(new WheelEvent("wheel", { ...mouse, ...more }));
    for (let k = 0; k < 4; k += 1) await frame();
  };
  over.dispatchEvent(new MouseEvent("mousemove", { ...mouse, movementX: 1 }));
  await wheel({ deltaY: -1 });
  calls.fill(0);
  await wheel({ deltaY: -1, shiftKey: shift });
  const [a, b] = link("wheel").shown;
  const lines = [...box.querySelectorAll(".u-cursor-x")].map((e) => e.getBoundingClientRect().left - at.left);
  return { calls, cursor: link("wheel").cursor, pointed: a + 0.4 * (b - a), wide: at.width, lines };
}
"""


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A server without a study: charts need none."""
    cwd = tmp_path_factory.mktemp("linked")
    with serving(cwd / "none", cwd) as bench:
        yield bench.address


@pytest.fixture
def opened(browser: object, address: str) -> Iterator[Opened]:
    """Opens its pages."""
    with opening(browser, address) as pages:
        yield pages


@pytest.mark.parametrize("shift", [False, True], ids=["zoom", "pan"])
def test_the_cursor_stays_under_the_pointer_and_is_set_once(opened: Opened, shift: bool) -> None:
    """In every chart, once a zoom: set by each chart for all others, a page of 50 wrote 2,500 times into the page."""
    watch = opened()
    watch.go("live")
    found = watch.page.evaluate(_WHEEL, [shift, 8])
    assert found["calls"] == [1] * 8
    assert found["cursor"] == pytest.approx(found["pointed"], abs=2e-2)
    assert found["lines"] == pytest.approx([0.4 * found["wide"]] * 8, abs=2.0)
