"""Proposal of a channel map from a log's names, units and the car's behaviour, with a probability for each column.

A column's probability is that of its quantity (words, unit, size) times that of its sign. What two names claim alike is
claimed by none for sure. How often proposals are right is measured by the tests, on logs they were not made with.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lacet.daq.channels import COLUMNS
from lacet.daq.maps.axes import by_others, of_one_kind
from lacet.daq.maps.behaviour import ANGLES, RATE, Car, on_grid
from lacet.daq.maps.channel_map import FORMAT
from lacet.daq.maps.name_units import unit_at_end
from lacet.daq.maps.names import written_name
from lacet.daq.maps.quaternions import attitudes
from lacet.daq.maps.resolution import ALONE
from lacet.daq.maps.words import Meaning, meanings, words_of
from lacet.daq.sources.source import Array, Listed, Series, Source, names_of_all
from lacet.daq.units import UnitFault, read_unit

ACCEPTED = 0.9
"""Probability from which a proposal is used without being accepted by the user."""
LONGEST = 120.0
"""Length of a log that is looked at [s]."""
_SIZES: dict[str, tuple[float, float, tuple[str, ...]]] = {
    # family and component: plausible 95th percentile of the size, SI; units that are tried where the file says none
    "imu.accel.z": (9.0, 14.0, ("m/s²", "g")), "imu.accel": (0.4, 20.0, ("m/s²", "g")),
    "imu.rate": (0.01, 2.5, ("rad/s", "deg/s")), "imu.attitude": (0.004, 0.4, ("rad", "deg")),
    "wheel.force.z": (800.0, 15e3, ("N", "kN", "daN")), "wheel.force": (60.0, 12e3, ("N", "kN", "daN")),
    "wheel.moment": (8.0, 4e3, ("N·m", "kN·m")), "wheel.speed": (4.0, 250.0, ("rad/s", "1/min")),
    "suspension.travel": (0.002, 0.15, ("m", "mm")), "damper.travel": (0.002, 0.15, ("m", "mm")),
    "wheel.angle": (60.0, np.inf, ("rad", "deg")), "laser.hub": (0.05, 0.9, ("m", "mm")),
    "laser.ground": (0.1, 1.5, ("m", "mm")), "camera.steer": (0.004, 0.7, ("rad", "deg")),
    "camera.camber": (0.001, 0.12, ("rad", "deg")), "steering.angle": (0.03, 12.0, ("rad", "deg")),
    "correvit.speed.x": (3.0, 90.0, ("m/s", "km/h")), "car.speed": (3.0, 90.0, ("m/s", "km/h")),
    "gnss.speed": (3.0, 90.0, ("m/s", "km/h")), "brake.pressure": (2e5, 3e7, ("bar", "Pa")),
    "engine.speed": (60.0, 900.0, ("rad/s", "1/min")), "engine.throttle": (0.02, 1.0, ("-", "%")),
}  # fmt: skip
_NO_UNIT_SURE, _NO_UNIT_OPEN, _UNKNOWN_UNIT = 0.94, 0.6, 0.5
_UNSEEN_SIGN = 0.8
"""Probability that a sign whose test the log does not allow is the vocabulary's."""
_STILL = 0.8
"""Factor for a name whose values stand still: it could be anything."""
_QUATERNION = 0.95
"""Probability that the angles of a measured orientation are the car's attitude."""
_LIKELY = 0.5
"""Probability of a name that moves from which names that stand still do not claim the same column."""
_TYRE_RADIUS = "0.31 m"
_RUN = (
    "# What a log does not say; remove the # where it applies:",
    "# [run]",
    '# vehicle = "vehicle.toml"',
    '# rig = "rig.toml"',
    '# wheel_reference = "hub"  # or "contact"',
    '# brakes = "off"  # nobody braked in this run',
)
"""Comments of a proposed map: the keys that no log holds."""


@dataclass(frozen=True)
class Guess:
    """A name of a log, and what it could be.

    Attributes
    ----------
    name, unit : as in the log.
    rate : samples a second; `low`, `high` : range, in the log's unit; NaN without samples.
    column, expression : the proposal; empty for none. `said_unit` : unit that it takes, where the log says none.
    probability : that column, unit and sign are right.
    own_zero : whether the expression counts a travel from the log's median, as the log's zero is none of a car's.
    """

    name: str
    unit: str
    rate: float
    low: float
    high: float
    column: str = ""
    expression: str = ""
    said_unit: str = ""
    probability: float = 0.0
    own_zero: bool = False


def guess(*sources: Source) -> list[Guess]:
    """Every name of the logs of one drive with what it could be, in their order.

    Raises RunError where one cannot be read.
    """
    places = names_of_all(sources)
    listed = {name: sources[at].listed[there] for name, (at, there) in places.items()}
    series = _read(sources, places)
    out = {name: _described(name, one.unit, series.get(name)) for name, one in listed.items()}
    claims: dict[str, list[tuple[float, Guess, Meaning]]] = {}
    for name, about in out.items():
        one = series.get(name)
        if one is None or not len(one.t):
            continue
        found, meaning = max(
            _possible(about, listed[name], one), key=lambda claim: claim[0].probability, default=(about, None)
        )
        if meaning is not None and found.probability > 0.0:
            claims.setdefault(found.column, []).append((found.probability, found, meaning))
    _heading_of_unit(claims)
    angles = attitudes(listed, series)
    for name, (column, expression, _) in angles.items():
        found = replace(out[name], column=column, expression=expression, probability=_QUATERNION)
        claims.setdefault(column, []).append((_QUATERNION, found, Meaning(column, _QUATERNION)))
    chosen: dict[str, tuple[Guess, Meaning]] = {}
    for column, several in claims.items():
        several.sort(key=lambda claim: -claim[0])
        moving = [claim for claim in several if claim[1].low < claim[1].high]
        if moving and moving[0][0] >= _LIKELY:
            several = moving  # what stands still is no rival of it
        best, rival = several[0], several[1][0] if len(several) > 1 else 0.0
        share = best[0] / (best[0] + rival) if rival > 0.5 * best[0] else 1.0
        chosen[column] = (replace(best[1], probability=best[0] * share), best[2])
    signed = _signed(chosen, series | {name: made for name, (_, _, made) in angles.items()})
    for column, proposal in signed.items():
        out[proposal.name] = replace(proposal, column=column)
    return list(out.values())


def _heading_of_unit(claims: dict[str, list[tuple[float, Guess, Meaning]]]) -> None:
    """Take a heading with the name of a roll and a pitch angle for the third angle of their attitude, no course."""
    if "imu.attitude.yaw" in claims:
        return
    beside = [
        {_beside(one.name, angle) for _, one, _ in claims.get(column, ())}
        for column, angle in (("gnss.course", "course"), ("imu.attitude.roll", "roll"), ("imu.attitude.pitch", "pitch"))
    ]
    if common := set[tuple[str, ...]].intersection(*beside):
        yaw, courses = "imu.attitude.yaw", claims.pop("gnss.course")
        for probability, one, meaning in courses:
            if _beside(one.name, "course") in common:
                claim = probability, replace(one, column=yaw), replace(meaning, column=yaw, signed=True)
            else:
                claim = probability, one, meaning
            claims.setdefault(claim[1].column, []).append(claim)


def _beside(name: str, word: str) -> tuple[str, ...]:
    """The words of a name without one of them."""
    return tuple(other for other in words_of(name)[0] if other != word)


def map_text(guesses: Sequence[Guess], file: str, accept: bool = False) -> str:
    """The text of the map: what is probable enough, or all with `accept`; the rest as comments."""
    proposed = sorted((g for g in guesses if g.column), key=lambda g: list(COLUMNS).index(g.column))
    used = [g for g in proposed if accept or g.probability >= ACCEPTED]
    columns = {g.column for g in proposed}
    units = [f'{_key(g.name)} = "{g.said_unit}"' for g in proposed if g.said_unit]
    lines = [f'format = "{FORMAT}"', f"# proposed from {file}: look through it, signs first", "", *_RUN]
    if units:
        lines += ["", "[sources]  # the file has no unit for these", *units]
    lines += ["", "[channels]"]
    for g in proposed:
        comment = "" if g in used else "# "
        zero = "; counted from this log's median: better from the reading at design height" if g.own_zero else ""
        entry = f'"{_alone(g.column, columns)}" = "{g.expression}"'
        lines.append(f"{comment}{entry}  # probability {g.probability:.2f}{zero}")
    without = [g.name for g in guesses if not g.column]
    if without:
        lines += ["", "# without a proposal: " + ", ".join(without)]
    return "\n".join(lines) + "\n"


def _alone(column: str, beside: set[str]) -> str:
    """The channel that a single component has for itself, where the others of its channel are not `beside` it."""
    complete = set(COLUMNS[column][0].columns) <= beside
    return column if complete else ALONE.get(column, column)


def _key(name: str) -> str:
    return '"' + name.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _read(sources: Sequence[Source], places: Mapping[str, tuple[int, str]]) -> dict[str, Series]:
    """The first seconds of every name, on one clock where every log says when it began."""
    names = {place: name for name, place in places.items()}
    starts = [source.start_ns for source in sources]
    first = min((start for start in starts if start is not None), default=0)
    absolute = None not in starts
    out: dict[str, Series] = {}
    for at, (source, start) in enumerate(zip(sources, starts, strict=True)):
        offset = ((start or 0) - first) / 1e9 if absolute else 0.0
        out |= {names[at, there]: Series(one.t + offset, one.values) for there, one in _beginning(source).items()}
    return out


def _beginning(source: Source) -> dict[str, Series]:
    """The first seconds of every name of a log."""
    parts: dict[str, list[Series]] = {}
    begin = np.inf
    for piece in source.pieces(list(source.listed)):
        for name, one in piece.items():
            if len(one.t):
                parts.setdefault(name, []).append(one)
                begin = min(begin, float(one.t[0]))
        if any(float(one.t[-1]) - begin > LONGEST for one in piece.values() if len(one.t)):
            break
    return {
        name: Series(np.concatenate([one.t for one in some]), np.concatenate([one.values for one in some]))
        for name, some in parts.items()
    }


def _described(name: str, unit: str, series: Series | None) -> Guess:
    if series is None or not np.isfinite(series.values).any():
        return Guess(name, unit, 0.0, np.nan, np.nan)
    span = float(series.t[-1]) - float(series.t[0])
    rate = (len(series.t) - 1) / span if span > 0.0 else 0.0
    return Guess(name, unit, rate, float(np.nanmin(series.values)), float(np.nanmax(series.values)))


def _possible(about: Guess, listed: Listed, series: Series) -> list[tuple[Guess, Meaning]]:
    """What a name could mean; one without a unit in the log also without the unit that it may end in."""
    named = None if about.unit or listed.units else unit_at_end(about.name)
    if named is not None:
        pairs = [(_quantity(about, meaning, series, named[1]), meaning) for meaning in meanings(named[0])]
        if fitting := [pair for pair in pairs if pair[0].probability > 0.0]:
            return fitting
    return [
        (_quantity(about, meaning, series, unit), meaning)
        for meaning in meanings(about.name, listed.quantity)
        for unit in listed.units or (about.unit,)
    ]


def _quantity(about: Guess, meaning: Meaning, series: Series, stated: str) -> Guess:
    """The guess in the unit `stated`, or in the one that fits, and the probability of the quantity, 0 if impossible."""
    channel, component = COLUMNS[meaning.column]
    part = f".{channel.components[component]}" if channel.components else ""
    low, high, tried = _SIZES.get(channel.family + part, _SIZES.get(channel.family, (0.0, np.inf, (channel.unit,))))
    size = float(np.nanpercentile(np.abs(series.values), 95)) if np.isfinite(series.values).any() else 0.0
    written = written_name(about.name)
    probability, expression, said = meaning.words, written, "" if about.unit else stated
    try:
        unit = read_unit(stated) if stated else None
    except UnitFault:
        unit, probability = None, probability * _UNKNOWN_UNIT
    if unit is not None:
        if channel.family == "wheel.speed" and unit.dimension == read_unit("m/s").dimension:
            expression, probability = f"{written} / {_TYRE_RADIUS}", probability * 0.5
        elif not unit.fits(channel.unit):
            return replace(about, column=meaning.column, probability=0.0)
        elif not 0.05 * low <= unit.factor * size <= 20.0 * high:
            probability *= 0.7
    elif meaning.by_unit:
        return replace(about, column=meaning.column, probability=0.0)
    else:
        fitting = [one for one in tried if low <= read_unit(one).factor * size <= high]
        said = fitting[0] if fitting else tried[0]
        probability *= _NO_UNIT_SURE if len(fitting) == 1 else _NO_UNIT_OPEN
    if float(np.nanstd(series.values)) == 0.0:
        probability *= _STILL
    return replace(
        about, column=meaning.column, expression=expression, said_unit=said, probability=probability
    )  # fmt: skip


def _signed(
    chosen: Mapping[str, tuple[Guess, Meaning]], series: Mapping[str, Series]
) -> dict[str, Guess]:  # fmt: skip
    """The proposals with their signs, judged by all of them together."""
    begin = max((float(series[g.name].t[0]) for g, _ in chosen.values()), default=0.0)
    end = min((float(series[g.name].t[-1]) for g, _ in chosen.values()), default=0.0)
    length = min(end - begin, LONGEST)  # also where the times of a log jump by years, or are none
    grid = begin + np.arange(int(length * RATE) + 1 if length > 0.0 else 0) / RATE
    columns: dict[str, Array] = {}
    for column, (one, _) in chosen.items():
        unit = read_unit(one.said_unit or one.unit) if one.said_unit or one.unit else None
        factor = unit.factor if unit else 1.0
        values = factor * series[one.name].values
        columns[column] = on_grid(series[one.name].t, _unwrapped(values) if column in ANGLES else values, grid)
    car = Car(columns)
    names = {column: one.name for column, (one, _) in chosen.items()}
    if len(grid) > 3:
        car.find_signs()
        car.signs = of_one_kind(car.signs, names)
    out: dict[str, Guess] = {}
    for column, (one, meaning) in chosen.items():
        sign, sure = car.signs.get(column, (1, 0.0))
        if not meaning.signed and column not in car.signs:
            values = series[one.name].values
            mean = float(np.nanmean(values)) if np.isfinite(values).any() else 0.0
            sign, sure = (-1, 0.85) if column.endswith(".speed") and mean < 0.0 else (1, 0.99)
        if sure < _UNSEEN_SIGN and meaning.signed:
            sign, sure = _unseen(column, car, names)
        out[column] = replace(
            _from_zero(one, column, series[one.name].values, sign), probability=one.probability * max(sure, 0.5)
        )
    return out


def _from_zero(one: Guess, column: str, values: Array, sign: int) -> Guess:
    """The proposal with its sign, and with a zero in the middle of the log where a travel is far from any."""
    signed = one.expression if sign > 0 else f"-{one.expression}"
    if COLUMNS[column][0].family not in ("suspension.travel", "damper.travel"):
        return replace(one, expression=signed)
    middle, unit = float(np.nanmedian(values)), one.said_unit or one.unit
    if not unit or abs(middle) <= one.high - one.low:
        return replace(one, expression=signed)
    zero = f"{middle:.4g} {unit}"
    return replace(
        one, expression=f"{one.expression} - {zero}" if sign > 0 else f"{zero} - {one.expression}", own_zero=True
    )


def _unseen(column: str, car: Car, names: Mapping[str, str]) -> tuple[int, float]:
    """The sign, with its certainty, of a column that the drive does not show: the others', else the vocabulary's."""
    rate = ANGLES.get(column, "")
    if column in car.related:
        relation, sure = car.related[column]
        sign, known = by_others(rate, car.signs, names) or (1, _UNSEEN_SIGN)
        return relation * sign, sure * known
    return by_others(column, car.signs, names) or (1, _UNSEEN_SIGN)


def _unwrapped(angles: Array) -> Array:
    """Angles without the steps of whole turns [rad]; NaN stays."""
    out, good = angles.copy(), np.isfinite(angles)
    out[good] = np.unwrap(angles[good])
    return out
