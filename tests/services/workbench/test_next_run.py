"""The next run for two effects that the runs at hand cannot tell apart: regions of their sizes, as drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lacet.identify.effects.base import Effect
from lacet.identify.multibody.vectors import Array
from lacet.services.workspace.study import Study
from tests.services.workbench.bench_page import Page

PAIR = ("sensor_crosstalk.fl.zx", "sensor_misalignment.wheel.fl.pitch")
"""Both put a part of the wheel's vertical force into the longitudinal one: for small angles the same part."""
CHI2 = 5.991
"""95 % of χ² with two degrees of freedom."""
effects_of = Study.effects


def form(edge: Any) -> Array:
    """(2, 2) matrix A of an ellipse (x - 1)ᵀ A (x - 1) = `CHI2`, by least squares over the (points, 2) of its edge."""
    x, y = np.array(edge).T - 1.0
    squares = np.stack([x * x, 2.0 * x * y, y * y], axis=1)
    (a, b, c), left, *_ = np.linalg.lstsq(squares, np.full(len(x), CHI2), rcond=None)
    assert left == pytest.approx(0.0, abs=1e-6), "no ellipse about the sizes"
    return np.array([[a, b], [b, c]])


def test_a_tie_is_a_long_ellipse_along_what_cancels_and_the_run_shortens_it(
    page: Page, monkeypatch: pytest.MonkeyPatch
):
    def known(study: Study, reference: str) -> dict[str, Effect]:
        return {key: e for key, e in effects_of(study, reference).items() if e.base or key in PAIR}

    monkeypatch.setattr(Study, "effects", known)
    monkeypatch.setattr("lacet.services.planning.separation.SECONDS", 5.0)
    monkeypatch.setattr("lacet.services.planning.separation.kinds", lambda only, without: ["liftoff"])
    found = page.run("next", effects=list(PAIR))["next"]
    assert found["picture"]["effects"] == [one["effect"] for one in found["effects"]] == list(PAIR)
    assert found["now"] < 1.0 < found["needed"] < found["runs"][0]["after"], "tied now, and told apart after the run"
    now, after = form(found["picture"]["now"]), form(found["picture"]["after"])
    sizes = np.array([one["values"][0] for one in found["effects"]])
    (least, most), axes = np.linalg.eigh(now)
    assert most > 1000.0 * least, "the ellipse is long"
    crosstalk, pitch = axes[:, 0] * sizes
    assert crosstalk == pytest.approx(pitch, rel=0.02), "along what cancels"
    apart = np.array(found["picture"]["after"]) - 1.0
    assert np.max(np.einsum("ni,ij,nj->n", apart, now, apart)) < CHI2, "a run only adds to what is known"
    assert np.linalg.eigvalsh(after)[0] > 100.0 * least
    # The fit of both has these intervals, the zeros and gains of the sheet left out or included.
    for effect in PAIR:
        page.run("add", effect=effect)
    fitted = {one["name"].rpartition(".")[0]: one for one in page.get("parameters")["parameters"]}
    for effect, half in zip(PAIR, 1.96 * sizes * np.sqrt(np.diag(np.linalg.inv(now))), strict=True):
        assert fitted[effect]["half95"] < half < fitted[effect]["half95_sheet"]
