"""Bus logs of other tools (candump, BLF, ASC, TRC, MDF) as frames on the buses of a rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lacet.daq.errors import UsageError, nearest
from lacet.daq.formats.events import EventKind, RunEvent
from lacet.daq.formats.wire import StartRecord
from lacet.daq.frames import EXTENDED, Frames
from lacet.daq.rig import Rig
from lacet.daq.sources.bus_log import read_bus_log
from lacet.daq.sources.frames import Beside
from lacet.services.acquisition.capture import write_capture

OPTION = "--as"
NOT_USED = "not_used"
"""Key of the start record under which stands what of a bus log is not used."""


def frames_for(
    path: Path, rig: Rig, words: Sequence[str] = (), damage: list[str] | None = None,
    beside: Beside | None = None,
) -> dict[str, Frames]:  # fmt: skip
    """The frames of a bus log by the rig's buses; stamps are the log's, and go on where its clock was put back.

    Parameters
    ----------
    damage : receives what is lost of a log that is cut short, and steps of its clock.
    beside : receives the steps back of the log's clock on the rig's buses, by their names there, and what is not used:
        error and remote frames, and other buses.
    words : ``LOGBUS=BUS``, which bus of the rig a bus of the log is; then no other bus of the log is read. Without,
        buses of the same name are meant, or the only CAN bus of the rig for the only bus of the log.

    Raises
    ------
    RunError : the file is no bus log.
    UsageError : which bus is meant is not clear, with what the log and the rig have.
    """
    can = [name for name, bus in rig.buses.items() if bus.kind == "can"]
    if not can:
        raise UsageError(f"{rig.path}: the rig has no CAN bus to play a bus log onto; write [bus.can0] in it")
    beside = Beside() if beside is None else beside
    logged = read_bus_log(path, damage, beside)
    chosen: dict[str, str] = {}
    for word in words:
        name, mark, bus = word.rpartition("=")
        if not mark or not name:
            raise UsageError(f"{OPTION} {word}: write LOGBUS=BUS, e.g. {OPTION} {next(iter(logged))}={can[0]}")
        if name not in logged:
            raise UsageError(f"{OPTION} {word}: the log has no bus '{name}'{nearest(name, logged)}: {_listed(logged)}")
        if bus not in can:
            raise UsageError(f"{OPTION} {word}: no CAN bus '{bus}' in the rig{nearest(bus, can)} ({', '.join(can)})")
        if bus in chosen.values():
            raise UsageError(f"{OPTION} {word}: {bus} is given twice")
        chosen[name] = bus
    chosen = chosen or {name: name for name in logged if name in can}
    if not chosen and len(logged) == len(can) == 1:
        chosen = {next(iter(logged)): can[0]}
    if not chosen:
        raise UsageError(
            f"{path}: which of its buses is which of the rig's ({', '.join(can)})? It has {_listed(logged)}. "
            f"Say it: {OPTION} {next(iter(logged))}={can[0]}"
        )
    beside.steps = [step._replace(bus=chosen[step.bus]) for step in beside.steps if step.bus in chosen]
    beside.not_asked = {name: len(frames) for name, frames in logged.items() if name not in chosen}
    return {bus: replace(logged[name], source=bus) for name, bus in chosen.items()}


def capture_of(path: Path, rig: Rig, target: Path, words: Sequence[str] = ()) -> None:
    """Write a bus log as a capture of a rig, with the log's stamps; steps back of its clock are events.

    Raises LacetError as `frames_for`.
    """
    damage: list[str] = []
    beside = Beside()
    frames = frames_for(path, rig, words, damage, beside)
    first = min(int(batch.t_ns[0]) for batch in frames.values())
    said = {"damage": damage, NOT_USED: beside.lines()}
    start = StartRecord(
        run_id=f"{first}-{path.stem}", started_ns=first, vehicle_text="", rig_text=rig.text,
        wheel_reference=rig.wheel_reference, software="lacet decode",
        extra={"files": path.name, **{key: "\n".join(text) for key, text in said.items() if text}},
    )  # fmt: skip
    events = [
        RunEvent(
            beside.zero_ns + round(one.t * 1e9), EventKind.HOST_CLOCK, one.bus, "stepped",
            f"the log's clock was set by {-one.size:+.3f} s; the stamps of the run go on without that",
        )
        for one in beside.steps
    ]  # fmt: skip
    write_capture(target, frames, start, overwrite=True, events=events)


def _listed(logged: dict[str, Frames]) -> str:
    """What is on each bus of a log."""
    parts: list[str] = []
    for name, frames in logged.items():
        idents = np.unique(frames.ident & np.uint32(EXTENDED - 1))
        some = ", ".join(f"{ident:#05x}" for ident in idents[:3]) + (" …" if len(idents) > 3 else "")
        parts.append(f"'{name}' ({len(frames):,} frames, identifiers {some})")
    return ", ".join(parts)
