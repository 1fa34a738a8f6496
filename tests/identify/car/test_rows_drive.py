"""A whole drive of the swing-arm car (tests/support/swing_car), without noise, through filters and fit.

The car drives and brakes in turn on a shaker road, its driven rear wheels on trailing arms that pitch 1.8 rad/m.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from lacet.daq.channels import CORNERS
from lacet.daq.rig import Rig
from lacet.daq.run import Run, Signal
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.catalogue import base_model
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.validation.parameter_estimates import estimates
from lacet.services.render.rows import row_absence

pytest.importorskip("mujoco")
from tests.support import swing_car as swing

PRESSURE = "brake.pressure"


@cache
def drive(inboard: str) -> swing.Drive:
    """Seven seconds: 0.5 kN·m on each rear wheel, then as much braking on all four."""
    return swing.drive(swing.default_car("r", inboard), 7.0, 500.0, 500.0)


def fitted(reference: str, inboard: str = "", measured: tuple[str, ...] = (), brakes: str = "used") -> Fit:
    """The base model fitted to it, with the torque channels `measured` (by the beginning of their name)."""
    driven = drive(inboard)
    value = dict(driven.value[reference])
    value[PRESSURE] = value["brake.fl.torque"] * 1e5 / 25.0
    signals = {
        name: Signal(driven.t, x.T, np.zeros(driven.t.size, np.uint8))
        for name, x in value.items()
        if not name.startswith(("shaft", "brake")) or name.startswith(measured or ("no torque",))
    }
    vehicle = Vehicle.parse(swing.vehicle_text(swing.default_car("r", inboard)))
    run = Run("drive", signals, brakes=brakes, wheel_reference=reference)
    found = PreparedRun.of(run, vehicle, Rig.parse(swing.rig_text(reference)))
    return fit(Model.of(base_model(vehicle, reference)), [found], FitOptions(zeros=False, unbias=False))


def errors(result: Fit, reference: str) -> dict[str, float]:
    """Relative error of springs, dampers, offsets, tyres and outboard masses by name."""
    true = swing.truth(swing.default_car(), reference)
    kinds = ("spring", "damper", "offset", "tyre_stiffness", "outboard_mass")
    return {
        e.name: abs(e.value / true[e.name] - 1.0)
        for e in estimates(result, runs=result.runs)
        if e.identifiable and e.name.split(".")[0] in kinds
    }


@pytest.mark.parametrize(
    ("reference", "inboard", "measured", "rows"),
    [
        ("contact", "", ("shaft", "brake"), 18),
        ("hub", "", ("shaft", "brake"), 18),
        ("contact", "", (PRESSURE,), 16),  # rear spin rows: the drive torque is not measured
        ("hub", "", (PRESSURE,), 16),
        ("hub", "", ("brake.",), 16),
        ("contact", "r", (), 14),  # front brakes are outboard: no spin row there either
        ("hub", "r", ("shaft",), 16),
    ],
)
def test_what_the_drive_was_made_with_comes_out(
    reference: str, inboard: str, measured: tuple[str, ...], rows: int
) -> None:
    """Springs, offsets and tyres within 0.02 %, dampers within 0.1 %; every row within 0.3 N or N·m."""
    result = fitted(reference, inboard, measured)
    assert len(result.runs[0].rows) == rows, result.runs[0].motion.left_out
    found = errors(result, reference)
    assert {f"{kind}.{c}" for kind in ("spring", "damper", "offset") for c in CORNERS} <= {
        name.rsplit(".", 1)[0] for name in found
    }
    for name, error in found.items():
        assert error < (1e-3 if name.startswith("damper") else 2e-4), (name, error)
    for row, residual in result.residual[0].items():
        assert np.sqrt(np.mean(residual**2)) < 0.3, row


def test_braking_declared_off_bends_the_springs() -> None:
    """The same drive with brakes = 'off': the brakes' torque is taken for the half-shaft's, and a spring is 6 % off."""
    result = fitted("hub", brakes="off")
    found = errors(result, "hub")
    assert found["spring.rl.k"] > 0.04
    assert found["spring.fl.k"] < 2e-4, "the front wheels are not driven"
    assert np.sqrt(np.mean(result.residual[0]["suspension.rl"] ** 2)) > 100.0


def test_without_any_brake_signal_the_driven_suspensions_are_left_out() -> None:
    """And all else is as good as before."""
    result = fitted("hub")
    assert not {"suspension.rl", "suspension.rr"} & set(result.runs[0].rows)
    assert "half-shaft" in row_absence(result.runs[0].motion.left_out["suspension.rl"])
    found = errors(result, "hub")
    assert "spring.rl.k" not in found
    assert found["spring.fl.k"] < 2e-4
