"""Noise-free recovery: a car that is exactly the model gives its parameters back through filter and decimation."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from lacet.daq.channels import CHANNELS
from lacet.daq.run import Run, Signal
from lacet.identify.effects.catalogue import catalogue
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.signals.filters import Filters, zero_phase
from lacet.identify.signals.reconstruct import Recording, Signals, bring_together
from tests.identify import cars
from tests.identify.cars import RATE
from tests.support.places import HOME

VEHICLE, RIG = cars.reference_car()
FAST = 500.0
PAGE = HOME / "docs" / "numerical-differentiation.md"


def model_of(vehicle, reference: str) -> Model:
    """The base model and both bars."""
    known = catalogue(vehicle, reference)
    base = [effect for effect in known.values() if effect.base]
    return Model.of([*base, known["anti_roll_bar.front"], known["anti_roll_bar.rear"]])


def true_theta(model: Model, seed: int) -> Array:
    """Parameters of a plausible car, no two alike."""
    rng = np.random.default_rng(seed)
    size = {
        "chassis": {"XX": 550, "XY": 20, "XZ": 300, "YY": 3900, "YZ": -10, "ZZ": 4000, "MX": -1500, "MY": 15, "MZ": 330,
                    "M": 1270},
        "axle": {"XX": 0.4, "XY": 0.02, "XZ": 0.03, "YY": 0.5, "YZ": -0.02, "ZZ": 0.45, "MX": 0.5, "MY": 0.8, "MZ": 0.3,
                 "M": 30},
        "wheel": {"ZZ": 0.9, "XX": 0.5, "MZ": 0.2, "M": 10},
    }  # fmt: skip
    other = {"k": 25000, "c": 1700, "f0": 3100, "kt": 205000, "m": 24}
    out = []
    for effect in model.effects:
        for parameter in effect.parameters:
            kind = effect.where.partition(".")[0]
            value = (
                size[kind][parameter.name.rstrip("0123456789")]
                if effect.name == "body"
                else other[parameter.name.rpartition(".")[2]]
            )
            out.append(value * rng.uniform(0.8, 1.2) * (0.5 if "bar" in effect.name else 1.0))
    return np.array(out)


@cache
def exact(
    rate: float, seconds: float, reference: str, tables: bool, band: tuple[float, float], seed: int
) -> tuple[Recording, Model, Array]:
    """A recording that fulfils the model exactly, with exact derivatives."""
    vehicle = cars.with_tables(VEHICLE, pitch=False) if tables else VEHICLE
    rig = cars.in_reference(RIG, reference)
    model = model_of(vehicle, reference)
    theta = true_theta(model, seed)
    t = np.arange(round(seconds * rate)) / rate
    signals = cars.exact_signals(cars.drive_curves(np.random.default_rng(seed), band), t)
    filters = Filters(rate=rate, pre_cutoff=None)
    record = cars.recording(signals, vehicle, rig, filters)
    return cars.fulfil(record, model.effects, theta), model, theta


def relative(fitted: Fit, theta: Array) -> dict[str, float]:
    """Relative error of each base parameter; small ones against the parameter's own kind (its prior)."""
    base = fitted.base
    wanted, found = base.grouping() @ theta, fitted.theta[base.independent]
    floor = np.array([1e-2 * fitted.model.parameters[k].prior for k in base.independent])
    names = [base.names[k] for k in base.independent]
    return dict(zip(names, (found - wanted) / np.maximum(np.abs(wanted), floor), strict=True))


@pytest.mark.parametrize(("reference", "tables"), [("hub", False), ("hub", True), ("contact", True)])
def test_exact_signals_give_exact_parameters(reference: str, tables: bool) -> None:
    """Every base parameter to 1e-8 through the parallel filter and decimation: the filter does nothing to W θ."""
    record, model, theta = exact(100.0, 24.0, reference, tables, (0.15, 4.0), 3)
    fitted = fit(model, [PreparedRun(record)], FitOptions(zeros=False, unbias=False))
    assert {row.partition(".")[0] for row in fitted.rows} == {"chassis", "suspension", "tyre", "spin"}
    worst = relative(fitted, theta)
    assert max(map(abs, worst.values())) < 1e-8, {k: v for k, v in worst.items() if abs(v) >= 1e-8}
    # What the equations cannot tell apart is grouped, not invented: the rank is that of a rank-revealing SVD.
    scaled = np.concatenate([fitted.runs[0].matrix(model.effects, row) for row in fitted.rows])
    scaled = scaled / np.maximum(np.linalg.norm(scaled, axis=0), 1e-300)
    s = np.linalg.svd(scaled, compute_uv=False)
    assert fitted.base.rank == int(np.sum(s > 1e-9 * s[0]))
    for row in fitted.runs[0].rows:
        assert np.max(np.abs(fitted.residual[0][row])) < 1e-7 * np.max(np.abs(fitted.runs[0].measured[row]))


def test_two_runs_are_one_campaign() -> None:
    """Half of the parameters' excitation in each run: together they give everything; order does not matter."""
    record, model, theta = exact(100.0, 24.0, "hub", True, (0.15, 4.0), 3)
    half = record.t.size // 2
    drives = [PreparedRun(record.at(slice(0, half))), PreparedRun(record.at(slice(half, None)))]
    one, other = (fit(model, runs, FitOptions(zeros=False, unbias=False)) for runs in (drives, drives[::-1]))
    assert max(map(abs, relative(one, theta).values())) < 1e-7
    np.testing.assert_allclose(one.theta, other.theta, rtol=1e-6, atol=1e-7)


def test_frozen_weights_do_not_change_an_exact_fit() -> None:
    """Any weights give the same answer when nothing is left over."""
    record, model, theta = exact(100.0, 24.0, "hub", False, (0.15, 4.0), 3)
    weights = {row: 10.0 ** (k % 3) * 1e-6 for k, row in enumerate(PreparedRun(record).rows)}
    fitted = fit(model, [PreparedRun(record)], FitOptions(weights=weights, zeros=False, unbias=False))
    assert fitted.sigma == weights
    assert max(map(abs, relative(fitted, theta).values())) < 1e-6


def as_run(record: Recording) -> Run:
    """The recording as the rig's instruments would give it: each channel at its own rate, stamped late."""
    signals = {}
    for name, array in record.signals.value.items():
        every = round(FAST / CHANNELS[name].rate)  # of its own rate
        values = array[:, ::every].T.copy()
        stamps = record.t[::every] + record.rig.latency(name)
        signals[name] = Signal(stamps, values, np.zeros(len(values), np.uint8))
    return Run("exact", signals, brakes="off")


@pytest.fixture(scope="module")
def biases() -> dict[str, dict[str, float]]:
    """Bias in % of each base parameter, by way of processing, on a lively noise-free drive up to 12 Hz."""
    record, model, theta = exact(FAST, 14.0, "hub", False, (0.15, 12.0), 3)
    slow = record.at(slice(None, None, round(FAST / RATE)))
    slow = replace(slow, filters=Filters(pre_cutoff=None))
    crude = {name: np.gradient(array, axis=1) * RATE for name, array in slow.signals.value.items()}
    twice = {name: np.gradient(array, axis=1) * RATE for name, array in crude.items()}
    three_point = slow.with_signals(Signals(slow.signals.value, crude, twice))
    smooth = {name: zero_phase(array, 6.0, RATE, 6) for name, array in slow.signals.value.items()}
    at_fit = slow.with_signals(Signals.differentiated(smooth, RATE))
    numeric = slow.with_signals(Signals.differentiated(slow.signals.value, RATE))
    whole = bring_together(as_run(record), record.vehicle, record.rig, Filters())
    return {
        what: {
            k: 100 * v
            for k, v in relative(fit(model, [PreparedRun(r)], FitOptions(zeros=False, unbias=False)), theta).items()
        }
        for what, r in (
            ("exact derivatives", slow),
            ("differences", numeric),
            ("whole pipeline", whole),
            ("three-point differences", three_point),
            ("channels filtered at 6 Hz", at_fit),
        )
    }


GROUPS = {
    "chassis mass and first moments": r"M[XYZ]?6",
    "chassis inertia": r"[XYZ]{2}6",
    "axle and wheel masses": r"M(11|20|29|38)",
    "springs": r"spring.*",
    "dampers": r"damper.*",
    "tyre stiffness": r"tyre_stiffness.*",
    "outboard masses": r"outboard_mass.*",
    "anti-roll bars": r"anti_roll_bar.*",
}


def largest(errors: dict[str, float]) -> dict[str, float]:
    """The largest error of each group [%]."""
    return {
        group: max(abs(v) for k, v in errors.items() if re.fullmatch(pattern, k)) for group, pattern in GROUPS.items()
    }


def test_numerical_differentiation_biases_less_than_one_percent(biases) -> None:
    """Differences alone, and the whole pipeline (pre-filter, resampling, latencies, differences)."""
    for what, errors in biases.items():
        print(f"\n{what}: largest bias in %")
        for group, error in largest(errors).items():
            print(f"  {group:32s} {error:9.2e}")
    assert max(largest(biases["exact derivatives"]).values()) < 1e-5
    assert max(largest(biases["differences"]).values()) < 0.05
    assert max(largest(biases["whole pipeline"]).values()) < 1.0


SHOWN = ("differences", "whole pipeline", "three-point differences", "channels filtered at 6 Hz")


def test_the_page_shows_what_is_measured(biases) -> None:
    """The documentation's table holds these numbers, as rounded as it prints them."""
    text = PAGE.read_text(encoding="utf-8")
    for group in GROUPS:
        found = re.search(rf"^\| {re.escape(group)} \| (.+) \|$", text, re.MULTILINE)
        assert found, f"{PAGE.name} has no row '{group}'"
        for shown, what in zip(found.group(1).split(" | "), SHOWN, strict=True):
            measured = largest(biases[what])[group]
            if shown.startswith("<"):
                assert measured < float(shown[1:]), (group, what, measured)
            else:
                assert float(shown) == pytest.approx(measured, rel=0.1), (group, what, measured)
