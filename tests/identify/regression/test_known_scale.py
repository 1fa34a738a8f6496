"""How well the scale of a fit without wheel loads is known."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from lacet.daq.vehicle import Vehicle
from lacet.identify.properties.known_scale import KnownScale, known_scale
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.parameter_estimates import WIDE, estimates
from lacet.services.render.known_scale import scale_result, weak_scale
from tests.identify import cars
from tests.identify.regression.test_no_wheel_loads import all_true, fitted_to, found, giving, moving


@pytest.fixture(scope="module")
def right() -> dict[str, float]:
    """Parameters of the reference car."""
    truth: dict[str, Any] = json.loads((cars.CAR / "truth.json").read_text(encoding="utf-8"))
    return all_true(truth)


def scale_of(fitted: Fit) -> KnownScale:
    """The scale of a fit without wheel loads."""
    scale = known_scale(fitted, estimates(fitted, None, fitted.runs))
    assert scale is not None
    return scale


def test_a_known_mass_sets_the_scale_of_three_runs() -> None:
    scale = scale_of(found())
    assert scale.known == ("sprung_mass",)
    assert 0.0 < scale.disturbed < 0.05
    assert not scale.weak
    assert weak_scale({"known_scale": scale_result(scale)}) == ""


def test_what_is_assumed_beside_it_may_be_all_of_what_is_known(right: dict[str, float]) -> None:
    """With patches that shift by 0.1 mm/N, or not, roll is not the known inertia's: sizes are said to be unknown."""
    known = giving("roll_inertia", right["XX6"])
    shift = 'lateral_shift.{} = {{ value = 3e-6, tolerance = 1e-4, unit = "m/N", source = "a guess" }}\n'
    unsure = Vehicle.parse(known.text + "".join(shift.format(axle) for axle in ("front", "rear")))
    sure, wide = (scale_of(fitted_to(moving(), vehicle)) for vehicle in (known, unsure))
    assert not sure.weak
    assert wide.disturbed > max(WIDE, 10.0 * sure.disturbed)
    says = weak_scale({"known_scale": scale_result(wide)})
    assert "hardly known" in says
    assert "give sprung_mass" in says


def test_where_no_parameter_is_determined_the_scale_is_unknown(right: dict[str, float]) -> None:
    """One smooth run: other parameters do what the damper does; the mass found is a fifth of the true one."""
    fitted = fitted_to(moving()[:1], giving("damper_rate.rear", right["damper.rl.c"]))
    assert fitted.value("M6") < 0.5 * right["M6"]
    scale = scale_of(fitted)
    assert scale.disturbed < WIDE
    assert scale.weak
    assert "do not relate any spring or damper to damper_rate.rear" in weak_scale({"known_scale": scale_result(scale)})


@pytest.mark.parametrize(("kinds", "weak"), [(("offset.", "YY6", "MX6"), True), (("spring.",), False)])
def test_static_loads_and_inertias_alone_relate_no_law_to_a_known_mass(kinds: tuple[str, ...], weak: bool) -> None:
    """They follow from it, however wrong springs are."""
    every = [e for e in estimates(found(), None, found().runs) if e.identifiable and e.name.startswith(kinds)]
    assert any(e.half_sheet <= WIDE * abs(e.value) for e in every)
    scale = known_scale(found(), every)
    assert scale is not None
    assert scale.weak is weak


def test_measured_wheel_loads_are_the_scale(fitted: Fit) -> None:
    assert known_scale(fitted, []) is None
    assert scale_result(None) is None
    assert weak_scale({}) == ""


def test_nothing_known_that_moves_is_no_scale() -> None:
    """Left sides without any change are plain data, too."""
    result = scale_result(KnownScale(("roll_inertia",), np.inf, True))
    assert result is not None
    assert result["disturbed"] is None
    assert result["weak"]
