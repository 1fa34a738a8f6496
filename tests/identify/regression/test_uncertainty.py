"""What the sensor sheet adds to intervals, against instruments really off; no interval narrower than the plain one."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from lacet.daq.formats.open_run import open_run
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.uncertainty import at_least, spread_of
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.signals.filters import derivative
from lacet.identify.signals.reconstruct import Signals
from tests.identify import cars
from tests.support.places import HOME

VEHICLE, RIG = cars.reference_car()


@pytest.fixture(scope="module")
def plain() -> Fit:
    """The model the car needs on its rough run, weights frozen at its own."""
    known = catalogue(VEHICLE, "hub")
    model = Model.of([*base_model(VEHICLE, "hub"), known["anti_roll_bar.front"], known["anti_roll_bar.rear"]])
    record = PreparedRun.of(open_run(cars.CAR / "rough.parquet"), VEHICLE, RIG).recording
    drive = PreparedRun(record.at(slice(0, int(12.0 * record.filters.rate))))
    sigma = fit(model, [drive], FitOptions(unbias=False)).sigma
    return fit(model, [drive], FitOptions(weights=sigma, unbias=False))


@pytest.mark.parametrize(
    ("what", "channel", "component"),
    [("gain", "wheel.fl.force", 2), ("gain", "laser.rr.hub", 0), ("gain", "imu.accel", 2), ("latency", "laser", 0)],
)
def test_an_instrument_off_by_its_tolerance_moves_the_fit_as_told(
    plain: Fit, what: str, channel: str, component: int
) -> None:
    """The linear answer is the shift of a fit to the same run with that instrument really off."""
    zeros = plain.equations.zeros(plain.solution, plain.sigma)
    told = spread_of(plain.assembly, plain.equations, plain.solution, zeros, plain.sigma, sheet=True)[0].sheet
    (push,) = [p for (kind, name, k), p in told.items() if kind == what and name.startswith(channel) and k == component]
    root = plain.root[:, :-1]
    expected = np.linalg.solve(root.T @ root, push)
    record = plain.runs[0].recording
    values = dict(record.signals.value)
    for name in values:
        if what == "latency" and name.startswith("laser"):
            values[name] = values[name] - RIG.tolerance(name, what) * derivative(values[name], record.filters.rate)
        elif name == channel:
            values[name] = values[name].copy()
            values[name][component] *= 1.0 + RIG.tolerance(name, what)
    off = PreparedRun(record.with_signals(Signals.differentiated(values, record.filters.rate)))
    found = fit(plain.model, [off], FitOptions(weights=plain.sigma, unbias=False))
    sigma = np.sqrt(np.diag(plain.covariance + plain.covariance_sheet))[plain.place]
    assert np.max(np.abs(found.solution - plain.solution) / sigma) > 0.05
    # 2 ms are not small for a rough road: the second order is a part of the interval.
    assert np.max(np.abs(found.solution - plain.solution - expected) / sigma) < (0.4 if what == "latency" else 0.1)


@pytest.mark.slow
def test_a_fault_in_the_model_is_not_counted_in_the_sheet_again(plain: Fit) -> None:
    """A gain that is estimated has its own interval, and adds nothing as a tolerance."""
    gain = catalogue(VEHICLE, "hub")["sensor_gain.force.fl"]
    freed = fit(Model.of([*plain.model.effects, gain]), plain.runs, FitOptions(weights=plain.sigma, unbias=False))
    k = freed.model.names.index("spring.fl.k")
    assert freed.covariance_sheet[k, k] < plain.covariance_sheet[k, k]


def test_the_larger_of_two_covariances_keeps_correlations() -> None:
    """Every σ is the larger one, and correlations stay."""
    rng = np.random.default_rng(2)
    one, other = (a @ a.T for a in rng.standard_normal((2, 4, 6)))
    both = at_least(one, other)
    np.testing.assert_allclose(np.diag(both), np.maximum(np.diag(one), np.diag(other)))
    size, was = np.sqrt(np.diag(both)), np.sqrt(np.diag(one))
    np.testing.assert_allclose(both / np.outer(size, size), one / np.outer(was, was))


def test_intervals_are_no_narrower_than_plain_ones(plain: Fit) -> None:
    """σ of correlated residuals ≥ σ of independent ones, for every parameter."""
    ratio = np.diag(plain.covariance)[plain.place] / np.diag(plain.covariance_iid)[plain.place]
    assert np.min(ratio) > 1.0 - 1e-9
    assert np.median(ratio) < 4.0


@pytest.mark.slow
def test_the_coverage_study_runs(tmp_path: Path) -> None:
    """A few campaigns of each kind, resumed, and its page."""
    script = HOME / "benchmarks" / "coverage.py"
    page = tmp_path / "coverage.md"
    for count in ("20", "24"):
        words = [
            sys.executable,
            str(script),
            "--campaigns",
            count,
            "--folder",
            str(tmp_path),
            "--page",
            str(page),
            "--workers",
            "1",
        ]
        subprocess.run(words, check=True, timeout=1200)
    text = page.read_text(encoding="utf-8")
    assert "24 simulated campaigns" in text
    rows = [line.split("|") for line in text.splitlines() if line.startswith("| ") and "°" not in line][1:]
    held = [float(cells[4]) for cells in rows]
    assert np.median(held) > 85.0
