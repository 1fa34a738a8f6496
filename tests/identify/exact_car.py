"""A car that is exactly its model, or the model and one effect more, driven with simulated noise."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from lacet.identify.effects.base import Effect, SensorFault
from lacet.identify.effects.catalogue import catalogue
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sums.prepared_runs import recording_without_faults
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.signals.filters import Filters
from lacet.identify.signals.noise_draws import draw_noise
from lacet.identify.signals.reconstruct import Recording, Signals
from tests.identify import cars

VEHICLE, RIG = cars.reference_car()
KNOWN = catalogue(VEHICLE, "hub")
MODEL = Model.of(e for e in KNOWN.values() if e.base)
SECONDS = 12.0


def theta() -> Array:
    """A plausible car."""
    values = {"k": 25000.0, "c": 1700.0, "f0": 3100.0, "kt": 205000.0, "m": 24.0}
    bodies = {
        "chassis": {"XX": 550, "XY": 20, "XZ": 300, "YY": 3900, "YZ": -10, "ZZ": 4000, "MX": -1500, "MY": 15, "MZ": 330,
                    "M": 1270},
        "axle": {"XX": 0.4, "YY": 0.5, "ZZ": 0.45, "MX": 0.5, "MY": 0.8, "MZ": 0.3, "M": 30},
        "wheel": {"ZZ": 0.9, "XX": 0.5, "MZ": 0.2, "M": 10},
    }  # fmt: skip
    return np.array(
        [
            float(bodies[effect.where.partition(".")[0]].get(q.name.rstrip("0123456789"), 0.02))
            if effect.name == "body"
            else values[q.name.rpartition(".")[2]]
            for effect in MODEL.effects
            for q in effect.parameters
        ]
    )


@cache
def exact() -> Recording:
    """A lively drive of a car that is the model; no noise."""
    return exact_with()


def exact_with(hidden: Effect | None = None, *sizes: float) -> Recording:
    """The same drive of a car that is the model and an effect of this size."""
    record, changes = _without_loads()
    further = [] if hidden is None else [hidden]
    return cars.fulfil(record, (*MODEL.effects, *further), np.append(theta(), sizes), changes)


@cache
def _without_loads() -> tuple[Recording, Array]:
    """The drive before its loads are known, and the changes of channels that make its rows hold."""
    t = np.arange(round(SECONDS * cars.RATE)) / cars.RATE
    record = cars.recording(cars.exact_signals(cars.drive_curves(np.random.default_rng(1)), t), VEHICLE, RIG, Filters())
    return record, cars.smallest_changes(record, MODEL.effects, theta())


def exact_with_laws(hidden: Sequence[tuple[Effect, float]]) -> Recording:
    """The same drive of a car that is the model and these laws, with their sizes."""
    laws, sizes = zip(*hidden, strict=True)
    return cars.fulfil(exact(), (*MODEL.effects, *laws), np.append(theta(), sizes), _changes())


@cache
def _changes() -> Array:
    return cars.smallest_changes(exact(), MODEL.effects, theta())


def driven(record: Recording, seed: int, loud: float = 1.0) -> PreparedRun:
    """The drive as its instruments record it: with `loud` times the sheet's noise."""
    noise = draw_noise(record, record.signals.value, np.random.default_rng([3, seed]))
    values = {name: a + loud * noise[name] for name, a in record.signals.value.items()}
    return PreparedRun(record.with_signals(Signals.differentiated(values, record.filters.rate)))


def later(key: str, seconds: float, seed: int, loud: float = 1.0) -> PreparedRun:
    """The drive with one kind of instrument, by its fault's key, stamped that much too late."""
    fault = KNOWN[key]
    assert isinstance(fault, SensorFault)
    return driven(recording_without_faults(exact(), [fault], np.array([-seconds])), seed, loud)


def fit_of(drive: PreparedRun, like: Fit | None = None) -> Fit:
    """The model on it; what depends on the motion alone is taken from another run of the same."""
    return fit(MODEL, [drive], FitOptions(draws=2), stored=like.stored if like else None)
