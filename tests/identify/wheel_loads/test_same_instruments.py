"""Errors of instruments that study and run have in common: in both, they cancel in part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.daq.rig import Rig
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.signals.reconstruct import Signals
from lacet.identify.wheel_loads.known_car import KnownCar
from lacet.identify.wheel_loads.observer import estimate_forces
from lacet.identify.wheel_loads.without_dynamometers import LOADS
from tests.identify import cars

VEHICLE, RIG = cars.reference_car()
KNOWN = catalogue(VEHICLE, RIG.wheel_reference)
BARS = ("anti_roll_bar.front", "anti_roll_bar.rear")
LASER = ("gain", "laser.fl.hub", 0)
FORCE = "wheel.fl.force_estimated.z"


def drives(error: float = 0.0) -> list[PreparedRun]:
    """Two pieces of runs, the hub laser in front on the left with an error of its gain, in tolerances."""
    out: list[PreparedRun] = []
    for name in ("sine", "rough"):
        record = PreparedRun.of(cars.piece(name, 5.0, 15.0), VEHICLE, RIG).recording
        values = dict(record.signals.value)
        values["laser.fl.hub"] = values["laser.fl.hub"] * (1.0 + error * RIG.tolerance("laser.fl.hub", "gain"))
        out.append(PreparedRun(record.with_signals(Signals.differentiated(values, record.filters.rate))))
    return out


def fitted_to(runs: list[PreparedRun]) -> Fit:
    model = Model.of(base_model(VEHICLE, RIG.wheel_reference))
    for key in BARS:
        model = model + KNOWN[key]
    return fit(model, runs, FitOptions(unbias=False))


@pytest.fixture(scope="module")
def study() -> Fit:
    """A fit to the two pieces as they are."""
    return fitted_to(drives())


def hidden(run: PreparedRun, rig: Rig = RIG) -> PreparedRun:
    """A run without its dynamometers, measured by a rig."""
    record = run.recording
    values = {name: a for name, a in record.signals.value.items() if name not in LOADS}
    usable = {name: mask for name, mask in record.usable.items() if name in values}
    return PreparedRun(replace(record, signals=replace(record.signals, value=values), usable=usable, rig=rig))


def test_a_parameter_moves_by_an_instruments_error_as_it_is_said_to(study: Fit) -> None:
    moved = fitted_to(drives(3.0)).theta - study.theta
    at = study.model.names.index("spring.fl.k")
    assert moved[at] < 0.0  # a travel that is too large makes a spring too soft
    assert moved[at] == pytest.approx(3.0 * study.sheet_moves[LASER][at], rel=0.1)
    total = np.sum([np.outer(one, one) for one in study.sheet_moves.values()], axis=0)
    np.testing.assert_allclose(total, study.covariance_sheet, rtol=1e-6, atol=1e-9 * np.max(study.covariance_sheet))


def test_the_band_of_a_force_is_narrower_where_the_run_has_the_studys_instruments(study: Fit) -> None:
    car = KnownCar(study)
    own = estimate_forces(car, hidden(drives()[0]))[FORCE]
    text = RIG.text.replace('"laser.hub.gain" = 0.002', '"laser.hub.gain" = 0.0020001')
    other = Rig.parse(text, "other instruments")
    assert [(e.of_study, e.here) for e in car.instrument_errors(RIG, [LASER]) if e.here] == [(LASER, LASER)]
    assert [(e.of_study, e.here) for e in car.instrument_errors(other, [LASER]) if e.here] == [(None, LASER)]
    apart = estimate_forces(car, hidden(drives()[0], other))[FORCE]
    assert np.nanmean(own.half95) < 0.9 * np.nanmean(apart.half95)
