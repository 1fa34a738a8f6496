"""Instruments from even and odd samples: the bias of noise is seen and removed, whatever the sheet says."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from lacet.daq.errors import NotIdentifiable
from lacet.daq.formats.open_run import open_run
from lacet.daq.run import Run, signal_of
from lacet.identify.car.rows import TYRE_ROWS, Row
from lacet.identify.effects.catalogue import catalogue
from lacet.identify.properties.whole_vehicle import NAMES, whole_vehicle
from lacet.identify.regression.instrumental_variables import Instruments, Pair, fit_instruments, pair_of, pairs_of
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, fit
from tests.identify import cars

VEHICLE, RIG = cars.reference_car()
KNOWN = catalogue(VEHICLE, "hub")
BARS = (
    Model.of(effect for effect in KNOWN.values() if effect.base)
    + KNOWN["anti_roll_bar.front"]
    + KNOWN["anti_roll_bar.rear"]
)
OUTBOARD = [f"outboard_mass.{c}.m" for c in VEHICLE.corners]


def noisier(run: Run, factor: float, seed: int = 0) -> Run:
    """The run with white noise added until its σ is `factor` times the sheet's."""
    rng = np.random.default_rng(seed)
    extra = np.sqrt(factor**2 - 1.0)
    return run.with_values(
        {n: s.values + extra * RIG.noise(n) * rng.standard_normal(s.values.shape) for n, s in run.signals.items()}
    )


def fitted(runs: list[Run], unbias: bool = True) -> Fit:
    """Both bars in the model."""
    return fit(BARS, [PreparedRun.of(run, VEHICLE, RIG) for run in runs], FitOptions(unbias=unbias))


def against(runs: list[Run]) -> Instruments:
    """The default fit against its instruments."""
    least = fitted(runs)
    return fit_instruments(least, pairs_of(least, runs))


@pytest.fixture(scope="module")
def rough() -> Run:
    """Some seconds of the rough road."""
    return cars.piece("rough", 4.0, 18.0)


@pytest.fixture(scope="module")
def plain(rough: Run) -> Fit:
    """Plain least squares on the rough road."""
    return fitted([rough], unbias=False)


def test_a_run_as_its_own_instrument_is_least_squares(plain: Fit) -> None:
    """With both halves the run itself the equations are those of least squares, and nothing may differ."""
    found = fit_instruments(plain, [Pair(plain.runs[0], plain.runs[0])])
    spread = np.sqrt(np.maximum(np.diag(plain.covariance), 1e-30))
    np.testing.assert_array_less(np.abs(found.fit.theta - plain.theta) / spread, 1e-3)
    np.testing.assert_allclose(found.plain.difference / spread, 0.0, atol=1e-6)
    # The covariance is that of the fit: the sandwich of the same scores.
    both = np.diag(found.fit.covariance)[plain.base.independent] / np.diag(plain.covariance)[plain.base.independent]
    np.testing.assert_allclose(both, 1.0, rtol=0.02)
    for row, series in plain.residual[0].items():
        np.testing.assert_allclose(found.fit.residual[0][row], series, atol=2e-3 * plain.sigma[row])


def test_halves_carry_the_same_motion_and_other_noise(rough: Run, plain: Fit) -> None:
    """The halves' mean is the recording, and their difference is noise of twice the pre-filtered density."""
    drive = plain.runs[0]
    pair = pair_of(rough, drive.recording)
    inside = slice(200, -200)
    for name in ("wheel.fl.force", "laser.rr.hub", "imu.accel", "camera.fl.steer"):
        even, odd, full = (
            one.recording.signals.value[name][:, inside]
            for one in (pair.even, pair.odd, drive.recording.signals and drive)
        )
        # Butterworth at 20 Hz on white noise of σ at a channel's rate leaves about σ √(2·20/rate).
        left = RIG.noise(name) * np.sqrt(2.0 * 20.0 / drive.recording.rates[name])
        assert np.std(even - odd) == pytest.approx(2.0 * left, rel=0.15), name
        assert np.std(0.5 * (even + odd) - full) < 0.3 * left, name
        assert abs(np.corrcoef((even - full).ravel(), (odd - full).ravel())[0, 1] + 1.0) < 0.1, name


def test_the_sheets_noise_biases_plain_fits_and_the_correction_removes_it(rough: Run, plain: Fit) -> None:
    """The alarm rings for plain least squares; the corrected fit agrees with instruments that never saw the sheet."""
    found = against([rough])
    assert found.plain.p < 1e-6
    assert found.corrected.p > 0.001
    names = list(BARS.names)
    for name in OUTBOARD:
        i = names.index(name)
        assert abs(found.plain.z[i]) > 3.0, name
        assert abs(found.corrected.z[i]) < 4.0, name
    # The plain estimate it tests is that of the plain fit, but for the row weights.
    moved = found.fit.theta + found.plain.difference
    spread = np.sqrt(np.diag(plain.covariance))
    for name in OUTBOARD:
        i = names.index(name)
        assert moved[i] == pytest.approx(plain.theta[i], abs=0.1 * spread[i]), name


def test_twice_the_noise_is_seen_and_removed(rough: Run) -> None:
    """With noise that the sheet does not know, the corrected fit is off as well; the instruments are not."""
    found = against([noisier(rough, 2.0)])
    assert found.corrected.p < 1e-6
    names = list(BARS.names)
    truth = json.loads((cars.CAR / "truth.json").read_text(encoding="utf-8"))["wheel_rim_and_tyre"]["mass"]
    off = {"corrected": [], "instruments": []}
    for name in OUTBOARD:
        i = names.index(name)
        half = 1.96 * np.sqrt(found.fit.covariance[i, i])
        assert abs(found.fit.theta[i] - truth) < 1.5 * half, name
        assert abs(found.corrected.z[i]) > 4.0, name
        off["corrected"].append(found.of.theta[i] - truth)
        off["instruments"].append(found.fit.theta[i] - truth)
    assert abs(np.mean(off["instruments"])) < 0.75 * abs(np.mean(off["corrected"]))
    # It is a fit like any other: reports take it.
    whole = whole_vehicle(found.fit, VEHICLE)
    assert whole is not None
    assert whole.determined[NAMES.index("mass")]
    assert set(found.fit.residual[0]) >= set(TYRE_ROWS)


def test_a_channel_too_short_to_be_halved_is_named(rough: Run, plain: Fit) -> None:
    """Forty good samples make a channel, twenty do not."""
    signal = rough.signals["correvit.speed"]
    flags = np.full_like(signal.flags, 0xFF)
    flags[:40] = 0
    short = replace(rough, signals={**rough.signals, "correvit.speed": replace(signal, flags=flags)})
    with pytest.raises(NotIdentifiable, match=r"correvit\.speed has too few usable samples to be halved"):
        pair_of(short, plain.runs[0].recording)


def test_where_the_brakes_act_halves_have_the_rows_of_the_whole_run(rough: Run) -> None:
    """The pressure crosses 1 bar between two of its samples."""
    t = rough.signals["wheel.fl.force"].t
    pressure = 1e5 * (t - t[0]) / np.ptp(t) + 1e4 * np.random.default_rng(0).standard_normal(t.size)
    signals = {**rough.signals, "brake.pressure": signal_of("brake.pressure", t, pressure[:, None])}
    braked = replace(rough, brakes="unknown", signals=signals)
    plain = fitted([braked], unbias=False)
    (drive,), (pair,) = plain.runs, pairs_of(plain, [braked])
    own = {len(PreparedRun(half.recording).index[Row.parse("spin.rl")]) for half in (drive, pair.even, pair.odd)}
    assert len(own) > 1  # by its own pressure a half has other samples
    for half in (pair.even, pair.odd):
        assert {row: list(at) for row, at in half.index.items()} == {row: list(at) for row, at in drive.index.items()}
    assert fit_instruments(plain, [pair]).fit.residual[0].keys() == set(drive.rows)


@pytest.mark.slow
def test_iyy_and_outboard_mass_with_twice_the_noise(rough: Run) -> None:
    """The two values that noise moves most, on all four runs: off with the sheet's noise, right with instruments."""
    runs = [noisier(open_run(cars.CAR / f"{name}.parquet"), 2.0, k) for k, name in enumerate(cars.RUNS)]
    found = against(runs)
    truth = json.loads((cars.CAR / "truth.json").read_text(encoding="utf-8"))
    k, Iyy = NAMES.index("Iyy"), truth["inboard_at_design"]["inertia_about_cog_kg_m2"][1][1]
    least = replace(found.fit, theta=found.fit.theta + found.plain.difference)
    whole = {key: whole_vehicle(one, VEHICLE) for key, one in {"plain": least, "iv": found.fit}.items()}
    assert whole["plain"] is not None
    assert whole["iv"] is not None
    assert abs(whole["iv"].values[k] - Iyy) < 1.5 * whole["iv"].interval[k]
    assert abs(whole["iv"].values[k] - Iyy) < abs(whole["plain"].values[k] - Iyy)
    names = list(BARS.names)
    outboard = truth["wheel_rim_and_tyre"]["mass"]
    places = [names.index(name) for name in OUTBOARD]
    assert np.mean(found.corrected.difference[places]) > 0.03 * outboard
    assert np.all(found.corrected.z[places] > 4.0)
    # One campaign's scatter hides the gain in a single value, not in the difference: the interval must hold the truth.
    half = 1.96 * np.sqrt(np.diag(found.fit.covariance)[places])
    assert np.all(np.abs(found.fit.theta[places] - outboard) < 1.5 * half)
