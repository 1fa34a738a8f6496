"""Singular and badly scaled problems name the parameters involved, and what hardly moves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lacet.daq.errors import UsageError
from lacet.daq.formats.open_run import open_run
from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Parameter, SuspensionForce
from lacet.identify.effects.catalogue import base_model
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.identifiability import (
    NotFinite,
    Undetermined,
    explain_grouping,
    explain_singular,
    explain_weak,
    not_finite,
    refuse_not_finite,
    weak_directions,
)
from lacet.identify.regression.information import Information
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import FitOptions, fit
from lacet.services.render.identifiability import open_direction
from tests.identify import cars

VEHICLE, RIG = cars.reference_car()


@given(st.integers(0, 10**6), st.integers(2, 6))
@settings(max_examples=40, deadline=None)
def test_every_null_direction_is_found_with_those_that_take_part(seed: int, width: int) -> None:
    """A column that is a sum of some others: the direction names exactly these, and the equations vanish along it."""
    rng = np.random.default_rng(seed)
    W = rng.normal(size=(40, width + 2))
    some = rng.choice(width, size=min(width, 3), replace=False)
    W[:, -1] = W[:, some] @ rng.choice([-1.0, 1.0], len(some))
    priors = rng.uniform(0.5, 2.0, width + 2)
    (direction,) = weak_directions(W / priors, priors)
    assert {i for i, _ in direction} == {*some.tolist(), width + 1}
    change = np.zeros(width + 2)
    for i, c in direction:
        change[i] = c
    np.testing.assert_allclose(W @ change, 0.0, atol=1e-9)
    assert max(abs(c) for _, c in direction) == pytest.approx(1.0)


def test_several_singular_directions_stand_by_themselves() -> None:
    """Two pairs and a lone one, not a mixture of all five."""
    W = np.random.default_rng(1).normal(size=(30, 6))
    W[:, 1], W[:, 3], W[:, 4] = -W[:, 0], 2 * W[:, 2], 0.0
    told = [open_direction(one) for one in explain_singular(W, ["a", "b", "c", "d", "e", "f"], np.ones(6))]
    assert sorted(told) == sorted([
        "a (50 %) and b (50 %) cannot be told apart", "c (80 %) and d (20 %) cannot be told apart",
        "e is not determined",
    ])  # fmt: skip
    assert explain_singular(W[:, [0, 2, 5]], ["a", "c", "f"], np.ones(3)) == []


def test_plausible_sizes_decide_what_is_badly_scaled() -> None:
    """N/m beside kg are no fault; a direction known a million times worse in plausible sizes is."""
    W = np.diag([1e-5, 1.0, 1e-9])
    names = ["k", "m", "x"]
    assert explain_singular(W, names, [1e5, 1.0, 1e9]) == []
    assert explain_singular(W, names, [1e5, 1.0, 1.0]) == [Undetermined(("x",))]
    assert explain_singular(np.zeros((2, 2)), ["a", "b"], [1.0, 1.0]) == [Undetermined(("a",)), Undetermined(("b",))]
    with pytest.raises(UsageError, match="columns of m"):
        explain_singular(np.diag([1.0, np.nan, 1.0]), names, np.ones(3))


def hardly_moving(amplitude: float) -> PreparedRun:
    """A run of the reference car whose front left suspension moves by `amplitude` [m] only, by its laser."""
    run = open_run(cars.CAR / "sine.parquet")
    hub = run.signals["laser.fl.hub"]
    values = np.mean(hub.values) + 0.01 + amplitude * np.sin(7.0 * hub.t)[:, None]
    return PreparedRun.of(run.with_values({"laser.fl.hub": values}), VEHICLE, RIG)


def test_a_travel_that_does_not_move_merges_spring_and_load_and_is_told() -> None:
    """No travel: spring and static load are one parameter, which the runs, not the car's build, merge."""
    drive, model = hardly_moving(0.0), Model.of(base_model(VEHICLE, "hub"))
    fitted = fit(model, [drive], FitOptions(unbias=False))
    told = [open_direction(one) for one in explain_grouping(fitted.base, model, [drive])]
    assert any(
        line.startswith("offset.fl.f0 cannot be told from spring.fl.k: travel at fl moves by ± 0 mm") for line in told
    ), told
    assert not any("M29" in line for line in told)  # an axle's and its hub's mass are one by the car's build


def test_a_travel_that_hardly_moves_is_told_with_its_size() -> None:
    """A hundredth of a millimetre: not singular, yet the runs know no more than what is plausible."""
    drive, model = hardly_moving(1e-5), Model.of(base_model(VEHICLE, "hub"))
    known = Information.of(fit(model, [drive], FitOptions(unbias=False)))
    found = explain_weak(known.root, known.names, model, [drive])
    told = [line for line in map(open_direction, found) if "spring.fl.k" in line]
    assert len(told) == 1
    assert "travel at fl moves by ± 0.007" in told[0], told


class Broken(SuspensionForce):
    """A law with a root of negative numbers."""

    name = "broken"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """One."""
        return (self.named("b", "N/m^0.5", -1.0, 1.0),)

    def law(self, travel: Array, rate: Array) -> Array:
        """√s: not finite in extension."""
        with np.errstate(invalid="ignore"):
            return np.sqrt(travel)


def test_values_that_are_not_finite_are_placed() -> None:
    """Effect, run, row and instant; nothing is said of what is sound."""
    drive = PreparedRun.of(open_run(cars.CAR / "sine.parquet"), VEHICLE, RIG)
    sound = Model.of(base_model(VEHICLE, "hub")).physics
    assert not_finite(sound, [drive]) == []
    refuse_not_finite(sound, [drive])
    row = Row.parse("suspension.fl")
    t, bad = drive.recording.t[drive.index[row]], ~np.isfinite(drive.columns(Broken("fl"))[row][0])
    (found,) = not_finite([*sound, Broken("fl")], [drive])
    assert found == NotFinite("sine", row, "broken.fl", t[bad][0], bad.sum(), t.size)
    with pytest.raises(UsageError) as refused:
        refuse_not_finite([Broken("fl")], [drive])
    where = f"at t = {found.first:.2f} s ({found.count} of {t.size} samples)"
    assert str(refused.value) == (
        f"the equations have values that are not finite:\n  - sine, suspension.fl: broken.fl is not finite {where}"
        "\nMend the effect's columns() (a division, a root or a logarithm?), or leave it out"
    )
    drive.measured["tyre.rr"][3] = np.inf
    (found,) = not_finite(sound, [drive])
    assert (found.row, found.effect, found.count) == ("tyre.rr", None, 1)
    assert found.first == drive.recording.t[drive.index[found.row]][3]
    with pytest.raises(UsageError, match=r"sine, tyre\.rr: the measured side is not finite at t = "):
        refuse_not_finite(sound, [drive])
