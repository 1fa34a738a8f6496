"""Late instruments: what they do to the equations, and runs read again where that is no longer small."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from lacet.identify.effects.base import SensorFault
from lacet.identify.effects.sensors.sensor_latency import SensorLatency
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import Sensitivity
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.selection.partial_regression import PartialRegression
from lacet.identify.selection.relinearisation import relinearise, relinearised_tests, remaining_latencies
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION
from lacet.identify.signals.filters import derivative
from lacet.identify.signals.time_base import base_channel, late
from lacet.identify.validation.noise_floor import NoiseFloor, floor_of
from lacet.services.render.progress import in_words
from lacet.services.render.verdicts import says
from tests.identify.cars import RATE
from tests.identify.exact_car import KNOWN, MODEL, RIG, driven, exact, exact_with, fit_of, later, theta
from tests.identify.selection.exact_ranking import DRAWS

CLOCKS = [e for e in KNOWN.values() if isinstance(e, SensorLatency)]
TRIED = [KNOWN[key] for key in ("anti_roll_bar.front", "coulomb.rear", "tyre_damping.front", "engine_mount")]


@cache
def very_late(key: str, seconds: float) -> tuple[Linearisation, Linearisation]:
    """A run with one kind of instrument as late as that, as it was recorded and read again."""
    off = fit_of(later(key, seconds, 5))
    recorded = Linearisation.of(off, floor_of(off, DRAWS))
    return recorded, relinearise(recorded)


def test_all_instruments_late_are_the_same_motion_later():
    """Changes of all clocks add up to nothing; where the model is right the time base's column is what it is alone."""
    record = exact()
    drive, sensitivity = PreparedRun(record), Sensitivity.of(record, MODEL.physics, theta())
    base = KNOWN["sensor_latency.wheel"]
    assert isinstance(base, SensorLatency)
    assert base_channel(record.signals.value) in base.channels()
    gain_test = {name: base.perturb(name, record) for name in base.channels() if name in record.signals.value}
    by_itself = drive.decimated(sensitivity.response(gain_test))
    as_others = drive.decimated(sensitivity.fault(base))
    for row, series in by_itself.items():
        assert np.std(as_others[row] - series) < 0.01 * np.std(series), row
    total: dict[str, Array] = {}
    for sensor in RIG.sensors:
        for name, change in late(sensor.channels, record).items():
            total[name] = total.get(name, 0.0) + change
    for sensor in RIG.sensors:
        for name in record.signals.value.keys() & set(sensor.channels):
            rate = np.max(np.abs(derivative(record.signals.value[name], RATE)))
            assert np.max(np.abs(total.get(name, 0.0))) < 1e-9 * rate, name


def test_another_instrument_s_channels_are_moved_by_themselves():
    record = exact()
    moved = late(("imu.accel",), record)
    assert list(moved) == ["imu.accel"]
    np.testing.assert_array_equal(moved["imu.accel"], KNOWN["sensor_latency.imu"].perturb("imu.accel", record))  # type: ignore[attr-defined]


def test_small_latencies_are_left_to_their_columns(fitted: Fit, floor: NoiseFloor):
    recorded = Linearisation.of(fitted, floor)
    linearisation = relinearise(recorded)
    assert linearisation is recorded
    assert not linearisation.latencies


@pytest.mark.parametrize(
    ("key", "seconds"),
    [("sensor_latency.imu", 0.02), pytest.param("sensor_latency.laser", -0.025, marks=pytest.mark.slow)],
)
def test_a_late_instrument_is_named_with_its_latency(key: str, seconds: float):
    """Ten tolerances: no first-order column holds, and what one leaves looks like an engine on mounts."""
    recorded, linearisation = very_late(key, seconds)
    off, own = recorded.fitted, recorded.floor
    found = diagnose(off, own, [*TRIED, *CLOCKS])
    assert found.verdict == "missing", says(found)
    assert found.best is not None
    assert found.best.key == key
    assert found.best.values[0] == pytest.approx(seconds, abs=found.best.interval[0])
    assert found.best.gain > 0.3  # beside the rig file's clocks, not beside those moved by many tolerances
    # Read where the instruments are, the run is the model's again.
    assert len(linearisation.latencies) > 1
    assert len(linearisation.latencies) <= len(CLOCKS)
    left = max(ScoreTests.of(linearisation, TRIED, 0).residual_beside([]).ratios.values())
    assert left < 1.25
    assert max(ScoreTests.of(recorded, TRIED, 0).residual_beside([]).ratios.values()) > 1.5 * left


def test_late_instruments_are_taken_out_whatever_is_tried():
    recorded, linearisation = very_late("sensor_latency.imu", 0.02)
    for tried in ([], [*TRIED, *CLOCKS]):
        tests = relinearised_tests(ScoreTests.of(recorded, tried, 0), tried, 0)
        assert tests.linearisation.latencies == linearisation.latencies


def test_reading_ends(fitted: Fit, floor: NoiseFloor, monkeypatch: pytest.MonkeyPatch):
    """What never settles is read a few times only, and told."""
    said: list[str] = []
    monkeypatch.setattr(
        "lacet.identify.selection.relinearisation.remaining_latencies",
        lambda _, latencies: np.full(len(latencies), 5.0),
    )
    linearisation = relinearise(Linearisation.of(fitted, floor), in_words(said.append))
    assert len([line for line in said if "read again" in line]) == SELECTION.most_relinearisations
    assert all(abs(seconds) > 0.0 for seconds in linearisation.latencies.values())


def test_what_all_clocks_share_is_pulled_back_to_the_rig_file(fitted: Fit, floor: NoiseFloor):
    """Runs do not show it: clocks taken for half a tolerance late, all of them, are half a tolerance off."""
    recorded = Linearisation.of(fitted, floor)
    assert len(set(recorded.latency_tolerances.values())) == 1
    gain_test = np.full(len(recorded.latency_tolerances), 0.5)
    np.testing.assert_allclose(
        remaining_latencies(recorded, gain_test), remaining_latencies(recorded, 0.0 * gain_test) - gain_test, atol=1e-6
    )


@pytest.mark.parametrize("key", ["spring_cubic.front", pytest.param("coulomb.rear", marks=pytest.mark.slow)])
def test_clocks_that_do_the_work_of_a_missing_effect_are_left(key: str, fitted: Fit, monkeypatch: pytest.MonkeyPatch):
    """Beside a misfit of many floors they move far; with the effect beside them they do not, and runs stay as read."""
    bound = 0.1  # in runs of minutes the tolerances hold clocks less than in one of seconds
    monkeypatch.setattr(
        "lacet.identify.selection.relinearisation.SELECTION", replace(SELECTION, first_order_phase=bound)
    )
    off = fit_of(driven(exact_with(KNOWN[key], 0.9 * KNOWN[key].parameters[0].high), 4), fitted)
    own = floor_of(off, DRAWS)
    recorded = Linearisation.of(off, own)
    moved = remaining_latencies(recorded, np.zeros(len(recorded.latency_tolerances))) * np.array(
        list(recorded.latency_tolerances.values())
    )
    assert np.max(np.abs(recorded.omega * moved)) > bound
    said: list[str] = []
    found = diagnose(
        off, own, [KNOWN[key], *(e for e in (*TRIED, *CLOCKS) if e.key != key)], progress=in_words(said.append)
    )
    assert not [line for line in said if "read again" in line]
    assert found.best is not None
    assert found.best.key == key


def test_noise_in_the_columns_does_not_move_the_sheet(fitted: Fit, floor: NoiseFloor):
    """The wheels' scales in runs with no tolerance drawn: noise in columns and residual alike is no scale."""
    with_noise, plain, noise = [], [], None
    for seed in range(6):
        space = ScoreTests.of(
            Linearisation.of(fit_of(driven(exact(), 50 + seed, 1.0), fitted), floor), TRIED[:1], 0, noise
        )
        noise, known = space.noise, space.regression
        model = space.layout.model
        scales = [
            known.nuisance.tolist().index(model + i)
            for i, entry in enumerate(space.layout.sheet)
            if entry[0] == "gain" and entry[1].endswith(".force") and entry[2] == 2
        ]
        assert len(scales) == 4
        with_noise.append(PartialRegression(space.sums, known.nuisance, known.prior).gain[scales, -1])
        plain.append(known.gain[scales, -1])
    biased, sound = np.mean(with_noise, axis=1), np.mean(plain, axis=1)
    assert np.mean(biased) > 3.0 * np.std(biased) / np.sqrt(len(biased))
    assert abs(np.mean(sound)) < 0.5 * np.mean(biased)
    assert abs(np.mean(sound)) < 3.0 * np.std(sound) / np.sqrt(len(sound))


def test_clocks_are_told_from_the_rig_file():
    """However far the runs were read away from it."""
    fault = KNOWN["sensor_latency.imu"]
    assert isinstance(fault, SensorFault)
    space = ScoreTests.of(very_late("sensor_latency.imu", 0.02)[1], TRIED[:1], 0)
    assert space.linearisation.latencies
    said = {name: size for name, size in space.tolerance_use().sizes.items() if name.startswith("latency")}
    imu = next(size for name, size in said.items() if name == f"latency of {RIG.sensor_of('imu.accel').name}")
    others = np.mean([size for size in said.values() if size != imu])
    assert (imu - others) * RIG.tolerance("imu.accel", "latency") == pytest.approx(0.02, abs=0.003)
