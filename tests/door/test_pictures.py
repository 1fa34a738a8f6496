"""Pictures of the library's results: what they show, what they refuse, and what they leave alone."""

from __future__ import annotations

import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import lacet
from lacet.services.library.pictures import Picture
from lacet.services.render.figures.result_plots import forest_figure, ranking_figure, waterfall_figure
from tests.door.test_door import LONGEST


@pytest.fixture(scope="module")
def comparison(fitted: lacet.Fit) -> lacet.Comparison:
    return lacet.compare(fitted, draws=3)


def size(picture: Picture) -> tuple[int, int]:
    """Width and height of a PNG [px]."""
    png = picture._repr_png_()
    assert png.startswith(b"\x89PNG\r\n\x1a\n")
    return struct.unpack(">II", png[16:24])


def test_every_result_draws_itself(
    comparison: lacet.Comparison, ranking: lacet.Ranking, fitted: lacet.Fit, tmp_path: Path
) -> None:
    all_rows, two = comparison.plot("sine"), comparison.plot("sine", ["suspension.fl", "chassis.mx"])
    assert size(all_rows)[1] > 3 * size(two)[1]
    for picture in (all_rows, two, comparison.plot_map(), ranking.plot(), fitted.plot()):
        assert min(size(picture)) > 100
        assert len(repr(picture)) < LONGEST
    file = two.save(tmp_path / "two.png")
    assert file.read_bytes() == two.png


def test_what_cannot_be_drawn_is_refused_by_name(
    comparison: lacet.Comparison, fitted: lacet.Fit, tmp_path: Path
) -> None:
    with pytest.raises(lacet.UsageError, match="no run 'sin' in this comparison: sine, liftoff"):
        comparison.plot("sin")
    with pytest.raises(lacet.UsageError, match=r"sine has no row suspension\.f"):
        comparison.plot("sine", ["suspension.f"])
    with pytest.raises(KeyError, match=r"did you mean 'spring\.fl\.k'"):
        fitted.plot(["spring.fl.kk"])
    vague = next(one.name for one in fitted.parameters if not one.identifiable)
    with pytest.raises(lacet.UsageError, match="not identifiable"):
        fitted.plot([vague])
    with pytest.raises(lacet.UsageError, match="two steps"):
        lacet.waterfall({"base model": comparison})
    with pytest.raises(lacet.UsageError, match=r"ends with \.png"):
        comparison.plot_map().save(tmp_path / "map.pdf")
    with pytest.raises(lacet.UsageError, match="cannot be written: No such file"):
        comparison.plot_map().save(tmp_path / "nowhere" / "map.png")


def test_the_bars_of_a_waterfall_are_the_steps_between_the_errors() -> None:
    axes = waterfall_figure({"base": 6.0, "front": 2.5, "rear": 3.0}).axes[0]
    assert [(bar.get_y(), bar.get_height()) for bar in axes.patches] == [(0, 6.0), (2.5, 3.5), (2.5, 0.5), (0, 3.0)]
    assert [text.get_text() for text in axes.texts] == ["6.00", "2.50", "3.00"]
    fell, rose = (axes.patches[k].get_facecolor() for k in (1, 2))
    assert fell != rose


def test_the_lines_of_a_forest_are_the_intervals_and_crosses_what_is_known(fitted: lacet.Fit) -> None:
    one = next(p for p in fitted.parameters if p.name == "spring.fl.k")
    axes = forest_figure([one], {"spring.fl.k": 1.01 * one.value}).axes[0]
    thin, thick, cross = axes.lines[:3]
    np.testing.assert_allclose(thin.get_xdata(), np.array([-100, 100]) * one.half_sheet / one.value)
    np.testing.assert_allclose(thick.get_xdata(), np.array([-100, 100]) * one.half / one.value)
    np.testing.assert_allclose(cross.get_xdata(), 1.0)


def test_the_bars_of_a_ranking_are_gains_largest_first(ranking: lacet.Ranking) -> None:
    axes = ranking_figure(ranking.candidates, 2).axes[0]
    gains = [bar.get_width() for bar in axes.patches]
    assert gains == sorted((100.0 * c.gain for c in ranking.candidates), reverse=True)[:2]
    assert "missing" in axes.texts[0].get_text()


def test_a_notebook_keeps_its_own_way_of_drawing() -> None:
    code = (
        "import matplotlib; matplotlib.use('svg'); import lacet.services.render.figures.png; "
        "print(matplotlib.get_backend())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.strip() == "svg"
