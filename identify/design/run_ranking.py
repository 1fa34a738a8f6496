"""Ranking of planned runs by how much they would narrow the intervals of poorly known quantities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

from lacet.daq.errors import UsageError, nearest
from lacet.daq.vehicle import Vehicle
from lacet.identify.design.run_information import Information, RunInformation, half_widths, predicted
from lacet.identify.effects.base import Effect, SensorFault, with_places
from lacet.identify.properties.whole_vehicle import NAMES, UNITS, whole_vehicle
from lacet.identify.regression.shape_uncertainty import ConstantChange
from lacet.identify.regression.wls import Fit

DURATIONS = (10.0, 15.0, 20.0, 25.0, 30.0, 45.0, 60.0, 90.0, 120.0, 180.0, 300.0)
"""Durations tried [s], up to the longest allowed."""
ENOUGH = 1.15
"""Mean factor of the targets' intervals over those of the longest run up to which a shorter run suffices."""
REACHED = 0.5
"""Half-width ÷ size that some run must attain for a quantity to be a target."""


@dataclass(frozen=True)
class Quantity:
    """A parameter, or a value of the whole vehicle, with its interval.

    `half` of its 95 % interval, the plausible range where the runs do not determine it; `size` the reference of the
    half-width: the largest value of its kind (all springs; all moments of inertia of the chassis), since a value near
    zero, or one not known yet, is no measure of itself.
    """

    name: str
    unit: str
    value: float
    half: float
    size: float


@dataclass(frozen=True)
class Shrink:
    """Change of one quantity's interval by a run: half of its 95 % interval before and after, and the goal [unit]."""

    name: str
    unit: str
    value: float
    before: float
    after: float
    goal: float

    @property
    def worth(self) -> float:
        """Natural logarithm of the factor by which the interval narrows, not below the goal."""
        return max(0.0, float(np.log(self.before / max(self.after, self.goal, 1e-300))))


@dataclass(frozen=True)
class Ranked:
    """One run of the ranking.

    `index` of the run as given; `worth` mean logarithm of the narrowing of the targets by a run of the longest
    duration; `duration` [s] that is nearly as good; `shrinks` of every target by that duration, the largest first.
    """

    index: int
    worth: float
    duration: float
    shrinks: tuple[Shrink, ...]

    @property
    def factor(self) -> float:
        """Geometric mean of the factors by which the targets' intervals narrow in a run of the longest duration."""
        return float(np.exp(self.worth))


@dataclass(frozen=True)
class Ranking:
    """Runs in descending order of worth; `targets` name → goal [unit]; `out_of_reach` names that no run determines."""

    runs: tuple[Ranked, ...]
    targets: Mapping[str, float]
    out_of_reach: tuple[str, ...]


def quantities(fitted: Fit, vehicle: Vehicle) -> dict[str, Quantity]:
    """Every parameter of a fit and every value of the whole vehicle, by name.

    A change of a shape constant (`with_constant_changes`) stands for the constant, with its value.
    """
    model = fitted.model
    kinds: list[str] = []
    for effect in (*model.physics, *model.faults):
        kinds += [f"{_kind(effect)} [{q.unit}]" for q in effect.parameters]
    values = fitted.theta.copy()
    for change, place in with_places(model.physics):
        if isinstance(change, ConstantChange):
            values[place] = change.effect.shape[change.constant]
    largest: dict[str, float] = {}
    for kind, q, value in zip(kinds, model.parameters, values, strict=True):
        largest[kind] = max(largest.get(kind, 0.02 * q.prior), abs(float(value)))
    halves = half_widths(fitted)
    out = {
        q.name: Quantity(q.name, q.unit, float(value), float(half), largest[kind])
        for q, value, half, kind in zip(model.parameters, values, halves, kinds, strict=True)
    }
    whole = whole_vehicle(fitted, vehicle)
    if whole is not None and whole.values[0] > 0.0:
        length = float(np.ptp([corner.position[0] for corner in vehicle.corners.values()]))
        sizes = np.array([whole.values[0], *[length] * 3, *[max(*np.abs(whole.values[4:7]), 1e-9)] * 6])
        for k, name in enumerate(NAMES):
            half = float(whole.interval[k]) if whole.determined[k] else max(float(whole.interval[k]), float(sizes[k]))
            out[name] = Quantity(name, UNITS[k], float(whole.values[k]), half, float(sizes[k]))
    return out


def _kind(effect: Effect | SensorFault) -> str:
    """The name that values of one kind share."""
    if isinstance(effect, ConstantChange):
        return effect.key
    return f"{effect.name}.{effect.where.partition('.')[0]}" if effect.name == "body" else effect.name


def chosen(known: Mapping[str, Quantity], patterns: Sequence[str]) -> list[str]:
    """Names that match any of the patterns (``YY6``, ``damper.*``, ``cog.?``). Raises UsageError where one has none."""
    out: dict[str, None] = {}
    for pattern in patterns:
        found = [name for name in known if fnmatchcase(name, pattern)]
        if not found:
            raise UsageError(f"there is no parameter or whole-vehicle value '{pattern}'{nearest(pattern, known)}")
        out |= dict.fromkeys(found)
    return list(out)


def rank(
    fitted: Fit,
    now: Information,
    runs: Sequence[RunInformation],
    vehicle: Vehicle,
    longest: float,
    names: Sequence[str] = (),
    goal: float = 0.02,
) -> Ranking:
    """The ranking of runs by what they would add to the information at hand.

    Parameters
    ----------
    fitted : the model and its present values.
    now : information of the runs at hand (`fit_information`), or of none (`Information.none`).
    runs : information of each run.
    longest : duration allowed [s].
    names : the targets; by default every parameter whose half-width is above its goal and that some run brings below
        `REACHED`.
    goal : half-width aimed at, as a part of the quantity's size; narrowing below it has no worth. For targets named
        explicitly it applies only when it is above zero.
    """
    before = quantities(predicted(fitted, now), vehicle)
    after = [quantities(predicted(fitted, now + run.lasting(longest)), vehicle) for run in runs]
    out_of_reach: list[str] = []
    targets = list(names)
    if not targets:
        wide = [q.name for q in before.values() if q.half > goal * q.size and q.name in fitted.model.names]
        best = {name: min((one[name].half for one in after), default=np.inf) for name in wide}
        targets = [name for name in wide if best[name] < REACHED * before[name].size]
        out_of_reach = [name for name in wide if name not in targets]
    goals = {name: goal * before[name].size for name in targets}
    found: list[Ranked] = []
    for index, (run, then) in enumerate(zip(runs, after, strict=True)):
        worth = _worth(_shrinks(before, then, goals))
        duration = longest
        for tried in (d for d in DURATIONS if d < longest):
            then = quantities(predicted(fitted, now + run.lasting(tried)), vehicle)
            if _worth(_shrinks(before, then, goals)) >= worth - np.log(ENOUGH):
                duration = tried
                break
        else:
            then = after[index]
        shrinks = sorted(_shrinks(before, then, goals), key=lambda s: -s.worth)
        found.append(Ranked(index, worth, duration, tuple(shrinks)))
    found.sort(key=lambda one: (-round(one.worth, 6), one.duration))
    return Ranking(tuple(found), goals, tuple(out_of_reach))


def _shrinks(before: Mapping[str, Quantity], after: Mapping[str, Quantity], goals: Mapping[str, float]) -> list[Shrink]:
    return [
        Shrink(name, before[name].unit, before[name].value, before[name].half, after[name].half, goal)
        for name, goal in goals.items()
    ]


def _worth(shrinks: Sequence[Shrink]) -> float:
    return float(np.mean([s.worth for s in shrinks])) if shrinks else 0.0
