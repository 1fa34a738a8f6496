"""Signs that the drive does not show, by those that it does: the channels of one instrument have one system of axes.

ISO 8855 has x forward, y to the left and z up; SAE J670 y to the right and z down. From one to the other the second and
third components, pitch, yaw and steer change their signs together; first components, roll and camber keep theirs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from lacet.daq.channels import COLUMNS
from lacet.daq.maps.behaviour import SURE
from lacet.daq.maps.words import words_of

SAME_INSTRUMENT = 0.88
"""Probability that a sign is that of the instrument's others, where these agree. Source: a choice, below acceptance."""
SAME_LOG = 0.8
"""The same of the lateral signs of a log's other instruments. Source: a choice."""
DISAGREEING = 0.65
"""Probability of a usual sign where the instrument's others follow no system of axes. Source: a choice."""
MOST_SURE = 0.99
"""Largest probability of signs judged together: what makes one wrong may make all wrong. Source: a choice."""

Sign = tuple[int, float]
"""A sign, and its certainty, 0.5 to 1."""
UNSEEN: Sign = (1, 0.5)
"""The sign of a column of which nothing is seen."""


def turns(column: str) -> bool:
    """Whether a column's sign differs between the two systems of axes."""
    family, last = COLUMNS[column][0].family, column.rpartition(".")[2]
    if family in ("camera.steer", "steering.angle", "steering.torque"):
        return True
    return last in ("y", "z", "pitch", "yaw") and family != "wheel.speed"


def lateral(column: str) -> bool:
    """Whether a column shows where left is; a vertical force or acceleration is often upwards in any system."""
    return turns(column) and not column.endswith((".accel.z", ".force.z"))


def by_others(column: str, signs: Mapping[str, Sign], names: Mapping[str, str]) -> Sign | None:
    """The sign of a column that nothing in the log shows, by the signs that are seen; None where these say nothing.

    `signs` : column → sign and certainty. `names` : column → name in the log.
    """
    if not turns(column):
        return None
    seen = {one: sign for one, (sign, sure) in signs.items() if sure >= SURE and one != column and turns(one)}
    channel = COLUMNS[column][0].name
    of_channel = {sign for one, sign in seen.items() if COLUMNS[one][0].name == channel}
    if len(of_channel) == 1:
        return of_channel.pop(), SAME_INSTRUMENT
    first = signs.get(f"{channel}.x", (1, 0.0))
    forward = first[0] if first[1] >= SURE else 1  # an instrument that measures the reaction has all signs against it
    axis = column.rpartition(".")[2]
    instrument = _instrument(column)
    for same_axis in (True, False):
        found = {
            sign for one, sign in seen.items()
            if _instrument(one) == instrument and (one.endswith(f".{axis}") or not same_axis)
            and (instrument != "camera" or _pattern(names, one) == _pattern(names, column))
        }  # fmt: skip
        if len(found) == 1:
            return forward * found.pop(), SAME_INSTRUMENT
        if len(found) > 1:
            return 1, DISAGREEING
    found = {sign for one, sign in seen.items() if lateral(one)}
    return (forward * found.pop(), SAME_LOG) if len(found) == 1 else None


def of_one_kind(signs: Mapping[str, Sign], names: Mapping[str, str]) -> dict[str, Sign]:
    """The signs, travels with names of one pattern judged together: they are sensors of one kind, built in alike."""
    kinds: dict[tuple[str, ...], list[str]] = {}
    for column in names:
        family = COLUMNS[column][0].family
        if family in ("suspension.travel", "damper.travel"):
            kinds.setdefault((family, *_pattern(names, column)), []).append(column)
    out = dict(signs)
    for columns in kinds.values():
        odds = sum(sign * math.log(sure / (1.0 - sure)) for sign, sure in (signs.get(one, UNSEEN) for one in columns))
        sign, sure = (1 if odds >= 0.0 else -1), min(1.0 / (1.0 + math.exp(-abs(odds))), MOST_SURE)
        out |= dict.fromkeys(columns, (sign, sure))
    return out


def _instrument(column: str) -> str:
    """What measures a column: the inertial unit, the wheels' load cells, the cameras; the channel itself of others."""
    family, name = COLUMNS[column][0].family, COLUMNS[column][0].name
    if family.startswith("imu."):
        return "imu"
    if family in ("wheel.force", "wheel.moment"):
        return "wheels"
    return "camera" if family == "camera.steer" else name


def _pattern(names: Mapping[str, str], column: str) -> list[str]:
    """The words of a column's name without its corner."""
    return words_of(names[column])[0] if column in names else []
