"""Names of a map found among those of a log, with units checked: which series each channel is made of."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple

from lacet.daq.channels import CHANNELS, COLUMNS, Channel
from lacet.daq.expressions.expression import ExpressionFault
from lacet.daq.maps.channel_map import ChannelMap, Mapped
from lacet.daq.maps.names import marked, written_name
from lacet.daq.sources.source import Array, resolve
from lacet.daq.units import Unit, UnitFault, read_unit


class Key(NamedTuple):
    """A series as an expression takes it: its name in the log, its unit, the delay and its growth that are removed."""

    name: str
    unit: str
    delay: float
    drift: float = 0.0


class Recipe(NamedTuple):
    """How a channel is made: each component's entry of the map, and for each, name in its expression → series."""

    channel: Channel
    columns: Sequence[Mapped]
    keys: Sequence[Mapping[str, Key]]


@dataclass
class Resolution:
    """The channels of a map that a log can provide.

    `recipes` : of the channels that can. `lacking` : channel that cannot → why. `without_unit` : names taken as SI.
    """

    recipes: list[Recipe] = field(default_factory=list)
    lacking: dict[str, str] = field(default_factory=dict)
    without_unit: list[str] = field(default_factory=list)


def resolved(
    map_: ChannelMap, units: Mapping[str, str], in_full: Mapping[str, str] = MappingProxyType({}),
    unseen: Collection[str] = (),
) -> Resolution:  # fmt: skip
    """The channels of a map by the names of a log.

    `units` : name in the log → its unit there, empty for none. `in_full` : name with its bus → name in the log.
    `unseen` : names that are meant only where the map has them in full.
    """
    out = Resolution()
    parts: dict[str, dict[int, Mapped]] = {}
    for column, mapped in map_.channels.items():
        channel, component = COLUMNS[column]
        parts.setdefault(channel.name, {})[component] = mapped
    without: dict[str, None] = {}
    for name, found in parts.items():
        channel = CHANNELS[name]
        if missing := [channel.columns[i] for i in range(channel.width) if i not in found]:
            alone = ALONE.get(next(m.column for m in found.values()), "")
            hint = f" (map it to {alone}, which is one component alone)" if alone else ""
            out.lacking[name] = f"the map does not have {', '.join(missing)}{hint}"
            continue
        try:
            columns = [found[i] for i in range(channel.width)]
            keys = [_keys(map_, one, units, in_full, without, unseen) for one in columns]
            if not any(keys):
                raise ValueError("constants only: no name of the log is in it")
            out.recipes.append(Recipe(channel, columns, keys))
        except ValueError as cause:
            out.lacking[name] = str(cause)
    out.without_unit = list(without)
    return out


def _keys(
    map_: ChannelMap, mapped: Mapped, units: Mapping[str, str], in_full: Mapping[str, str], without: dict[str, None],
    unseen: Collection[str],
) -> dict[str, Key]:  # fmt: skip
    """The series of a column's expression. Raises ValueError in words."""
    out: dict[str, Key] = {}
    known: dict[str, Unit | None] = {}
    for name, source in mapped.written.names.items():
        said = map_.said(source)
        try:
            asked = said.name or source
            found = resolve(in_full.get(asked, asked), units, str if said.name else written_name, unseen)
        except KeyError as cause:
            raise ValueError(f"{mapped.column}: {cause.args[0]}") from None
        unit = mapped.unit or said.unit or map_.said(found).unit or units[found]
        if not unit:
            without[found] = None
        try:
            known[source] = read_unit(unit) if unit else None
        except UnitFault as cause:
            remedy = f'say the right one in [sources]: "{source}" = "…"'
            raise ValueError(f"{mapped.column}: '{found}': {cause}; {remedy}") from None
        there = map_.said(found)
        out[name] = Key(found, unit, mapped.delay + (said.delay or there.delay), said.drift or there.drift)
    try:
        mapped.check(known)
    except ExpressionFault as cause:
        raise ValueError(f"{mapped.column}: {marked(mapped.written.text, cause)}") from None
    except ValueError as cause:
        named = ", ".join(f"'{n}' is in {u.text}" for n, u in known.items() if u is not None)
        raise ValueError(f"{mapped.column}: {cause}{f' ({named})' if named else ''}") from None
    return out


def in_si(values: Array, unit: str) -> Array:
    """Values of a unit in SI; as they are where there is none."""
    if not unit:
        return values
    found = read_unit(unit)
    return values if found.factor == 1.0 and not found.offset else found.factor * values + found.offset


ALONE = {
    "imu.accel.x": "car.longitudinal_accel", "imu.accel.y": "car.lateral_accel", "imu.accel.z": "car.vertical_accel",
    "imu.rate.x": "car.roll_rate", "imu.rate.y": "car.pitch_rate", "imu.rate.z": "car.yaw_rate",
}  # fmt: skip
"""Component → the channel that is this component alone."""
