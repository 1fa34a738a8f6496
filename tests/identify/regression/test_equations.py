"""Accumulated factors against the equations themselves: chunks, merged runs, zeros, robust weights, bootstrap."""

from __future__ import annotations

import tracemalloc
import weakref
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lacet.daq.formats.open_run import open_run
from lacet.daq.run import Run, Signal
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.regression.assembly import Assembly, Piece
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.qr_accumulation import Equations, RunEquations, narrow_triangle, triangle
from lacet.identify.regression.wls import Fit, FitOptions, fit
from tests.identify import cars

VEHICLE, RIG = cars.reference_car()
SIGMA = {"a": 2.0, "b": 0.5}


def equations(rng: np.random.Generator, z: int, p: int, cuts: tuple[int, ...]) -> tuple[RunEquations, dict]:
    """A random run accumulated in chunks, and its samples by row."""
    run = RunEquations(tuple(f"z{k}" for k in range(z)), rng.uniform(0.5, 2.0, z))
    samples = {row: (rng.standard_normal((40, z + p)), rng.standard_normal(40)) for row in SIGMA}
    for row, (W, y) in samples.items():
        for block, right in zip(np.split(W, cuts), np.split(y, cuts), strict=True):
            run.add(row, block, right)
    return run, samples


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 10_000), cuts=st.lists(st.integers(1, 39), max_size=4, unique=True), z=st.integers(0, 3))
def test_chunks_and_merged_runs_are_the_one_big_problem(seed: int, cuts: list[int], z: int) -> None:
    """Parameters, zeros and their covariance are those of all samples stacked with all priors."""
    rng = np.random.default_rng(seed)
    p = 4
    runs, samples = zip(*(equations(rng, z, p, tuple(sorted(cuts))) for _ in range(3)), strict=True)
    known = np.diag(rng.uniform(0.1, 1.0, p))
    merged = Equations(runs, known, tuple(SIGMA))
    big, right = [np.concatenate([np.zeros((p, 3 * z)), known], axis=1)], [np.zeros(p)]
    for r, (run, rows) in enumerate(zip(runs, samples, strict=True)):
        own = slice(r * z, (r + 1) * z)
        prior = np.zeros((z, 3 * z + p))
        prior[:, own] = np.diag(1.0 / run.priors)
        big.append(prior)
        right.append(np.zeros(z))
        for row, (W, y) in rows.items():
            wide = np.zeros((len(y), 3 * z + p))
            wide[:, own], wide[:, 3 * z :] = W[:, :z], W[:, z:]
            big.append(wide / SIGMA[row])
            right.append(y / SIGMA[row])
    A, b = np.concatenate(big), np.concatenate(right)
    whole = np.linalg.lstsq(A, b, rcond=None)[0]
    x = merged.solve(SIGMA)
    np.testing.assert_allclose(x, whole[3 * z :], rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(np.concatenate(merged.zeros(x, SIGMA)), whole[: 3 * z], rtol=1e-8, atol=1e-9)
    root = merged.root(SIGMA)
    np.testing.assert_allclose(root[:, :p].T @ root[:, :p], np.linalg.inv(np.linalg.inv(A.T @ A)[3 * z :, 3 * z :]))
    assert root[p, p] ** 2 == pytest.approx(np.sum((A @ whole - b) ** 2))


def test_an_exact_row_does_not_drown_one_that_alone_sees_the_rest() -> None:
    """Squares of weights 10⁹ apart are beyond double precision: what the noisy row says would be lost."""
    rng = np.random.default_rng(3)
    true, z = np.array([1.0, -2.0, 3.0, 0.5]), 1
    exact = rng.standard_normal((400, 2)) @ rng.standard_normal((2, 4))
    noisy = rng.standard_normal((400, 4))
    run = RunEquations(("z0",), np.ones(z))
    run.add("a", np.concatenate([np.zeros((400, z)), exact], axis=1), exact @ true)
    run.add("b", np.concatenate([np.ones((400, z)), noisy], axis=1), noisy @ true + 0.3 + rng.standard_normal(400))
    known = 1e-6 * np.eye(4)
    x, sigma = Equations([run], known, ("a", "b")).iterate({"a": 1.0, "b": 1.0}, {"a": 1e-10, "b": 1e-10})
    assert sigma["b"] == pytest.approx(1.0, rel=0.1)
    np.testing.assert_allclose(exact @ x, exact @ true, atol=1e-6)
    assert np.max(np.abs(x - true)) < 0.3


def test_weights_come_to_the_fixed_point() -> None:
    """Each row's σ is the RMS of its own residual at the solution that those σ give."""
    rng = np.random.default_rng(3)
    run, samples = equations(rng, 2, 3, (11, 30))
    merged = Equations([run], 1e-3 * np.eye(3), tuple(SIGMA))
    x, sigma = merged.iterate({"a": 1.0, "b": 1.0}, {"a": 1e-9, "b": 1e-9})
    zeros = merged.zeros(x, sigma)[0]
    for row, (W, y) in samples.items():
        assert sigma[row] == pytest.approx(np.sqrt(np.mean((y - W @ np.append(zeros, x)) ** 2)), rel=1e-3)


def test_factors_keep_the_normal_matrix() -> None:
    """RᵀR = WᵀW, also with empty columns and with fewer rows than columns."""
    rng = np.random.default_rng(1)
    W = rng.standard_normal((50, 7))
    W[:, 2] = 0.0
    for R in (triangle(W), narrow_triangle(W), triangle(W[:10], W[10:]), triangle(W[:3])):
        kept = W if R.shape[0] != 7 or np.any(R[3:]) else W[:3]
        np.testing.assert_allclose(R.T @ R, kept.T @ kept, atol=1e-12)


def part(run: Run, seconds: float) -> Run:
    """The first seconds of a run."""
    short = {name: s.t - s.t[0] < seconds for name, s in run.signals.items()}
    signals = {n: Signal(s.t[short[n]], s.values[short[n]], s.flags[short[n]]) for n, s in run.signals.items()}
    return replace(run, signals=signals)


@pytest.fixture(scope="module")
def rough() -> Run:
    """14 s of the rough run."""
    return part(open_run(cars.CAR / "rough.parquet"), 14.0)


@pytest.fixture(scope="module")
def model() -> Model:
    """The model the car needs."""
    known = catalogue(VEHICLE, "hub")
    return Model.of([*base_model(VEHICLE, "hub"), known["anti_roll_bar.front"], known["anti_roll_bar.rear"]])


@pytest.fixture(scope="module")
def whole(rough: Run, model: Model) -> Fit:
    """Its fit in one piece."""
    return fit(model, [PreparedRun.of(rough, VEHICLE, RIG)])


def test_a_run_in_pieces_is_the_run(rough: Run, whole: Fit, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pieces keep every sample once, and their fit is that of the whole run to a part of its interval."""
    monkeypatch.setattr("lacet.identify.regression.prepared_run.PIECE", 5.0)
    drive = PreparedRun.of(rough, VEHICLE, RIG)
    assert len(list(drive.pieces())) == 3
    parts = fit(whole.model, [drive])
    for row, residual in whole.residual[0].items():
        assert parts.residual[0][row].shape == residual.shape
    apart = np.abs(parts.theta - whole.theta)[whole.place]
    sigma = np.sqrt(np.diag(whole.covariance))[whole.place]
    assert np.median(apart / sigma) < 0.15  # noise draws of the bias correction differ
    assert np.max(apart / sigma) < 0.7
    for name in ("covariance", "covariance_sheet"):
        one, other = (np.sqrt(np.diag(getattr(f, name)))[whole.place] for f in (parts, whole))
        assert np.median(np.abs(one / other - 1.0)) < 0.1


def test_pieces_give_the_same_equations(rough: Run, whole: Fit, model: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without noise correction and zeros, pieces differ from the whole by filter transients alone."""
    together = fit(model, [whole.runs[0]], FitOptions(zeros=False, unbias=False))
    monkeypatch.setattr("lacet.identify.regression.prepared_run.PIECE", 5.0)
    apart = fit(model, [PreparedRun.of(rough, VEHICLE, RIG)], FitOptions(zeros=False, unbias=False))
    sigma = np.sqrt(np.diag(together.covariance))[together.place]
    assert np.max(np.abs(apart.solution - together.solution) / sigma) < 1e-3


def repeated(run: Run, times: int) -> Run:
    """A run driven again and again."""
    signals = {}
    for name, signal in run.signals.items():
        span = signal.t[-1] - signal.t[0] + np.median(np.diff(signal.t))
        t = np.concatenate([signal.t + k * span for k in range(times)])
        signals[name] = Signal(t, np.tile(signal.values, (times, 1)), np.tile(signal.flags, times))
    return replace(run, signals=signals)


def test_memory_does_not_grow_with_the_length(rough: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run three times as long needs little more than its own channels beside what the short one needs.

    Pieces are kept up to a bound, which is lowered here below both runs.
    """
    monkeypatch.setattr("lacet.identify.regression.assembly.KEPT", 10.0)
    monkeypatch.setattr("lacet.identify.regression.prepared_run.PIECE", 6.0)
    springs = Model.of(effect for effect in base_model(VEHICLE, "hub") if effect.name != "body")
    peaks, channels = [], []
    for times in (2, 6):
        drive = PreparedRun.of(repeated(part(rough, 10.0), times), VEHICLE, RIG)
        parts = (drive.recording.signals.value, drive.recording.signals.rate, drive.recording.signals.accel)
        channels.append(sum(a.nbytes for part in parts for a in part.values()))
        tracemalloc.start()
        fit(springs, [drive], FitOptions(zeros=False, unbias=False))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] - peaks[0] < 0.5 * (channels[1] - channels[0]), (peaks, channels)


def test_a_piece_keeps_nothing_that_was_computed_on_it(
    rough: Run, model: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Read again, a piece has its equations, and no motion, columns, noise or slopes; whoever holds it still has his.

    Made anew or kept, so that a diagnosis of a long run never holds two pieces' motions.
    """
    monkeypatch.setattr("lacet.identify.regression.assembly.KEPT", 8.0)
    monkeypatch.setattr("lacet.identify.regression.prepared_run.PIECE", 5.0)
    assembly = fit(model, [PreparedRun.of(rough, VEHICLE, RIG)], FitOptions(unbias=False)).assembly
    held = list(assembly.pieces())
    for piece in held:
        piece.prepared.prepare(model.physics)
        piece.prepared.noisy_columns(model.physics, [1])
        assert piece.sensitivity is not None
        assert piece.sensitivity.slopes
    again = list(assembly.pieces())
    assert list(assembly._cache.parts) == [(0, 0)]
    assert "motion" not in vars(again[0].prepared)
    assert not again[0].prepared._columns
    assert not again[0].prepared._noisy
    assert again[0].sensitivity is not None
    assert "every" not in vars(again[0].sensitivity.taken)
    for one, piece in zip(again, held, strict=True):
        assert "motion" in vars(piece.prepared)
        for row, block in piece.blocks.items():
            np.testing.assert_array_equal(one.blocks[row], block)
            np.testing.assert_array_equal(one.prepared.index[row], piece.prepared.index[row])


def test_only_one_piece_is_whole_at_a_time(rough: Run, model: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    """A piece that is mapped to something small is gone before the next one is made."""
    monkeypatch.setattr("lacet.identify.regression.assembly.KEPT", 0.0)
    monkeypatch.setattr("lacet.identify.regression.prepared_run.PIECE", 5.0)
    assembly = fit(model, [PreparedRun.of(rough, VEHICLE, RIG)], FitOptions(unbias=False)).assembly
    made, alive = Assembly.made, []
    seen: list[weakref.ref[Piece]] = []

    def make(self: Assembly, *args) -> Piece:
        alive.append(sum(ref() is not None for ref in seen))
        return made(self, *args)

    monkeypatch.setattr(Assembly, "made", make)
    seen.extend(map(weakref.ref, assembly.pieces()))
    assert len(seen) == 3
    assert alive == [0, 0, 0]


def test_noise_is_that_of_its_seed_whoever_asked_before(rough: Run, model: Model) -> None:
    """A run fitted as the second of two has the digits by itself afterwards that it has on its own."""
    first, second = (PreparedRun.of(part(rough, seconds), VEHICLE, RIG) for seconds in (9.0, 8.0))
    fit(model, [first, second])
    again, alone = fit(model, [second]), fit(model, [PreparedRun(second.recording)])
    np.testing.assert_array_equal(again.theta, alone.theta)
    np.testing.assert_array_equal(again.covariance, alone.covariance)
    drawn, other = (second.noisy_columns(model.physics, [seed]) for seed in (1, 2))
    effect = model.physics[0]
    for one, another, run in zip(drawn, other, second.noisy([1]), strict=True):
        for row, columns in run.columns(effect).items():
            np.testing.assert_array_equal(one.of(effect)[row], columns)
        assert any(np.any(one.of(effect)[row] != another.of(effect)[row]) for row in run.columns(effect))


def test_a_further_effect_is_drawn_with_the_noise_of_the_others(rough: Run, model: Model) -> None:
    """Columns made in two steps are those made at once."""
    steps, once = (PreparedRun.of(part(rough, 8.0), VEHICLE, RIG) for _ in range(2))
    steps.noisy_columns(model.physics[:-1], [3])
    pairs = (run.noisy_columns(model.physics, [3]) for run in (steps, once))
    for found, wanted in zip(*pairs, strict=True):
        for effect in model.physics:
            for row, columns in wanted.of(effect).items():
                np.testing.assert_array_equal(found.of(effect)[row], columns)
        for row, right in wanted.measured.items():
            np.testing.assert_array_equal(found.measured[row], right)


def test_bad_seconds_count_less_and_are_named(rough: Run, whole: Fit, model: Model) -> None:
    """Two seconds of a wheel's load gone wrong: a robust fit names them and stays where the clean one is."""
    signal = rough.signals["wheel.fl.force"]
    wrong = signal.values.copy()
    t = signal.t - signal.t[0]
    hit = (t > 5.0) & (t < 7.0)
    wrong[hit] += 4000.0 * np.sin(2 * np.pi * 2.0 * t[hit])[:, None]
    spoilt = replace(rough, signals={**rough.signals, "wheel.fl.force": replace(signal, values=wrong)})
    bad = PreparedRun.of(spoilt, VEHICLE, RIG)
    plain, robust = (fit(model, [bad], FitOptions(unbias=False, robust=way)) for way in (False, True))
    clean = fit(model, [whole.runs[0]], FitOptions(unbias=False))
    sigma = dict(zip(model.names, np.sqrt(np.diag(clean.covariance)), strict=True))
    assert abs(plain.value("damper.fl.c") - clean.value("damper.fl.c")) > 15 * sigma["damper.fl.c"]
    for name in ("damper.fl.c", "spring.fl.k", "tyre_stiffness.fl.kt", "YY6"):
        assert abs(robust.value(name) - clean.value(name)) < 4 * sigma[name], name
    named = robust.bad_seconds()
    assert {bad.row for bad in named if bad.weight < 0.1} >= {"suspension.fl", "tyre.fl", "chassis.fz"}
    assert all(4.0 <= bad.start <= 7.0 for bad in named if bad.weight < 0.5)
    assert not plain.bad_seconds()


def test_bootstrap_and_hac_agree_in_size(whole: Fit) -> None:
    """Blocks drawn again scatter as the residuals' correlation says, within a factor of two for nearly all."""
    drawn = whole.bootstrap(199)
    assert drawn.shape == (199, len(whole.theta))
    hac = np.sqrt(np.diag(whole.covariance))[whole.place]
    ratio = np.std(drawn, axis=0)[whole.place] / hac
    assert np.mean((ratio > 0.5) & (ratio < 2.0)) > 0.9, np.round(np.sort(ratio), 2)
    assert 0.7 < np.median(ratio) < 1.4
    shift = np.abs(np.mean(drawn, axis=0) - whole.theta)[whole.place]
    assert np.median(shift / hac) < 0.5


def test_pieces_have_the_columns_of_the_whole(rough: Run, model: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    """Left sides and columns of a run worked on in pieces are those of the whole, ends included.

    Effects with a memory of their own (hysteresis) may differ by what they remember of the piece's beginning.
    """
    effects = [effect for effect in model.physics if effect.instantaneous]
    whole = PreparedRun.of(rough, VEHICLE, RIG)
    expected = whole.measured, {row: whole.matrix(effects, row) for row in whole.rows}
    monkeypatch.setattr("lacet.identify.regression.prepared_run.PIECE", 3.0)
    parts = PreparedRun.of(rough, VEHICLE, RIG)
    assert len(list(parts.pieces())) > 3
    assert parts.rows == whole.rows
    for row in whole.rows:
        np.testing.assert_array_equal(parts.index[row], whole.index[row])
        for one, other in ((parts.measured, expected[0]), ({row: parts.matrix(effects, row)}, expected[1])):
            np.testing.assert_allclose(one[row], other[row], rtol=0.0, atol=1e-10 * np.max(np.abs(other[row])))


def test_a_last_piece_without_a_sample_is_none(rough: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pieces are of equal length, whatever the run's, and one of flagged samples alone is left out."""
    run = PreparedRun.of(rough, VEHICLE, RIG)
    n, rate = run.recording.t.size, run.recording.filters.rate
    monkeypatch.setattr("lacet.identify.regression.prepared_run.PIECE", (n - 20) / rate / 3)
    lengths = [own.stop - own.start for _, own in run.every_piece()]
    assert len(lengths) == 3
    assert max(lengths) - min(lengths) < 2 * run.recording.filters.step
    third = n // 3
    flagged = {name: mask & (np.arange(n) < 2 * third - 40) for name, mask in run.recording.usable.items()}
    short = PreparedRun(replace(run.recording, usable=flagged))
    assert len(list(short.pieces())) == 2
    assert len(list(short.every_piece())) == 3
