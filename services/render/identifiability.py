"""Identifiability in words: why a parameter or a derived value is not determined, and which run would determine it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from lacet.daq.channels import CORNERS
from lacet.identify.effects.base import AXLES
from lacet.identify.properties.derived import ImpossibleCar, RowMissing
from lacet.identify.properties.structural_identifiability import Fixed, HeldTogether, JointPosition, RowsNotFormed
from lacet.identify.regression.identifiability import Combination, Merged, SmallChange, SmallTravel, Undetermined
from lacet.identify.validation.parameter_estimates import (
    WIDE,
    AssumedMotion,
    CountedWith,
    GivenBeforehand,
    HardlyKnown,
    NoDependence,
    RowsAbsent,
    SeenAside,
    Unidentified,
    WiderThanValue,
)
from lacet.identify.validation.prediction_uncertainty import OpenParameters
from lacet.identify.validation.score import Comparison
from lacet.services.render.intervals import half_width
from lacet.services.render.row_needs import any_corner, explained, to_add
from lacet.services.render.tables import wrapped

_SHOWS = "what shows it: "
_MOST_SHARES = 6
_FIXED = {
    Fixed.FREE: "left free: no row is about the ground's axes",
    Fixed.NO_KINGPIN: "stays 0: no caster, no inclination",
    Fixed.NO_TABLE: "stays at design: no bench table",
}


def listed(words: Sequence[str]) -> str:
    """One or more words, the last after an ``and``."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def unidentified(why: Unidentified | None) -> str:
    """Why a parameter is not identified; an empty string where it is."""
    match why:
        case None:
            return ""
        case HardlyKnown(half, unit, shown_by):
            return (
                f"the runs leave ± {half_width(half)} {unit}, hardly less than its plausible range; {_SHOWS}{shown_by}"
            )
        case WiderThanValue(half, unit, shown_by):
            return f"its 95 % interval (± {half_width(half)} {unit}) is wider than the value; {_SHOWS}{shown_by}"
        case NoDependence(shown_by):
            return f"nothing these runs measure depends on it; {_SHOWS}{shown_by}"
        case RowsAbsent(row, others, absence):
            return f"{row}{' and others' if others else ''} left out: {to_add(row, absence)}"
        case SeenAside(half, unit, row, absence):
            wide = f"its 95 % interval with sheet (± {half_width(half)} {unit}) is wider than {100 * WIDE:.0f} % of it"
            return wide if row is None else f"{wide}: {row} would show it, and {to_add(row, absence)}"
        case GivenBeforehand(assumption):
            return f"given as {assumption} in [assumed]: no wheel load is measured"
        case AssumedMotion():
            return "it acts by roll and pitch of the body alone, which are assumed; needs: imu.rate"
        case CountedWith(names):
            return f"acts only together with {', '.join(names[:4])}, and is counted there"


def open_direction(found: Undetermined | Combination | Merged) -> str:
    """A direction that the equations of a fit merge or do not determine, and the quantities that hardly vary."""
    match found:
        case Undetermined(names, why):
            text = f"{listed(names)} {'is' if len(names) == 1 else 'are'} not determined"
        case Combination(shares, why):
            more = f" and {len(shares) - _MOST_SHARES} more" if len(shares) > _MOST_SHARES else ""
            some = listed([f"{name} ({round(share)} %)" for name, share in shares[:_MOST_SHARES]])
            text = f"{some}{more} cannot be told apart"
        case Merged(name, holders, why):
            text = f"{name} cannot be told from {listed(holders)}"
    return text + _weakness(why)


def _weakness(why: SmallTravel | SmallChange | None) -> str:
    """The quantity that hardly varies, after a colon."""
    match why:
        case None:
            return ""
        case SmallTravel(corners, travel, rate):
            return f": travel at {', '.join(corners)} moves by ± {_milli(travel)} mm, at ± {_milli(rate)} mm/s"
        case SmallChange(row, size, single):
            if row is None:
                return ": nothing these runs measure changes with it"
            who = "it changes" if single else "one of them changes"
            return f": at its largest plausible value {who} {row} by ± {size:.2g} {row.unit}, and no row more"


def _milli(metres: float) -> str:
    """Thousandths to two digits; values below a tenth of a millionth count as rounding errors."""
    return f"{1e3 * metres:.2g}" if metres >= 1e-7 else "0"


def open_parameters(why: OpenParameters | None) -> str:
    """Parameters that the runs used do not determine, and the runs that excite them; an empty string without any."""
    if why is None:
        return ""
    if not why.names:
        return "many parameters, each known a little too loosely"
    them = "it" if len(why.names) == 1 else "them"
    runs = "; ".join(why.shown_by)
    return f"{listed(why.names)} not determined well enough by the runs used; what shows {them}: {runs}"


def rows_not_judged(comparison: Comparison) -> list[str]:
    """A sentence for each row whose error the parameters' uncertainty explains, those of one reason together."""
    alike: dict[str, list[str]] = {}
    for row, score in comparison.scores.items():
        if not score.judged:
            alike.setdefault(open_parameters(score.why), []).append(row)
    return [f"{', '.join(rows)} of run {comparison.name} cannot be judged: {why}" for why, rows in alike.items()]


def not_derived(why: OpenParameters | RowMissing | ImpossibleCar | None) -> str:
    """Why a derived value is not determined; an empty string where it is."""
    match why:
        case RowMissing(row, absence):
            return f"{row} {to_add(row, absence)}"
        case ImpossibleCar():
            return "the masses, inertias and stiffnesses found do not make such a car (one of them is not above zero)"
        case _:
            return open_parameters(why)


def not_derived_lines(result: Mapping[str, Any]) -> list[str]:
    """Derived values of a result that are not determined, those of one reason in one line.

    A kind of which the same reason holds for every corner or axle is named once. A fit without suspension rows has
    none at all, and says what these need.
    """
    values = result.get("derived") or []
    reasons: dict[str, dict[str, str]] = {}
    for d in values:
        whole, _, place = d["name"].rpartition(".")
        kind = whole if place in _PLACES else d["name"]
        reason = "" if d["identifiable"] else any_corner(d["why"].partition(" ")[0], d["why"])
        reasons.setdefault(kind, {})[d["name"]] = reason
    alike: dict[str, list[str]] = {}
    for kind, found in reasons.items():
        one = next(iter(found.values())) if len({*found.values()}) == 1 else None
        for name, reason in {kind: one}.items() if one is not None else found.items():
            if reason:
                alike.setdefault(reason, []).append(name)
    if not any(".sum." not in d["name"] for d in values):
        for source in result["row_sources"]:
            if source["row"].startswith("suspension.") and source["add"]:
                why = any_corner(source["row"], f"{source['row']} {source['add']}")
                alike.setdefault(why, ["all others" if values else "all"])
    return explained([wrapped(f"  {', '.join(names)}: {why}", 4) for why, names in alike.items()])


_PLACES = (*CORNERS, *AXLES)
"""Ends of names of values that are of a corner or an axle."""


def structurally(why: RowsNotFormed | HeldTogether | None) -> str:
    """Why no row determines a parameter, whatever the run; an empty string where one does."""
    match why:
        case None:
            return ""
        case RowsNotFormed(kind):
            rows = f"its {kind} row is not formed" if kind else "the rows it acts on are not formed"
            return f"no row depends on it: {rows}"
        case HeldTogether(names):
            some = ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")
            return f"every row holds it only together with {some}, and it is counted there"


def joint_position(found: JointPosition) -> str:
    """The source of a joint's position."""
    if found.fixed is not None:
        return _FIXED[found.fixed]
    table = f"bench table {found.table}" if found.table else ""
    if not found.channels:
        return table
    channels = ", ".join(found.channels)
    if found.geometry:
        return f"{channels}, caster and kingpin inclination"
    if found.wheel is not None:
        driven, brakes = found.wheel
        return f"{channels} ({'driven' if driven else 'free'}, {brakes} brakes)"
    return f"{channels} (slope: {table})" if table else channels
