"""Pictures of charts: what is drawn stands where the data are, in text that is small and well formed."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from lacet.services.render.figures.panels import Axis, Band, Dots, Level, Line, Panel, Panels, Scale, plan
from lacet.services.render.figures.png import charts_png
from lacet.services.render.figures.svg import MOST_DOTS, UNIT, svg
from lacet.services.render.figures.ticks import ticks_of

X = np.linspace(0.0, 10.0, 101)


def picture(*marks: Line | Band | Dots | Level, columns: int = 1, charts: int = 1, y: Axis | None = None) -> Panels:
    """Some equal charts of these marks."""
    panel = Panel("row <a> & more\nin two lines", marks, Axis("time [s]"), y or Axis(), tight=True)
    return Panels("a picture", [panel] * charts, columns, (400.0, 200.0))


def points(path: str) -> np.ndarray:
    """The points of a path of one stretch, in the chart's units."""
    first, _, steps = path.removeprefix("M").partition("l")
    numbers = [int(n) for n in re.findall(r"-?\d+", f"{first} {steps}")]
    return np.cumsum(np.reshape(numbers, (-1, 2)), axis=0)


def test_a_line_stands_where_its_samples_are():
    line = Line(X, 100.0 * np.sin(X), "#123456", "measured")
    drawn = picture(line)
    area, (_, (low, high)) = plan(drawn).areas[0], drawn.panels[0].limits()
    (path,) = re.findall(r'd="([^"]*)" style="stroke:#123456;stroke-width:10"', svg(drawn))
    found = points(path) / UNIT
    expected = np.stack([X / 10.0 * area.width, (high - line.y) / (high - low) * area.height], axis=1)
    np.testing.assert_allclose(found, expected, atol=0.06)


def test_a_logarithmic_axis_spaces_decades_evenly():
    drawn = picture(Line(X, 10.0 ** (X / 5.0), "#123456"), y=Axis(scale=Scale.LOGARITHMIC))
    (path,) = re.findall(r'd="([^"]*)" style="stroke:#123456', svg(drawn))
    assert np.abs(np.diff(points(path)[:, 1], 2)).max() <= 1


def test_a_long_run_is_drawn_as_what_its_pixels_show():
    t = np.arange(0.0, 600.0, 0.01)
    y = np.random.default_rng(1).standard_normal(t.size)
    y[12_345] = 50.0
    drawn = picture(Line(t, y, "#123456"), Dots(t, y, "#654321"))
    text = svg(drawn)
    assert len(text) < 40_000
    area = plan(drawn).areas[0]
    (path,) = re.findall(r'd="([^"]*)" style="stroke:#123456', text)
    highest = points(path)[:, 1].min() / UNIT
    assert highest == pytest.approx(area.height * 0.05 / 1.1, abs=0.1), "the peak is there, below the margin"
    (cloud,) = re.findall(r'd="([^"]*)" style="stroke:#654321', text)
    assert cloud.count("h0") <= MOST_DOTS


def test_every_mark_and_label_is_there_in_both_kinds_of_file():
    marks = (
        Line(X, np.sin(X), "#111111", "line", dashed=True, marks=3.0),
        Band(X, np.sin(X) - 1.0, np.sin(X) + 1.0, "#222222", "band"),
        Dots(X, np.cos(X), "#333333", "dots"),
        Level(0.5, "#444444", "level"),
        Level(5.0, "#555555", upright=True),
    )
    drawn = picture(*marks, columns=2, charts=3)
    tree = ElementTree.fromstring(svg(drawn))
    words = [element.text for element in tree.iter() if element.tag.endswith("text")]
    assert words.count("row <a> & more") == words.count("time [s]") == 3
    assert [words.count(label) for label in ("line", "band", "dots", "level")] == [1, 1, 1, 1]
    assert charts_png(drawn).startswith(b"\x89PNG")


def test_holes_and_constants_are_drawn():
    y = np.where((X > 4.0) & (X < 6.0), np.nan, 3.0)
    (path,) = re.findall(r'd="([^"]*)" style="stroke:#123456', svg(picture(Line(X, y, "#123456"))))
    assert path.count("M") == 2
    nothing = svg(picture(Line(X, np.full(X.size, np.nan), "#123456")))
    ElementTree.fromstring(nothing)


@pytest.mark.parametrize(
    ("low", "high", "labels"),
    [
        (-1.2, 1.2, ["−1", "0", "1"]),
        (0.0, 0.31, ["0.0", "0.1", "0.2", "0.3"]),
        (15_900.0, 16_700.0, ["16000", "16200", "16400", "16600"]),
        (0.0, 3.1e6, ["0", "1e6", "2e6", "3e6"]),
    ],
)
def test_ticks_are_round_numbers_with_the_decimals_they_need(low: float, high: float, labels: list[str]):
    assert [label for _, label in ticks_of(Axis(), low, high, 4)] == labels
