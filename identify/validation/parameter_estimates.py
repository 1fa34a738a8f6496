"""Parameter estimates of a fit: value, unit, 95 % interval, and the reason where a parameter is not identified."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lacet.daq.channels import CHANNELS
from lacet.identify.car.car_tree import CHASSIS
from lacet.identify.car.rows import SPRUNG_MASS, Absence, Row, RowAbsence
from lacet.identify.car.sources.nominal_load import given_parameters
from lacet.identify.effects.base import Effect, columns_by_row
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sums.linear_fit import FittedModel
from lacet.identify.signals.sources import Kind


@dataclass(frozen=True)
class HardlyKnown:
    """The 95 % interval ± `half` [`unit`] is hardly narrower than the plausible range.

    `shown_by` : a run that narrows it.
    """

    half: float
    unit: str
    shown_by: str


@dataclass(frozen=True)
class WiderThanValue:
    """The 95 % interval ± `half` [`unit`] is wider than the value; `shown_by` : a run that narrows it."""

    half: float
    unit: str
    shown_by: str


@dataclass(frozen=True)
class NoDependence:
    """No measured quantity of the runs depends on the parameter; `shown_by` : a run that makes it do so."""

    shown_by: str


@dataclass(frozen=True)
class RowsAbsent:
    """Every row that the parameter acts on is absent from every run.

    Attributes
    ----------
    row : the first of those rows; `others` : whether there are more.
    absence : why it is absent; None where it has no usable sample.
    """

    row: Row
    others: bool
    absence: RowAbsence | None


@dataclass(frozen=True)
class SeenAside:
    """The runs show the parameter only aside, in rows of the body: its own row is absent.

    Attributes
    ----------
    half : half of the 95 % interval with the sensor sheet [`unit`], wider than `WIDE` of the value.
    row : the absent row in which it acts most; None where no run is at hand that would show it.
    absence : why that row is absent; None where it has no usable sample.
    """

    half: float
    unit: str
    row: Row | None
    absence: RowAbsence | None


@dataclass(frozen=True)
class GivenBeforehand:
    """The parameter is given as `assumption`: no wheel load is measured."""

    assumption: str


@dataclass(frozen=True)
class AssumedMotion:
    """The parameter acts by roll and pitch of the body alone, which no run measures: they are assumed."""


@dataclass(frozen=True)
class CountedWith:
    """The parameter acts only in combination with others; `names` are those that hold the combination's value."""

    names: tuple[str, ...]


Unidentified = (
    HardlyKnown | WiderThanValue | NoDependence | RowsAbsent | SeenAside | GivenBeforehand | AssumedMotion | CountedWith
)
"""Reason why a parameter is not identified."""


@dataclass(frozen=True)
class Estimate:
    """The estimate of one parameter.

    `half` is half of the 95 % interval from residuals correlated in time and across rows (noise and zeros), and from
    what is not known of a law's shape constants; `half_sheet` the same with what the sensor sheet's gains and latencies
    may add; `half_bootstrap` from blocks of the runs drawn again, NaN where none were; `sxr` the paper's
    relative standard deviation, 100 σ/|value| as if residuals were independent [%]; `group` the combination the value
    stands for; `why` the reason where it is not `identifiable`, else None.
    """

    name: str
    effect: str
    value: float
    unit: str
    half: float
    half_sheet: float
    half_bootstrap: float
    sxr: float
    group: str
    why: Unidentified | None

    @property
    def identifiable(self) -> bool:
        """Whether the runs determine the parameter, alone or as the head of a group."""
        return self.why is None


WIDE = 0.25
"""Half of the 95 % interval ÷ value above which a value is not determined [ratio]: of a derived value, and of a
parameter that rows of the body alone show. Source: a choice; docs/derived.md."""
_WIDE = 0.5
"""Posterior σ ÷ prior σ from which a parameter is not identified: the runs add next to nothing."""


def estimates(fitted: FittedModel, drawn: Array | None = None, runs: Sequence[PreparedRun] = ()) -> list[Estimate]:
    """The estimates of all parameters of a fitted model, those that are not identified included.

    `drawn` : (draws, p) from `Fit.bootstrap`; `runs` : those used, to find rows that all of them lack (`RowsAbsent`).
    """
    out: list[Estimate] = []
    place = {int(i): k for k, i in enumerate(fitted.base.independent)}
    sigma = np.sqrt(np.maximum(0.0, np.diag(fitted.covariance)))
    plain = np.sqrt(np.maximum(0.0, np.diag(fitted.covariance_iid)))
    searched, sheet = fitted.covariances_searched
    half = TWO_SIDED_95 * np.sqrt(np.maximum(0.0, np.diag(searched)))
    half_sheet = TWO_SIDED_95 * np.sqrt(np.maximum(0.0, np.diag(searched + sheet)))
    blocks = np.full(len(sigma), np.nan)
    if drawn is not None:
        blocks = 0.5 * np.asarray(np.ptp(np.percentile(drawn, (2.5, 97.5), axis=0), axis=0), float)
    owners = [effect for effect in (*fitted.model.physics, *fitted.model.faults) for _ in effect.parameters]
    physics = len(fitted.physics)
    by_body = any(row.combined for row in fitted.sigma)
    unmoved = by_assumed_motion(runs)
    for i, (parameter, effect) in enumerate(zip(fitted.model.parameters, owners, strict=True)):
        value = float(fitted.theta[i])
        group, why = parameter.name, None
        if i in place:
            group = fitted.base.describe(place[i])
            if parameter.name in unmoved:
                why = AssumedMotion()
            elif plain[i] > _WIDE * parameter.prior:
                why = HardlyKnown(TWO_SIDED_95 * float(plain[i]), parameter.unit, shown_by(parameter.name, effect))
            else:
                wide = TWO_SIDED_95 * sigma[i] > max(abs(value), _natural(fitted, parameter.name))
                aside = by_body and half_sheet[i] > WIDE * max(abs(value), _usual(fitted, parameter.name, runs))
                own = [q.name for q in effect.parameters].index(parameter.name)
                row, absence = _own_row(runs, effect, own) if aside or wide else (None, None)
                if wide and row is None:
                    width = TWO_SIDED_95 * float(sigma[i])
                    why = WiderThanValue(width, parameter.unit, shown_by(parameter.name, effect))
                elif aside or wide:
                    why = SeenAside(float(half_sheet[i]), parameter.unit, row, absence)
        elif i < physics:
            why = _grouped(fitted, i, effect, runs)
        out.append(
            Estimate(
                name=parameter.name,
                effect=effect.key,
                value=value,
                unit=parameter.unit,
                half=float(half[i]),
                half_sheet=float(half_sheet[i]),
                half_bootstrap=float(blocks[i]),
                sxr=100.0 * float(plain[i]) / abs(value) if value else float("inf"),
                group=group,
                why=why,
            )
        )
    return out


_BY_ROLL_AND_PITCH = frozenset(f"{kind}{CHASSIS}" for kind in ("XX", "XY", "XZ", "YY", "YZ", "MZ"))


def by_assumed_motion(runs: Sequence[PreparedRun]) -> frozenset[str]:
    """Parameters of the body that act by roll and pitch rates alone, where every run assumes these; else none.

    With the rates their columns are assumed, to a half: so is the estimate, whatever its interval.
    """
    sources = [run.recording.sources.get("imu.rate") for run in runs]
    assumed = [one is not None and Kind.ASSUMED in (one.kinds[0], one.kinds[1]) for one in sources]
    return _BY_ROLL_AND_PITCH if assumed and all(assumed) else frozenset()


def shown_by(name: str, effect: Effect) -> str:
    """The run that excites a parameter of an effect, in words."""
    return effect.parameters_shown_by.get(name, effect.shown_by)


def _grouped(fitted: FittedModel, i: int, effect: Effect, runs: Sequence[PreparedRun]) -> Unidentified:
    """Reason why a parameter of a group has no value of its own."""
    name = fitted.model.names[i]
    if i in fitted.base.absent and (given := _given(name, runs)):
        return GivenBeforehand(given)
    if i in fitted.base.absent:
        own = [q.name for q in effect.parameters].index(name)
        return rows_absent(runs, effect, own) or NoDependence(shown_by(name, effect))
    column = int(np.flatnonzero(fitted.base.dependent == i)[0])
    holders = [fitted.model.names[int(k)] for k in fitted.base.independent[fitted.base.relations[:, column] != 0.0]]
    return CountedWith(tuple(holders))


def _given(name: str, runs: Sequence[PreparedRun]) -> str:
    """Assumption that gives a parameter where no wheel load is measured; empty without one."""
    if not runs:
        return ""
    return given_parameters(runs[0].recording).get(name, "")


def rows_absent(runs: Sequence[PreparedRun], effect: Effect, own: int | None = None) -> RowsAbsent | None:
    """The reason when every row that an effect acts on is absent from every run, not for the manoeuvre; else None.

    `own` : place of one of its parameters, which alone is asked for.
    """
    reasons: dict[Row, RowAbsence | None] = {}
    physics = effect.shapes()[0].as_physics
    if physics is None or not runs:
        return None
    for run in runs:
        columns = columns_by_row(physics, run.kept_motion)
        rows = tuple(row for row, table in columns.items() if np.any(table if own is None else table[own]))
        if not rows or any(row in run.rows for row in rows):
            return None
        reasons |= {row: run.measured_rows.left_out.get(row) for row in rows}
    others = len(reasons) > 1
    # Without wheel loads a tyre acts in the row of its corner too, which needs less.
    left_out = runs[0].measured_rows.left_out
    corners = [row for c in effect.corners() if (row := Row(f"corner.{c}")) in left_out]
    reasons |= {row: left_out[row] for row in corners if any(one.kind == "tyre" for one in reasons)}
    row = min(reasons, key=lambda one: _lacks(reasons[one]))
    return RowsAbsent(row, others, reasons[row])


def _lacks(absence: RowAbsence | None) -> int:
    """Number of channels that an absent row lacks; a row that lacks something else comes last."""
    return len(absence.channels) if absence and absence.cause is Absence.CHANNELS else len(CHANNELS)


def _own_row(runs: Sequence[PreparedRun], effect: Effect, parameter: int) -> tuple[Row | None, RowAbsence | None]:
    """The absent row in which a parameter of an effect acts most, and why it is absent; None where there is no such.

    It must act in it more than in any row that is formed and no combination of others.
    """
    physics, energy = effect.as_physics, dict[Row, float]()
    if physics is None:
        return None, None
    for run in runs:
        for row, columns in columns_by_row(physics, run.kept_motion).items():
            energy[row] = energy.get(row, 0.0) + float(np.sum(columns[parameter] ** 2))
    present = {row for run in runs for row in run.rows}
    absent = {row: e for row, e in energy.items() if row not in present}
    formed = [e for row, e in energy.items() if row in present and not row.combined]
    if not absent or max(absent.values()) <= max(formed, default=0.0):
        return None, None
    row = max(absent, key=lambda one: absent[one])
    return row, runs[0].measured_rows.left_out.get(row)


def _usual(fitted: FittedModel, name: str, runs: Sequence[PreparedRun]) -> float:
    """Size with which the interval of a parameter is compared where rows of the body show it, if it is smaller itself.

    As `_natural`, with the mass that the fit was given; a static offset's is a tenth of the largest, as groups of them
    may be differences.
    """
    if name.startswith("offset."):
        offsets = [float(abs(v)) for n, v in zip(fitted.model.names, fitted.theta, strict=True) if n[:7] == name[:7]]
        return 0.1 * max(offsets)
    given = runs[0].recording.assumptions.get(SPRUNG_MASS) if runs else None
    first = name in ("MX6", "MY6", "MZ6") and given is not None
    return 0.05 * given.value if first and given is not None else _natural(fitted, name)


def _natural(fitted: FittedModel, name: str) -> float:
    """Size below which a body's product of inertia or first moment counts as zero."""
    kind, number = name.rstrip("0123456789"), name[len(name.rstrip("0123456789")) :]
    names = fitted.model.names
    if kind in ("XY", "XZ", "YZ"):
        diagonal = [fitted.theta[names.index(f"{d}{number}")] for d in ("XX", "YY", "ZZ") if f"{d}{number}" in names]
        return 0.1 * float(np.max(np.abs(diagonal), initial=0.0))
    if kind in ("MX", "MY", "MZ") and f"M{number}" in names:
        return 0.05 * abs(float(fitted.theta[names.index(f"M{number}")]))
    return 0.0
