"""Rest: what a model leaves that neither chance nor the stated inexactness explains, and that is no trifle.

One omnibus test of the final model: the weighted squares of every row, the squares of all sensor tolerances, and the
scatter of each added law between runs are compared with simulated runs of that model.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect, Implausible
from lacet.identify.multibody.vectors import Array
from lacet.identify.selection.lack_of_fit import LackOfFit, excess_is_coloured
from lacet.identify.selection.partial_regression import PartialRegression
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION
from lacet.identify.selection.tolerance_tests import ToleranceUse


@dataclass(frozen=True)
class AddedLaw:
    """An effect beyond the base model that a fit has.

    Attributes
    ----------
    key, family : its key, and the name of its law.
    values : (k,) its parameters with the sensor sheet's tolerances [SI]; `places` where they stand in the model.
    force : weighted squares of the part of its force that nothing else in the model explains; `null` (D,) those in
        simulated runs that lack it.
    row_force : row → weighted squares of its whole force.
    implausible : what no car has of it, if anything.
    sheet_entries : entries of the sensor sheet for the same error, of a sensor fault.
    describes : whether it only describes a force of unknown cause.
    looks_like : names of the laws that it is confounded with by construction.
    removed : what of the value was removed from the runs before the fit, of a sensor fault.
    opposed : whether its forces at the two wheels of an axle are one and its opposite.
    """

    key: str
    family: str
    values: Array = field(repr=False)
    places: tuple[int, ...]
    force: float
    null: Array = field(repr=False)
    row_force: Mapping[Row, float]
    implausible: Implausible | None = None
    sheet_entries: frozenset[tuple[str, str]] = frozenset()
    describes: bool = False
    looks_like: tuple[str, ...] = ()
    removed: float = 0.0
    opposed: bool = False

    @property
    def rows(self) -> frozenset[Row]:
        """Rows that it acts on."""
        return frozenset(self.row_force)


def added_laws(space: ScoreTests) -> tuple[AddedLaw, ...]:
    """The physical effects beyond the base model in the fit of `space`, in the model's order."""
    return _added(space, space.fitted.model.physics, space.regression, space.null)


def added_faults(space: ScoreTests, removed: Mapping[str, float]) -> tuple[AddedLaw, ...]:
    """The sensor faults in the fit of `space`, in the same form: their force is what they change in the rows.

    `removed` : size by key of what was removed from the runs before the fit, which has the rest of it.
    """
    return _added(space, space.fitted.model.faults, space.regression, space.null, removed)


def laws_on_rows(space: ScoreTests, rows: Collection[Row]) -> tuple[AddedLaw, ...]:
    """The same of the physical effects, from the equations of some rows alone."""
    return _added(space, space.fitted.model.physics, *space.on_rows(rows))


@dataclass(frozen=True)
class Departure:
    """What the equations of some rows want changed of an effect in the fit of all rows.

    Attributes
    ----------
    key : of the effect.
    squares : weighted squares of the change in those rows; `null` (D,) those in simulated runs of the fit.
    force : weighted squares in those rows of the effect as it is in the fit.
    """

    key: str
    squares: float
    null: Array = field(repr=False)
    force: float


def departures_on_rows(
    space: ScoreTests, effects: Sequence[Effect], rows: Collection[Row], removed: Mapping[str, float]
) -> tuple[Departure, ...]:
    """The change that some rows alone want of each of these effects in the fit of `space`, whatever else is changed.

    `removed` : as in `added_faults`.
    """
    estimate = _Estimate.of(space, *space.on_rows(rows))
    fitted = space.fitted
    out: list[Departure] = []
    for effect in effects:
        at = estimate.places(effect)
        if at:
            normal = np.linalg.inv(estimate.spread[np.ix_(at, at)])
            drawn, size = estimate.drawn[at], fitted.theta[fitted.place][at] + removed.get(effect.key, 0.0)
            null = np.einsum("kd,kd->d", drawn, normal @ drawn)
            change = estimate.change[at]
            out.append(Departure(effect.key, float(change @ normal @ change), null, float(size @ normal @ size)))
    return tuple(out)


@dataclass(frozen=True)
class _Estimate:
    """Parameters of a fit, estimated anew with the sheet's tolerances.

    `names` of those in the equations; `change` (q,) of each from the fit; `spread` (q, q) their covariance, and `drawn`
    (q, D) the changes in simulated runs.
    """

    names: list[str]
    change: Array
    spread: Array
    drawn: Array

    @classmethod
    def of(cls, space: ScoreTests, known: PartialRegression, simulated: Array) -> _Estimate:
        model, turn = known.sums.layout.model, known.sums.turn
        inverse = turn @ known.inverse[:model]
        change = turn @ known.gain[:model, known.sums.layout.right]
        return cls(list(space.fitted.columns), change, inverse[:, :model] @ turn.T, inverse @ simulated[known.nuisance])

    def places(self, effect: Effect) -> list[int]:
        """Places of an effect's parameters in the equations."""
        return [self.names.index(q.name) for q in effect.parameters if q.name in self.names]


def _added(
    space: ScoreTests, effects: Sequence[Effect], known: PartialRegression, simulated: Array,
    removed: Mapping[str, float] | None = None,
) -> tuple[AddedLaw, ...]:  # fmt: skip
    fitted, estimate = space.fitted, _Estimate.of(space, known, simulated)
    model, turn = known.sums.layout.model, known.sums.turn
    spread, drawn = estimate.spread, estimate.drawn
    theta = fitted.theta[fitted.place] + estimate.change
    out: list[AddedLaw] = []
    for effect in effects:
        if effect.base:
            continue
        at = estimate.places(effect)
        if not at:
            continue
        gone = (removed or {}).get(effect.key, 0.0)
        values, own = theta[at] + gone, np.zeros(len(estimate.names))
        own[at] = values
        whole = np.zeros((known.sums.layout.width, 1))
        whole[:model, 0] = np.linalg.solve(turn, own)
        squares = {row: float(one.squares_of(whole)[0]) for row, one in known.sums.over_runs.rows.items()}
        normal = np.linalg.inv(spread[np.ix_(at, at)])
        force = float(values @ normal @ values)
        null = np.einsum("kd,kd->d", drawn[at], normal @ drawn[at])
        acting = {row: a for row, a in squares.items() if effect.acts_on(row)}
        half = SELECTION.interval_quantile * np.sqrt(np.diag(spread)[at])
        wrong = effect.implausible(values, half) if len(at) == len(effect.parameters) else None
        out.append(
            AddedLaw(
                effect.key, effect.name, values, tuple(at), force, null, acting, wrong, effect.sheet_entries,
                effect.describes, effect.looks_like, gone, effect.opposed,
            )
        )  # fmt: skip
    return tuple(out)


@dataclass(frozen=True)
class Rest:
    """What a model leaves, compared with simulated runs of it.

    Attributes
    ----------
    lack : lack of fit with the sensor sheet's tolerances in the model.
    sheet : sensor tolerances that the runs need.
    forces : row → RMS of what remains above the floor [N or N·m], and the row's own RMS variation.
    unlisted : rows with a rest that matters, farthest above their floor first; `small` those whose rest is less than
        the user's effect size, or than the laws found may be inexact.
    doubted : rows in which whatever remains counts, as effects were found there that stand for something unlisted.
    """

    lack: LackOfFit
    sheet: ToleranceUse
    forces: Mapping[Row, tuple[float, float]]
    unlisted: tuple[Row, ...]
    small: tuple[Row, ...]
    doubted: frozenset[Row] = frozenset()

    @classmethod
    def of(cls, space: ScoreTests, laws: Sequence[AddedLaw] = (), doubted: frozenset[Row] = frozenset()) -> Rest:
        """The rest of the model of `space`, in which are these `laws`; `doubted` : rows in which any counts."""
        lack = space.residual_beside([])
        variation, sigma = space.linearisation.runs.row_variations(), space.floor.sigma
        forces = {
            row: (sigma[row] * float(np.sqrt(max(0.0, ratio**2 - 1.0))), variation.get(row, np.inf))
            for row, ratio in lack.ratios.items()
        }
        standing = [row for row in lack.above if lack.p[row] <= SELECTION.level(space.draws)]
        if standing and not excess_is_coloured(lack):  # louder sensors
            standing.clear()
        standing += [row for row in doubted if lack.ratios.get(row, 1.0) > 1.0 and row not in standing]
        inexact = {row: sum(law.row_force.get(row, 0.0) for law in laws) for row in standing}
        small = [
            row for row in standing
            if row not in doubted and (
                forces[row][0] < SELECTION.effect_size * forces[row][1]
                or lack.squares[row] < SELECTION.law_inexactness**2 * inexact[row]
            )
        ]  # fmt: skip
        unlisted = sorted((row for row in standing if row not in small), key=lambda row: -lack.ratios[row])
        return cls(lack, space.tolerance_use(), forces, tuple(unlisted), tuple(small), doubted)

    def without_unlisted(self) -> list[Row]:
        """Rows in which the model holds: all but the unlisted ones.

        Forces on the body act in all its rows: none of these holds when one is unlisted.
        """
        body = any(row.kind == "chassis" for row in self.unlisted)
        return [row for row in self.lack.ratios if row not in self.unlisted and not (body and row.kind == "chassis")]

    def of_other_kinds(self) -> list[Row]:
        """Rows of other kinds (chassis, suspension, tyre, spin) than that in which most is unlisted; none without."""
        most = dict[str, float]()
        for row in self.unlisted:
            most[row.kind] = most.get(row.kind, 0.0) + self.lack.excess([row])
        worst = max(most, key=lambda kind: most[kind], default=None)
        return [] if worst is None else [row for row in self.lack.ratios if row.kind != worst]

    @property
    def excess(self) -> float:
        """Weighted squares above the floor in the unlisted rows."""
        return self.lack.excess(self.unlisted)

    def beside(self, law: AddedLaw) -> float:
        """Weighted squares above the floor in the unlisted rows, each by the law's force in it ÷ that in its main row.

        A sensor's fault changes most rows a little, and has its force in a few. One that has it in the body's looks
        like a force that goes with the body's motion: an unknown one, which acts in all these rows, may be its cause,
        and none of them holds when one is unlisted.
        """
        most = max(law.row_force.values(), default=0.0)
        if most <= 0.0:
            return 0.0
        whole: list[Row] = []
        if law.sheet_entries and max(law.row_force, key=lambda row: law.row_force[row]).kind == "chassis":
            holding = self.without_unlisted()
            whole = [row for row in self.lack.ratios if row.kind == "chassis" and row not in holding]
        shares = {row: 1.0 if row in whole else law.row_force.get(row, 0.0) / most for row in (*self.unlisted, *whole)}
        return sum(self.lack.excess([row]) * share for row, share in shares.items())
