"""A channel that is missing makes rows disappear, by name; no zero stands in for it in a row that stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lacet.daq.channels import CHANNELS, IN_EQUATIONS
from lacet.daq.formats.open_run import open_run
from lacet.identify.car.rows import ROWS
from lacet.identify.effects.catalogue import base_model
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import FitOptions, fit
from lacet.identify.signals.reconstruct import Recording, Signals
from tests.identify import cars

VEHICLE, RIG = cars.reference_car()


@pytest.fixture(scope="module")
def whole() -> PreparedRun:
    """Five seconds of a run with every channel."""
    run = open_run(cars.CAR / "sine.parquet")
    signals = {}
    for name, s in run.signals.items():
        keep = (s.t >= 5.0) & (s.t < 10.0)
        signals[name] = replace(s, t=s.t[keep], values=s.values[keep], flags=s.flags[keep])
    return PreparedRun.of(replace(run, signals=signals), VEHICLE, RIG)


def lacking(recording: Recording, *lost: str) -> Recording:
    """The recording without some channels, on the same grid."""
    parts = [
        {name: a for name, a in part.items() if name not in lost}
        for part in (recording.signals.value, recording.signals.rate, recording.signals.accel)
    ]
    usable = {name: mask for name, mask in recording.usable.items() if name not in lost}
    return replace(recording, signals=Signals(*parts), usable=usable)


FAMILIES = {channel.family: name for name, channel in reversed(CHANNELS.items()) if not channel.recorded_only}
"""One channel of each family, the first corner's."""


def said_to_be(drive: PreparedRun, reference: str, tables: bool) -> PreparedRun:
    """The same signals of a car with or without bench tables, in another wheel reference, brakes off for spin rows."""
    vehicle = cars.with_tables(VEHICLE) if tables else VEHICLE
    return PreparedRun(replace(drive.recording, reference=reference, brakes="off", vehicle=vehicle))


@pytest.fixture(scope="module")
def cars_of(whole: PreparedRun) -> dict[tuple[str, bool], PreparedRun]:
    """Both wheel references, with and without bench tables."""
    return {(ref, tables): said_to_be(whole, ref, tables) for ref in ("contact", "hub") for tables in (True, False)}


@pytest.mark.parametrize(
    ("lost", "reference", "tables"),
    [
        *((name, "contact", True) for name in IN_EQUATIONS),
        *((name, reference, False) for name in FAMILIES.values() for reference in ("contact", "hub")),
    ],
)
def test_rows_without_their_channel_disappear_and_the_others_stay_as_they_are(
    cars_of: dict[tuple[str, bool], PreparedRun], lost: str, reference: str, tables: bool
) -> None:
    """Every row that stays has the very same left side and columns as with the channel: nothing was filled in.

    Ground lasers alone may move tyre rows a little: three give the road's plane as four do, with other noise.
    """
    full = cars_of[reference, tables]
    less = PreparedRun(lacking(full.recording, lost))
    for row in full.rows:
        if row not in less.rows:
            assert lost in less.motion.left_out[row].channels, row
    own = {row for row in ROWS if row.endswith(lost.split(".")[1]) or row.startswith("chassis")}
    assert {row for row in full.rows if row not in less.rows} <= (own if CHANNELS[lost].corner else set(ROWS))
    model = Model.of(base_model(less.recording.vehicle, reference))
    for row in less.rows:
        if CHANNELS[lost].family == "laser.ground" and row.startswith("tyre"):
            assert np.std(less.measured[row] - full.measured[row]) < 0.02 * np.std(full.measured[row]), row
            continue
        np.testing.assert_array_equal(less.measured[row], full.measured[row], err_msg=row)
        W, expected = less.matrix(model.physics, row), full.matrix(model.physics, row)
        for k, name in enumerate(model.names):
            atol = 1e-11 * (1.0 + np.max(np.abs(expected[:, k])))
            np.testing.assert_allclose(W[:, k], expected[:, k], rtol=0.0, atol=atol, err_msg=f"{row}, {name}")


@pytest.mark.parametrize("lost", FAMILIES.values(), ids=FAMILIES.keys())
def test_the_fit_still_runs_and_names_the_channel(whole: PreparedRun, lost: str) -> None:
    """Parameters of rows that are gone are absent, by name, not zero columns that were fitted."""
    whole = said_to_be(whole, "contact", tables=False)
    drive = PreparedRun(lacking(whole.recording, lost))
    model = Model.of(base_model(VEHICLE, "contact"))
    fitted = fit(model, [drive], FitOptions(unbias=False))
    gone = set(whole.rows) - set(drive.rows)
    assert all(lost in drive.motion.left_out[row].channels for row in gone)
    absent = {model.names[int(i)] for i in fitted.base.absent}
    for effect in model.physics:
        rows = set(drive.effect_columns(effect, None)) | set(whole.effect_columns(effect, None))
        if rows <= gone:
            assert {q.name for q in effect.parameters} <= absent, effect.key
    assert np.all(np.isfinite(fitted.theta))
    if lost.startswith(("wheel", "imu.accel", "imu.rate", "laser.fl.hub", "camera")) and not lost.endswith("angle"):
        assert gone, "a channel of the equations"
    else:
        assert lost.endswith(("angle", "attitude", "speed", "ground", "torque", "pressure"))
