"""Where a model fails: phases, states, bands, surfaces, coherence, and how much is left to explain."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import astuple, replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import lfilter

from lacet.daq.set_aside import DiskSpace, JoinedOnDisk
from lacet.identify.car.manoeuvre_phases import PHASES, SHORTEST, phases_of
from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.signals.filters import zero_phase_of
from lacet.identify.signals.reconstruct import Recording, Signals
from lacet.identify.validation.blocks import block_numbers
from lacet.identify.validation.explainable_residual import explainable_residual
from lacet.identify.validation.noise_floor import NoiseFloor, RunDraws, floor_of
from lacet.identify.validation.projected_noise import Draws, refitted_draws
from lacet.identify.validation.residual_map import conditional_mean, followed_states
from lacet.identify.validation.residual_samples import Samples
from lacet.identify.validation.restoring_force import restoring_surfaces, surface
from lacet.identify.validation.smooth_regressors import ColumnMaker
from lacet.identify.validation.spectra import _level, _segments, row_spectrum
from lacet.identify.validation.states import BLUR, ClearStates, states_of
from lacet.services.render.rows import explainable

DRAWS = 39


@pytest.fixture(scope="module")
def base(drives: dict[str, PreparedRun], models: dict[str, Model]) -> Fit:
    """Both bars missing."""
    return fit(models["base"], list(drives.values()))


@pytest.fixture(scope="module")
def floor(fitted: Fit) -> NoiseFloor:
    """The floor of the complete model."""
    return floor_of(fitted, DRAWS)


@pytest.fixture(scope="module")
def clear(fitted: Fit) -> ClearStates:
    """Its states; those of the base model are the same."""
    return ClearStates(fitted.runs)


@pytest.fixture(scope="module")
def draws(fitted: Fit, floor: NoiseFloor) -> Draws:
    """The floor's draws after the fit."""
    return refitted_draws(fitted, floor)


def test_phases_are_those_that_were_driven(drives: dict[str, PreparedRun]):
    found = {name: phases_of(drive.outline) for name, drive in drives.items()}
    for name, split in found.items():
        intervals = split.intervals
        assert intervals[0].start == split.t[0]
        assert intervals[-1].stop == split.t[-1]
        assert all(a.stop == b.start and a.phase != b.phase for a, b in pairwise(intervals))
        assert min(i.stop - i.start for i in intervals) >= SHORTEST - 0.01, name
        assert not split.unseen
    assert {"cornering left", "cornering right"} <= set(found["sine"].present)
    assert any(phase.startswith("lift-off") for phase in found["liftoff"].present)
    rough = found["rough"].number == PHASES.index("rough road")
    assert np.mean(rough) > 0.7
    assert not any("rough road" in found[name].present for name in ("sine", "liftoff"))


def test_potentiometers_on_dampers_and_a_steering_wheel_show_phases_as_lasers_and_cameras_do(
    drives: dict[str, PreparedRun],
):
    for drive in drives.values():
        run = drive.outline
        others = {f"damper.{c}.travel" for c in run.corners} | {"steering.angle"}
        plain = frozenset(n for n in run.channels if not n.startswith(("laser.", "camera.")))
        assert np.array_equal(phases_of(replace(run, channels=plain | others)).number, phases_of(run).number)
        assert {"travel", "steer"} <= set(phases_of(replace(run, channels=plain)).unseen)


def test_left_and_right_change_places_in_a_mirror(drives: dict[str, PreparedRun]):
    run = drives["sine"].outline
    turned = run.accel * np.array([[1.0], [-1.0], [1.0]])
    seen, mirrored = phases_of(run).number, phases_of(replace(run, accel=turned)).number
    left, right = PHASES.index("cornering left"), PHASES.index("cornering right")
    assert np.array_equal(seen == left, mirrored == right)
    assert np.array_equal(seen == right, mirrored == left)
    assert np.any(seen == left)


def test_what_is_not_measured_is_told(drives: dict[str, PreparedRun]):
    run = drives["sine"].outline
    split = phases_of(replace(run, channels=frozenset(), velocity=None))
    assert set(split.unseen) == {"accelerations", "steer", "travel", "speed"}
    assert split.present == ["straight, steady"]


def test_the_band_of_a_conditional_mean_holds_the_truth():
    """Residuals correlated over a second against a state as slow: 95 % bands hold the mean (naive ones 40 to 60 %)."""
    rng = np.random.default_rng(3)
    held, naive = [], []
    blocks = np.repeat(np.arange(40), 28)
    for _ in range(150):
        state, residual = lfilter([1.0], [1.0, -0.9], rng.standard_normal((2, 2 * blocks.size)), axis=1)[
            :, -blocks.size :
        ]
        c = conditional_mean(state, residual, blocks, bins=8)
        held.append(np.abs(c.mean) <= 0.5 * (c.high - c.low))
        naive.append(np.abs(c.mean) <= 1.96 * residual.std() / np.sqrt(c.count))
    assert np.mean(naive) < 0.7
    assert 0.91 <= np.mean(held) <= 0.985


def test_too_few_blocks_give_no_band():
    rng = np.random.default_rng(0)
    c = conditional_mean(rng.standard_normal(100), rng.standard_normal(100), np.repeat([0, 1], 50))
    assert np.all(np.isnan(c.low))
    assert np.all(np.isfinite(c.mean))


def test_a_surface_is_the_force_it_was_made_of():
    rng = np.random.default_rng(1)
    travel, rate = rng.uniform(-0.02, 0.02, 20000), rng.uniform(-0.1, 0.1, 20000)
    force = 20e3 * travel + 1500.0 * rate
    blocks = np.arange(20000) // 100
    s = surface("fl", travel, rate, 0.1 * force, force, blocks)
    x, y = (0.5 * (e[:-1] + e[1:]) for e in (s.travel, s.rate))
    assert np.max(np.abs(s.force - (20e3 * x[None] + 1500.0 * y[:, None]))) < 15.0
    assert s.count.sum() == pytest.approx(20000, rel=0.03)
    few = surface("fl", travel[:60], rate[:60], force[:60], force[:60], blocks[:60])
    assert np.isnan(few.force).sum() > 80


def test_the_total_force_is_model_and_residual(base: Fit, fitted: Fit):
    """The same force whatever the model: what one model lacks in its force it has in its residual."""
    less, more = restoring_surfaces(base)["fl"], restoring_surfaces(fitted)["fl"]
    seen = np.isfinite(less.force)
    assert np.array_equal(seen, np.isfinite(more.force))
    assert np.max(np.abs(less.force - more.force)[seen]) < 0.05 * np.ptp(more.force[seen])
    assert less.scatter > 5.0 * more.scatter


def test_rows_with_the_same_columns_are_predicted_as_one_by_one(
    drives: dict[str, PreparedRun], models: dict[str, Model]
):
    """Of a corner's rows those with other samples than the rest have columns of their own. Draws may be in pieces."""
    fitted = fit(models["bars"], [drives["sine"]], FitOptions(unbias=False))
    floor, clear = floor_of(fitted, 19), ClearStates(fitted.runs)
    draws = refitted_draws(fitted, floor)
    first, second = Row.parse("suspension.fl"), Row.parse("tyre.fl")
    run = fitted.runs[0]
    shorter = PreparedRun(run.recording, index={**run.index, second: run.index[second][5:]})
    for drive, same in ((run, True), (shorter, False)):
        maker = ColumnMaker(ClearStates([drive]))
        assert (maker.group(first, ("travel",)) == maker.group(second, ("travel",))) == same
    together = explainable_residual(fitted, floor, clear, draws)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ColumnMaker, "group", lambda self, row, names: row)
        alone = explainable_residual(fitted, floor, clear, draws)
    assert list(together) == [row for row in fitted.rows if row in alone]
    samples = Samples.of(fitted, draws, [first], ColumnMaker(clear).columns(first, clear.names(first)))
    np.testing.assert_array_equal(np.concatenate([s.blocks for s in samples]), samples.numbers)
    assert np.all(np.diff(samples.numbers) >= 0)
    for run, part in zip(fitted.runs, floor.draws, strict=True):
        if first in run.index:
            np.testing.assert_array_equal(np.concatenate(list(part.some_at_once(first, 7))), part.whole(first))
    space, ends = DiskSpace(), (slice(150), slice(150, None))
    parted = explainable_residual(fitted, floor, clear, tuple(
        JoinedOnDisk([space.put({row: drawn[row][:, part] for row in drawn}) for part in ends])
        for drawn in draws
    ))  # fmt: skip
    for row, (_, unit, *numbers) in ((row, astuple(one)) for row, one in together.items()):
        assert unit == row.unit
        for other in (alone, parted):
            np.testing.assert_allclose(numbers, astuple(other[row])[2:], rtol=1e-7, atol=1e-9, err_msg=str(row))


def test_a_fit_takes_away_what_its_parameters_can(fitted: Fit, floor: NoiseFloor):
    """W x added to noise, x as large as its 1 σ, hardly changes what the same fit leaves of it: the priors' share."""
    rng = np.random.default_rng(4)
    x = rng.standard_normal((fitted.place.size, 1)) * np.sqrt(np.diag(fitted.covariance))[fitted.place][:, None]
    moved = []
    for drive, part in zip(fitted.runs, floor.draws, strict=True):
        added = {row: (drive.matrix(fitted.model.physics, row)[:, fitted.place] @ x).T for row in part.rows}
        moved.append(RunDraws.of({row: series + added[row] for row, series in part.series.items()}))
    plain = refitted_draws(fitted, floor, sheet=False)
    after = refitted_draws(fitted, replace(floor, draws=tuple(moved)), sheet=False)
    for one, other, part in zip(plain, after, floor.draws, strict=True):
        for row in one:
            size = float(np.sqrt(np.mean(part.series[row] ** 2)))
            assert np.max(np.abs(one[row] - other[row])) < 0.15 * size, row
    # Fewer squares are left, never more.
    weighted = [
        sum(float(np.sum((part[row] / fitted.sigma[row]) ** 2)) for part in parts for row in part)
        for parts in (plain, [part.series for part in floor.draws])
    ]
    assert 0.9 * weighted[1] < weighted[0] < weighted[1]


def test_states_are_blurred_by_their_own_noise(fitted: Fit, clear: ClearStates):
    drive, row = fitted.runs[0], Row.parse("suspension.fl")
    names = clear.names(row)
    assert {"travel", "travel rate", "travel difference across the axle", "lateral acceleration"} <= set(names)
    assert "vertical wheel load" not in names  # the row's left side is made of it
    plain, blurred = states_of(drive.motion, row)["travel"], clear.blurred(0, row, "travel")
    moved = zero_phase_of(blurred.series - plain.series, drive.recording.filters)
    rig = drive.recording.rig
    rate = drive.recording.rates["laser.fl.hub"]
    expected = BLUR * rig.noise("laser.fl.hub") * np.sqrt(drive.recording.filters.fit_cutoff / (0.5 * rate))
    assert np.std(moved) == pytest.approx(expected, rel=0.2)
    through = drive.decimated({row: np.stack([clear.blurred(0, row, name).series for name in names])})[row]
    np.testing.assert_allclose(clear.filtered(0, row, names), through, rtol=1e-9, atol=1e-12)


def test_missing_bars_are_left_to_explain(base: Fit, clear: ClearStates):
    floor = floor_of(base, DRAWS)
    draws = refitted_draws(base, floor)
    left = explainable_residual(base, floor, clear, draws)
    for row, one in left.items():
        if row.startswith("suspension"):
            assert one.something, row
            assert one.of_excess > 0.95
            assert not one.depends_on_history
            assert f"{one.part_rms:.3g} N" in explainable(one)
        else:
            assert not one.something, row
    follows = followed_states(base, floor, [Row.parse("suspension.fl"), Row.parse("chassis.fz")], clear, draws)
    assert follows["suspension.fl"][0].state in ("travel difference across the axle", "roll angle")
    assert follows["suspension.fl"][0].part > 0.9
    assert follows["chassis.fz"][0].p > 0.05


def test_nothing_is_left_in_a_complete_model(fitted: Fit, floor: NoiseFloor, clear: ClearStates, draws: Draws):
    left = explainable_residual(fitted, floor, clear, draws)
    assert set(left) == set(fitted.rows)
    for row, one in left.items():
        assert not one.something, row
        assert not one.depends_on_history, row
        assert one.part < 0.1, row
        assert "nothing left to find" in explainable(one)


def test_a_hidden_mass_shows_as_history(fitted: Fit, floor: NoiseFloor, clear: ClearStates, draws: Draws):
    """A mass on a mount of 1.3 Hz pushes on the body: not on the resonators' grid, and no state shows it."""
    residual = []
    for drive, part in zip(fitted.runs, fitted.residual, strict=True):
        force = _mounted_mass(drive.motion.body.accel[2] - 9.81, drive.recording.filters.rate)
        residual.append(
            {**part, "chassis.fz": part["chassis.fz"] + drive.decimated({"chassis.fz": force})["chassis.fz"]}
        )
    left = explainable_residual(replace(fitted, residual=tuple(residual)), floor, clear, draws)
    one = left["chassis.fz"]
    assert one.rms > 2.0 * one.floor
    assert one.depends_on_history
    assert "history" in explainable(one)
    assert one.of_excess + one.history_of_excess > 0.35  # a mass lightly damped rings longer than the resonators do
    assert not any(other.depends_on_history for row, other in left.items() if row != "chassis.fz")


def _mounted_mass(accel: Array, rate: float) -> Array:
    """Force of 60 kg on a mount of 1.3 Hz, 6 % damped, by its motion against the body (exact for held input)."""
    w, d = 2.0 * np.pi * 1.3, 0.06
    decay, turn = np.exp(-d * w / rate), w * np.sqrt(1.0 - d**2) / rate
    shift = lfilter([0.0, decay * np.sin(turn) / (w * rate)], [1.0, -2.0 * decay * np.cos(turn), decay**2], -accel)
    return 60.0 * w**2 * np.asarray(shift, float)


def test_coherence_has_its_level(base: Fit, fitted: Fit, floor: NoiseFloor, clear: ClearStates):
    rng = np.random.default_rng(5)
    peaks = []
    for _ in range(400):
        lines = _segments(rng.standard_normal((2, 500)), np.arange(500), 50, 0.08)
        cross = np.mean(np.conj(lines[:, 0]) * lines[:, 1], axis=0)
        power = np.mean(np.abs(lines) ** 2, axis=0)
        peaks.append(np.max(np.abs(cross[1:-1]) ** 2 / (power[0] * power[1])[1:-1]))
    count = 19
    effective = count**2 / (count + 2.0 * (count - 1) / 36.0)
    assert 0.01 <= np.mean(np.array(peaks) > _level(effective, 1, 24)) <= 0.1
    quiet = [
        row_spectrum(fitted, floor, row, clear) for row in map(Row.parse, ("chassis.fz", "tyre.fl", "suspension.fl"))
    ]
    assert sum(len(s.strongest) > 0 for s in quiet if s is not None) <= 1
    loud = row_spectrum(base, floor, Row.parse("suspension.fl"), clear)
    assert loud is not None
    assert loud.strongest
    assert np.median(loud.residual / loud.floor) > 5.0


def test_blocks_do_not_reach_over_runs(drives: dict[str, PreparedRun]):
    both = [drives["sine"], drives["rough"]]
    blocks = block_numbers(both, Row.parse("chassis.fx"))
    n = len(both[0].index["chassis.fx"])
    assert blocks[n - 1] < blocks[n]
    assert np.all(np.diff(blocks) >= 0)


def test_a_state_at_rest_in_one_piece_of_a_run_is_one_of_the_run(
    drives: dict[str, PreparedRun], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A car may stand, or drive straight on, for the first minute."""
    recording = next(iter(drives.values())).recording
    third = recording.t.size // 3
    still = {name: values.copy() for name, values in recording.signals.value.items()}
    for corner in ("fl", "fr"):
        still[f"camera.{corner}.steer"][..., :third] = 0.0
    monkeypatch.setattr("lacet.identify.validation.states.draw_noise", _no_noise)
    signals = Signals.differentiated(still, recording.filters.rate)
    found = {}
    for piece in (1e3, recording.t[-1] / 3.0):
        monkeypatch.setattr("lacet.identify.regression.prepared_run.PIECE", piece)
        run = PreparedRun(recording.with_signals(signals))
        found[run.piece_count] = ClearStates([run]).names(Row.parse("suspension.fl"))
    whole, pieces = found.values()
    assert max(found) == 3
    assert "steer" in whole
    assert pieces == whole


def test_columns_of_a_run_in_pieces_are_those_of_the_whole(
    drives: dict[str, PreparedRun], monkeypatch: pytest.MonkeyPatch
) -> None:
    recording, row = drives["rough"].recording, Row.parse("suspension.fl")
    monkeypatch.setattr("lacet.identify.validation.states.draw_noise", _no_noise)
    found: dict[int, tuple[Array, Array]] = {}
    for piece in (1e3, recording.t[-1] / 3.0):
        monkeypatch.setattr("lacet.identify.regression.prepared_run.PIECE", piece)
        run = PreparedRun(recording)
        clear = ClearStates([run])
        columns = ColumnMaker(clear).columns(row, clear.names(row))
        every = np.concatenate(list(columns.stretches()))
        np.testing.assert_array_equal(columns.stretch(0, 5, 9, columns.lines), every[5:9, columns.lines])
        found[run.piece_count] = every, columns.of
    (whole, of), (pieces, of_pieces) = found.values()
    assert max(found) == 3
    assert whole.shape[1] > of.size  # the history is behind them
    np.testing.assert_array_equal(of, of_pieces)
    np.testing.assert_allclose(np.sqrt(np.mean(whole**2, axis=0)), 1.0, rtol=1e-9)
    np.testing.assert_allclose(pieces, whole, rtol=1e-9, atol=1e-9)


def _no_noise(recording: Recording, names: Iterable[str], rng: np.random.Generator) -> dict[str, Array]:
    return {name: np.zeros_like(recording.signals.value[name]) for name in names}
