"""Compare as a bench of its own (overlays, formulas, cursors, XY, files, address), and the car in numbers."""

from __future__ import annotations

import csv
import re
import shutil
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from lacet.services.render.intervals import to_interval, with_interval
from tests.services.workbench.browser.bench import LONG, Bench, Opened, Watch, opening, serving
from tests.support.processes import Command

BAR = "anti_roll_bar.front"


@pytest.fixture(scope="module")
def two(ready: Bench, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    """The small study with a second version."""
    cwd = tmp_path_factory.mktemp("two")
    folder = Path(shutil.copytree(ready.folder, cwd / "small"))
    command = Command("add", folder, BAR, cwd=cwd)
    assert command.wait(180.0) == 0, command.text()
    with serving(folder, cwd) as bench:
        yield bench


@pytest.fixture
def opened(browser: Any, two: Bench) -> Iterator[Opened]:
    """Opens its pages."""
    with opening(browser, two.address) as pages:
        yield pages


def _saved(watch: Watch, kind: str, place: Path) -> Path:
    with watch.page.expect_download(timeout=LONG) as download:
        watch.at("compare-save").select_option(kind)
    download.value.save_as(place / f"saved.{kind}")
    return place / f"saved.{kind}"


def test_versions_and_runs_over_each_other_with_cursors_and_files(opened: Opened, tmp_path: Path) -> None:
    watch = opened(1440, 900)
    watch.go("compare?row=suspension.fl")
    watch.expect(watch.at("chart-measured").locator("canvas").first).to_be_visible(timeout=LONG)
    watch.at("overlay-select").select_option(label="version 1: base model")
    measured = watch.at("chart-measured").first
    watch.expect(measured).to_contain_text("modelled, version 1", timeout=LONG)
    watch.at("overlay-select").select_option(label="rough")
    watch.expect(measured).to_contain_text("measured, run rough", timeout=LONG)
    watch.expect(watch.at("version")).to_contain_text("Version 2 of 2")  # nothing was gone back to
    formula = watch.at("formula")
    formula.fill("travel_fl - travel_fr")
    formula.press("Enter")
    chart = watch.at("chart-formula-travel_fl - travel_fr")
    watch.expect(chart).to_contain_text("[m]", timeout=LONG)
    formula.fill("travel_fl + ay")
    formula.press("Enter")
    watch.expect(watch.page.locator(".channels")).to_contain_text("m/s", timeout=LONG)
    watch.page.get_by_role("button", name="Close the chart of travel_fl + ay").click()
    watch.errors[:] = [e for e in watch.errors if "status of 400" not in e]
    watch.at("compare-cursors").check()
    watch.at("cursor-a").fill("4")
    watch.at("cursor-a").press("Enter")
    watch.at("cursor-b").fill("6")
    watch.at("cursor-b").press("Enter")
    watch.at("compare-xy").check()
    watch.at("xy-x").select_option("travel_fl - travel_fr: formula")
    watch.at("xy-y").select_option("suspension.fl: measured")
    watch.expect(watch.at("xy-plot")).to_contain_text("samples")
    watch.picture("compare-overlays")
    watch.at("xy").scroll_into_view_if_needed()
    watch.picture("compare-xy")

    rows = list(csv.reader(_saved(watch, "csv", tmp_path).read_text(encoding="utf-8").splitlines()))
    head = rows[0]
    columns = {name: np.array([float(row[k]) if row[k] else np.nan for row in rows[1:]]) for k, name in enumerate(head)}
    t, own = columns["t [s]"] if head.count("t [s]") == 1 else _first(rows), columns["suspension.fl: measured [N]"]
    inside = (t >= 4.0) & (t <= 6.0)
    assert inside.sum() > 20
    line = watch.at("cursors").locator("tr[data-curve='suspension.fl: measured']").inner_text().replace("\u2212", "-")
    shown = [float(x) for x in re.findall(r"-?\d+(?:\.\d+)?", line.partition("N")[2])]
    values = own[inside]
    wanted = [values.min(), values.max(), values.mean(), np.sqrt(np.mean(values**2))]
    assert shown[:4] == pytest.approx(wanted, rel=2e-3, abs=0.5)
    older = columns["suspension.fl: modelled, version 1 [N]"]
    newer = columns["suspension.fl: modelled [N]"]
    assert np.nanstd(older - own) > 1.2 * np.nanstd(newer - own), "the base model is further from the measurement"
    picture = _saved(watch, "svg", tmp_path)
    paths = ElementTree.parse(picture).getroot().findall(".//{http://www.w3.org/2000/svg}path")
    assert sum(len(path.get("d", "")) > 500 for path in paths) >= 6
    body = _saved(watch, "png", tmp_path).read_bytes()
    assert struct.unpack(">II", body[16:24]) >= (600, 600)

    address = watch.page.url
    assert re.search(r"over=.*formulas=|formulas=.*over=", address)
    other = opened(1440, 900)
    other.page.goto(address)
    other.expect(other.at("chart-measured").first).to_contain_text("measured, run rough", timeout=LONG)
    other.expect(other.at("chart-formula-travel_fl - travel_fr")).to_contain_text("[m]", timeout=LONG)
    other.expect(other.at("cursor-a")).to_have_value("4.00")
    other.expect(other.at("xy-plot")).to_contain_text("samples")


def _first(rows: list[list[str]]) -> np.ndarray:
    """The first time base: that of the rows."""
    return np.array([float(row[0]) if row[0] else np.nan for row in rows[1:]])


def test_a_click_moves_the_nearer_cursor(opened: Opened) -> None:
    watch = opened()
    watch.go("compare?row=tyre.fl&a=2&b=8")
    over = watch.at("chart-measured").first.locator(".u-over")
    watch.expect(over).to_be_visible(timeout=LONG)
    over.click(position={"x": 200, "y": 20})  # of some 850 px, which are 16 s
    watch.expect(watch.at("cursor-a")).not_to_have_value("2.00")
    watch.page.set_viewport_size({"width": 1024, "height": 768})
    table = watch.at("cursors").locator(".scroll")
    assert table.evaluate("(e) => e.scrollWidth <= e.clientWidth"), "every column is seen on a tablet"
    watch.expect(watch.at("cursor-b")).to_have_value("8.00")
    watch.at("compare-cursors").uncheck()
    watch.expect(watch.at("cursors")).to_be_hidden()


def test_the_car_in_numbers(opened: Opened) -> None:
    watch = opened(1440, 900)
    watch.go("car")
    corner = watch.at("values-fl")
    watch.expect(corner).to_contain_text("ride rate", timeout=LONG)
    found = watch.page.evaluate("fetch('api/values?version=2').then((a) => a.json())")
    rate = next(d for d in found["derived"] if d["name"] == "ride_rate.fl")
    shown = corner.locator("[data-value='ride_rate.fl']").inner_text()
    assert with_interval(rate["value"], rate["half95_sheet"]) in shown
    tops = watch.at("axle-table").evaluate("""(e) => {
      const main = document.getElementById("main");
      main.scrollTop += e.getBoundingClientRect().top - main.getBoundingClientRect().top + 60;
      return [e, e.querySelector("th")].map((one) => one.getBoundingClientRect().top);
    }""")
    assert tops[1] - tops[0] < 2.0, "the head goes with its table, and covers none of its lines"
    drawn = watch.page.locator(".car-numbers").first.text_content() or ""
    rolls = [d for d in found["derived"] if d["kind"] in ("roll_stiffness", "load_transfer", "roll_gradient")]
    assert len(rolls) >= 4
    for d in rolls:
        assert f" {to_interval(d['value'], d['half95_sheet'])} {d['unit']}" in drawn, "one number, rounded in one way"
    watch.at("values-sheet").uncheck()
    shown = corner.locator("[data-value='ride_rate.fl']").inner_text()
    assert with_interval(rate["value"], rate["half95"]) in shown
    watch.at("values-sheet").check()
    watch.at("values-against").select_option("1")
    table = watch.at("values-parameters")
    watch.expect(table).to_contain_text("Version 1")
    line = table.locator("tr[data-parameter='spring.fl.k']")
    watch.expect(line).to_contain_text("front left spring rate")
    watch.expect(line).to_contain_text("ks27")
    watch.expect(line).to_contain_text("●")
    watch.expect(table.locator(f"tr[data-parameter='{BAR}.k']")).to_contain_text("new")
    watch.at("values-filter").fill("anti-roll")
    watch.expect(table.locator("tbody tr")).to_have_count(1)
    watch.at("values-filter").fill("")
    watch.picture("car-values")
