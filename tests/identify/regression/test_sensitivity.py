"""The residual's first-order answer to changed channels against rebuilding the motion with them."""

from __future__ import annotations

import numpy as np
import pytest

import lacet.identify.regression.sensitivity
from lacet.daq.channels import CHANNELS
from lacet.identify.car.kinematics import build_motion
from lacet.identify.effects.base import SensorFault
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import Sensitivity, residual
from lacet.identify.regression.sensor_offsets import zeros_of
from lacet.identify.regression.wls import FitOptions, fit
from lacet.identify.signals.noise_draws import draw_noise
from lacet.identify.signals.reconstruct import Signals
from tests.identify import cars, exact_car
from tests.identify.cars import RATE

VEHICLE, RIG = cars.reference_car()
SIZE = {"kg": 25.0, "kg·m": 2.0, "kg·m²": 1.0, "N/m": 25000.0, "N·s/m": 1700.0, "N": 3000.0}


@pytest.fixture(scope="module")
def seen() -> tuple[PreparedRun, Sensitivity, tuple, Array]:
    """A drive with smooth signals, a plausible model and its sensitivity."""
    curves = cars.drive_curves(np.random.default_rng(8), (0.15, 2.5))
    curves |= {name: cars.MultiSine(np.random.default_rng(9), 3, 500.0, (0.0, 0.0, 3000.0)) for name in cars.LOADS}
    t = np.arange(round(10.0 * RATE)) / RATE
    signals = Signals.differentiated({name: curve.at(t) for name, curve in curves.items()}, RATE)
    effects = tuple(base_model(VEHICLE, "hub"))
    theta = np.array([205000.0 if p.name.endswith("kt") else SIZE[p.unit] for e in effects for p in e.parameters])
    theta[9] = 1270.0
    drive = PreparedRun(cars.recording(signals, VEHICLE, RIG))
    return drive, Sensitivity.of(drive.recording, effects, theta), effects, theta


def change(drive: PreparedRun, effects: tuple, theta: Array, moved: dict[str, Array]) -> dict[str, Array]:
    """By brute force: channels moved, differentiated, the motion built anew; central difference of the residual."""
    values = drive.recording.signals.value
    out: dict[str, Array] = {}
    for sign in (1.0, -1.0):
        changed = {**values, **{name: values[name] + sign * part for name, part in moved.items()}}
        record = drive.recording.with_signals(Signals.differentiated(changed, drive.recording.filters.rate))
        for row, series in drive.decimated(residual(PreparedRun(record).motion, effects, theta)).items():
            out[row] = out.get(row, 0.0) + 0.5 * sign * series
    return out


def compare(drive: PreparedRun, found: dict[str, Array], brute: dict[str, Array], tolerance: float, what: str) -> None:
    """Rows that answer, by the size of the answer; rows that do not, by that of the strongest row."""
    found = drive.decimated(found)
    strongest = max(np.sqrt(np.mean(series**2)) for series in brute.values())
    assert strongest > 0, what
    for row, series in brute.items():
        size = np.sqrt(np.mean(series**2))
        left = found.get(row, np.zeros_like(series)) - series
        off = np.sqrt(np.mean(left**2))
        assert off <= tolerance * size + 1e-6 * strongest, f"{what} {row}: off {off:.3g} of {size:.3g}"


@pytest.mark.parametrize("channel", sorted(c for c in CHANNELS if CHANNELS[c].corner == "fr"))
def test_one_corners_channels_move_that_corner_alone(seen, channel: str) -> None:
    """A motion that takes its other corners from an unmoved one is the motion built anew, to the last bit."""
    drive, _, effects, theta = seen
    signals = drive.recording.signals
    if channel not in signals.value:
        pytest.skip("not an instrument of this rig")
    moved = {channel: 1.01 * signals.value[channel] + 1e-3}
    record = drive.recording.with_signals(signals.changed(moved, drive.recording.filters.rate))
    anew = residual(build_motion(record), effects, theta)
    shared = residual(build_motion(record, drive.motion, ["fr"]), effects, theta)
    same = all(np.array_equal(anew[row], shared[row]) for row in anew)
    assert same is (CHANNELS[channel].family != "laser.ground")


def test_fewer_copies_at_once_give_the_same_slopes(seen, monkeypatch: pytest.MonkeyPatch) -> None:
    """Long runs go through in more passes: the slopes are the same to the last bit."""
    drive, sensitivity, effects, theta = seen
    monkeypatch.setattr(lacet.identify.regression.sensitivity, "_SAMPLES", 1000)
    again = Sensitivity.of(drive.recording, effects, theta)
    assert list(again.slopes) == list(sensitivity.slopes)
    for key, rows in sensitivity.slopes.items():
        for row, slope in rows.items():
            np.testing.assert_array_equal(again.slopes[key][row], slope)


def test_zeros(seen) -> None:
    """A constant on each component of each channel, as large as the sheet's tolerance."""
    drive, sensitivity, effects, theta = seen
    zeros = zeros_of(drive, sensitivity)
    assert len(zeros.names) > 30
    for i, name in enumerate(zeros.names):
        channel, k = _component(name)
        moved = np.zeros_like(drive.recording.signals.value[channel])
        moved[k] = zeros.sigma[i]
        assert zeros.sigma[i] == RIG.tolerance(channel, "zero")
        brute = change(drive, effects, theta, {channel: moved})
        compare(drive, sensitivity.response({channel: moved}), brute, 0.04, name)
        n = drive.recording.t.size
        one = {row: np.broadcast_to(series, n) * zeros.sigma[i] for row, series in sensitivity.zero(channel, k).items()}
        compare(drive, one, brute, 0.04, name)
        for row in drive.rows:
            expected = drive.decimated({row: np.broadcast_to(one.get(row, np.zeros(n)), n)})[row]
            np.testing.assert_allclose(zeros.columns[row][:, i] * zeros.sigma[i], expected, atol=1e-7)


def _component(column: str) -> tuple[str, int]:
    from lacet.daq.channels import COLUMNS

    channel, k = COLUMNS[column]
    return channel.name, k


def test_no_channel_without_an_answer_is_missed(seen) -> None:
    """What the sensitivity leaves out has none: angle of the wheel, speed, and attitude on a measured road."""
    drive, sensitivity, effects, theta = seen
    heard = {name for name, _, _ in sensitivity.slopes}
    for name, array in drive.recording.signals.value.items():
        if name not in heard:
            brute = change(drive, effects, theta, {name: 0.01 * np.ones_like(array)})
            assert all(np.max(np.abs(series)) < 1e-6 for series in brute.values()), name
    assert {"imu.accel", "imu.rate", "laser.fl.hub", "camera.rr.camber", "wheel.rl.force"} <= heard
    assert "correvit.speed" not in heard


@pytest.mark.parametrize("key", [key for key, e in catalogue(VEHICLE, "hub").items() if isinstance(e, SensorFault)])
def test_faults(seen, key: str) -> None:
    """Every sensor fault of the catalogue: its column is the change of the residual per unit, for a small fault."""
    drive, sensitivity, effects, theta = seen
    fault = catalogue(VEHICLE, "hub")[key]
    assert isinstance(fault, SensorFault)
    values, rate = drive.recording.signals.value, drive.recording.filters.rate
    p = {"latency": 1e-3, "gain": 2e-3}.get(fault.tolerance, 1e-3)
    record = drive.recording
    moved = {name: p * a for name, a in fault.changes(record).items()}
    column = {row: p * series for row, series in sensitivity.fault(fault).items()}
    heard = {name for name, _, _ in sensitivity.slopes}
    if not set(moved) & heard:
        assert not column
        return
    compare(drive, column, change(drive, effects, theta, moved), 0.04, key)
    # And the correction undoes the fault, to first order.
    moved = {name: p * fault.perturb(name, record) for name in fault.channels() if name in values}
    faulty = {name: values[name] + part for name, part in moved.items()}
    wrong = record.with_signals(record.signals.changed(faulty, rate))
    for name, part in moved.items():
        undone = fault.correct(name, wrong, p)
        inner = slice(50, -50)
        assert np.max(np.abs(undone - values[name])[:, inner]) < 0.1 * np.max(np.abs(part[:, inner]))


def test_noise(seen) -> None:
    """One draw of the sheet's noise on all channels together, as the noise floor draws it."""
    drive, sensitivity, effects, theta = seen
    drawn = draw_noise(drive.recording, {name: None for name, _, _ in sensitivity.slopes}, np.random.default_rng(5))
    compare(drive, sensitivity.response(drawn), change(drive, effects, theta, drawn), 0.03, "noise")
    again = sensitivity.noise(np.random.default_rng(5))
    for row, series in sensitivity.response(drawn).items():
        np.testing.assert_array_equal(again[row], series)


def test_draws_made_together_are_those_made_one_after_the_other(seen, monkeypatch: pytest.MonkeyPatch) -> None:
    """Seven draws, three and three and one at a time."""
    drive, sensitivity, _, _ = seen
    monkeypatch.setattr("lacet.identify.regression.sensitivity._DRAWN", 3 * drive.recording.t.size + 1)
    together = list(sensitivity.noises(np.random.default_rng(5), 7))
    rng = np.random.default_rng(5)
    single = [sensitivity.noise(rng) for _ in range(7)]
    assert [len(part["chassis.fz"]) for part in together] == [3, 3, 1]
    for row, series in single[0].items():
        size = np.max(np.abs(series))
        every = np.concatenate([part[row] for part in together])
        np.testing.assert_allclose(every, np.stack([one[row] for one in single]), rtol=0.0, atol=1e-12 * size)


def test_noise_has_the_sheets_spectrum() -> None:
    """White noise of σ at the channel's own rate, seen below the pre-filter's cut-off: the same density on the grid."""
    from dataclasses import replace

    from scipy.signal import welch

    from lacet.identify.signals.filters import Filters

    record = cars.recording(cars.random_signals(1, 4000), VEHICLE, RIG)
    record = replace(record, filters=Filters(), rates={**record.rates, "imu.accel": 200.0, "camera.fl.steer": 100.0})
    rng = np.random.default_rng(0)
    for channel, rate in (("imu.accel", 200.0), ("camera.fl.steer", 100.0)):
        drawn = np.concatenate([draw_noise(record, [channel], rng)[channel].ravel() for _ in range(20)])
        f, density = welch(drawn, RATE, nperseg=round(4.0 * RATE))
        expected = 2.0 * RIG.noise(channel) ** 2 / rate
        assert np.mean(density[(f > 1) & (f < 10)]) == pytest.approx(expected, rel=0.05)
        assert np.mean(density[f > 60]) < 1e-3 * expected


def test_a_fits_sensitivities_are_those_of_what_it_found_at_last() -> None:
    """A laser two millimetres off spoils what is found before zeros; the noise floor must not keep that stiffness."""
    record = exact_car.exact()
    off = {"laser.rl.ground": 0.002, "laser.fr.ground": -0.002}
    moved = {name: record.signals.value[name] + size for name, size in off.items()}
    record = record.with_signals(record.signals.changed(moved, record.filters.rate))
    fitted = fit(exact_car.MODEL, [PreparedRun(record)], FitOptions(unbias=False))
    mine = fitted.sensitivities[0].slopes
    right = Sensitivity.of(record, fitted.model.physics, fitted.physics).slopes
    before = fit(exact_car.MODEL, [PreparedRun(record)], FitOptions(zeros=False, unbias=False))
    for corner in ("rl", "fr"):
        key, row = (f"laser.{corner}.ground", 0, 0), f"tyre.{corner}"
        found, kt = float(np.mean(right[key][row])), f"tyre_stiffness.{corner}.kt"
        assert abs(before.value(kt) / fitted.value(kt) - 1.0) > 0.03
        assert float(np.mean(mine[key][row])) == pytest.approx(found, rel=0.01)
