"""Layout of a CAN sensor compiled from a DBC file: messages, bits and factors to SI, or all faults of the file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from lacet.daq.channels import CHANNELS, CORNERS
from lacet.daq.errors import DbcError, nearest
from lacet.daq.sources.dbc_messages import dbc_text
from lacet.daq.text_source import is_file
from lacet.drivers.framework import dbc

FOLDER = Path(__file__).parents[1] / "dbc"
"""Folder of the DBC files shipped with the drivers."""

SI: dict[str, dict[str, float]] = {
    "N": {"N": 1.0, "daN": 10.0, "kN": 1e3},
    "N·m": {"N·m": 1.0, "Nm": 1.0, "N*m": 1.0, "kNm": 1e3},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "m/s": {"m/s": 1.0, "mm/s": 1e-3, "km/h": 1 / 3.6},
    "m/s²": {"m/s²": 1.0, "m/s^2": 1.0, "m/s2": 1.0, "g": 9.80665},
    "Pa": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "bar": 1e5},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "°": math.pi / 180},
    "rad/s": {"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": math.pi / 180, "°/s": math.pi / 180, "rpm": math.pi / 30},
}
"""SI unit of a channel → units that a DBC may declare → factor to SI."""


@dataclass(frozen=True)
class Component:
    """One component of a channel: its signal, the index of its message in the sample, and the factor to SI."""

    part: int
    signal: dbc.Signal
    si: float


@dataclass(frozen=True)
class Reading:
    """One channel of a unit, with the status signal (in the last message) of its validity."""

    channel: str
    components: tuple[Component, ...]
    status: dbc.Signal
    cyclic: bool


@dataclass(frozen=True)
class Unit:
    """Channels sampled together: those of a wheel, a pair of lasers, a Correvit. `corner` is "" where there is none."""

    corner: str
    messages: tuple[dbc.Message, ...]
    readings: tuple[Reading, ...]
    counter: dbc.Signal
    checksum: dbc.Signal | None

    def layout(self) -> tuple:
        """Key of the unit's frame layout, without names: equal for units whose frames have the same layout."""
        return (
            tuple(message.length for message in self.messages),
            tuple(
                (
                    tuple((c.part, c.signal.bare(), c.si) for c in reading.components),
                    reading.status.bare(),
                    reading.cyclic,
                )
                for reading in self.readings
            ),
            self.counter.bare(),
            self.checksum and self.checksum.bare(),
        )

    def mounted_at(self, corner: str) -> Unit:
        """The unit with the channels of another corner."""
        readings = tuple(
            replace(reading, channel=reading.channel.replace(f".{self.corner}.", f".{corner}."))
            for reading in self.readings
        )
        return replace(self, corner=corner, readings=readings)


def read_layout(file: object, folder: Path | None, documents: Mapping[str, str]) -> tuple[str, str]:
    """Name and text of a DBC file: as recorded, else beside the rig file, else of those shipped with the drivers.

    Raises
    ------
    DbcError : there is no such file in any of these places, or it cannot be read.
    """
    if not isinstance(file, str):
        raise DbcError(file, ['the option dbc is the name of a file, e.g. dbc = "igel.dbc"'])
    if file in documents:
        return file, documents[file]
    places = [place / file for place in (folder, FOLDER) if place is not None]
    for path in places:
        if is_file(path):
            try:
                data = path.read_bytes()
            except OSError as error:
                raise DbcError(path, [f"cannot be read: {error.strerror}"]) from None
            return file, dbc_text(data)
    known = sorted({path.name for place in places for path in place.parent.glob("*.dbc")} | set(documents))
    looked = ", ".join(str(place.parent) for place in places)
    raise DbcError(file, [f"no such file in {looked}{nearest(file, known)} (there: {', '.join(known) or 'none'})"])


def compile_units(
    path: str, text: str, templates: Mapping[str, tuple[str, ...]], cyclic: tuple[str, ...], checksum: bool
) -> list[Unit]:
    """Units of a sensor, compiled from the messages of a DBC file.

    Parameters
    ----------
    templates : message name → channels, as in `CanSensor.messages`, for the corners of which the DBC has any message.
    cyclic, checksum : as in `CanSensor`; whether a checksum is needed.

    Raises
    ------
    DbcError : with every fault of the file, those of unused messages included.
    """
    database = dbc.parse(text, path)
    faults = list(database.faults)
    corners = CORNERS if any("{c}" in template for template in templates) else ("",)
    named = set(database.messages) | set(database.left_out)
    present = [c for c in corners if any(template.format(c=c) in named for template in templates)]
    units = [_unit(corner, database, templates, cyclic, checksum, faults) for corner in present]
    if not present:
        wanted = [template.format(c=corners[0]) for template in templates]
        faults.append(
            f"has no message '{wanted[0]}'{nearest(wanted[0], database.messages)} and none for any other wheel"
            if corners != ("",)
            else f"has no message '{wanted[0]}'{nearest(wanted[0], database.messages)}"
        )
    whole = [unit for unit in units if unit is not None]
    if faults:
        raise DbcError(path, dict.fromkeys(faults))
    return whole


def _unit(
    corner: str,
    database: dbc.Database,
    templates: Mapping[str, tuple[str, ...]],
    cyclic: tuple[str, ...],
    checksum: bool,
    faults: list[str],
) -> Unit | None:
    """One unit, compiled; None where a fault, added to `faults`, prevents it."""
    before = len(faults)
    names = [template.format(c=corner) for template in templates]
    messages = [database.messages.get(name) for name in names]
    faults += [
        f"message '{name}' {database.left_out[name]}"
        if name in database.left_out
        else f"has no message '{name}'{nearest(name, set(database.messages) - set(names))}"
        for name, message in zip(names, messages, strict=True)
        if message is None
    ]
    found: list[tuple[str, list[Component], bool]] = []
    for part, (channels, message) in enumerate(zip(templates.values(), messages, strict=True)):
        if message is None:
            continue
        for template in channels:
            channel = template.format(c=corner)
            components = [
                _component(message, part, channel, column, database, faults) for column in CHANNELS[channel].columns
            ]
            kept = [component for component in components if component is not None]
            if template in cyclic:
                faults += [fault for component in kept if (fault := _turn_fault(component, message))]
            found.append((channel, kept, template in cyclic))
    last = messages[-1]
    if last is None:
        return None
    counter = _signal(last, "counter", faults)
    check = _signal(last, "checksum", faults) if checksum else None
    shared = last.signals.get("status")
    readings = []
    for channel, components, turns in found:
        status = shared or _signal(last, _bare(channel) + "_status", faults, or_else="status")
        if status is not None:
            readings.append(Reading(channel, tuple(components), status, turns))
    for signal in (counter, check, *(reading.status for reading in readings)):
        if signal is not None and signal.signed:
            fault = f"message '{last.name}': signal '{signal.name}' is signed; it must be unsigned"
            faults += [fault] if fault not in faults else []
    if len(faults) > before or counter is None:
        return None
    whole = tuple(message for message in messages if message is not None)
    return Unit(corner, whole, tuple(readings), counter, check)


def _bare(name: str) -> str:
    """A channel or column name in the characters of a DBC."""
    return name.replace(".", "_")


def _signal(message: dbc.Message, name: str, faults: list[str], or_else: str = "") -> dbc.Signal | None:
    signal = message.signals.get(name)
    if signal is None:
        also = f" or '{or_else}'" if or_else else ""
        faults.append(f"message '{message.name}' has no signal '{name}'{also}{nearest(name, message.signals)}")
    return signal


def _component(
    message: dbc.Message, part: int, channel: str, column: str, database: dbc.Database, faults: list[str]
) -> Component | None:
    reason = database.left_out.get(f"{message.name}.{_bare(column)}")
    if reason:
        faults.append(f"message '{message.name}': signal '{_bare(column)}' {reason}")
        return None
    signal = _signal(message, _bare(column), faults)
    if signal is None:
        return None
    units = SI[CHANNELS[channel].unit]
    if signal.unit not in units:
        faults.append(
            f"message '{message.name}': signal '{signal.name}' has unit '{signal.unit}'; "
            f"{channel} can be given in {', '.join(units)}"
        )
        return None
    return Component(part, signal, units[signal.unit])


def _turn_fault(component: Component, message: dbc.Message) -> str:
    """Reason why the raw range of a cyclic angle is not exactly one turn from 0, or ''."""
    signal = component.signal
    turn = (1 << signal.length) * signal.factor * component.si
    whole = math.isclose(turn, 2 * math.pi, rel_tol=0.25 / (1 << signal.length))
    if signal.signed or signal.offset != 0.0 or not whole:
        return (
            f"message '{message.name}': signal '{signal.name}' must be unsigned, with offset 0, and its "
            f"{signal.length} bits must make one full turn; they make {turn / (2 * math.pi):.6g} turns"
        )
    return ""
