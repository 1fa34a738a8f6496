"""Decoding of a whole log or capture: from its raw frames to a new log that holds both."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

from lacet.daq.errors import RunError, UsageError, nearest
from lacet.daq.formats.events import EventKind
from lacet.daq.formats.log import LogReader, LogWriter
from lacet.daq.formats.run_files import PART
from lacet.daq.formats.wire import StartRecord
from lacet.daq.rig import Rig
from lacet.daq.run import Mark
from lacet.daq.run_limits import RunLimits
from lacet.identify.progress import silent
from lacet.services.acquisition.log_decoder import Late, LogDecoder
from lacet.services.acquisition.other_logs import NOT_USED
from lacet.services.acquisition.own_drivers import OwnDrivers
from lacet.services.acquisition.stream_decoder import Decoder, closing_record
from lacet.services.progress import Progress, ServiceStage, ServiceStep, Stretch
from lacet.services.render.pauses import pause_lines
from lacet.services.timing.usual import stretch


def decoding_plan() -> list[Stretch]:
    """The plan of a decoding."""
    return [stretch(one) for one in (ServiceStage.READING_LOG, ServiceStage.DECODING_LOG, ServiceStage.WRITING_LOG)]


def decode_log(
    raw: Path, output: Path, rig: str | None = None, documents: list[Path] | None = None, progress: Progress = silent,
    own: OwnDrivers | None = None, limits: RunLimits | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Decode the raw frames of a log into a new one, which is complete or not written at all.

    Parameters
    ----------
    raw, output : the log read, and the one written; an existing file is replaced, a missing folder made.
    rig, documents : files to use instead of those recorded.
    progress : receives the per cent done.
    own : drivers of the user's own, which have been trusted.
    limits : of the part that is decoded, in the stamps of the raw frames.

    Returns the result of ``lacet decode`` (``docs/json.md``). Raises LacetError where nothing can be decoded.
    """
    progress(ServiceStep(ServiceStage.READING_LOG, 0, 100))
    reader = LogReader(raw)
    if not reader.sources():
        raise RunError(raw, ["no raw frames in it: there is nothing to decode"])
    part = output.with_name(output.name + ".part")
    between = _between(reader, limits) if limits else None
    known: Late = {}
    output.parent.mkdir(parents=True, exist_ok=True)
    try:
        while True:
            damage = len(reader.damage)
            decoder = open_decoder(reader, rig, documents or [], own)
            log = LogDecoder(reader, decoder, known, between)
            axes = {name: sensor.axes for sensor in decoder.rig.sensors for name in sensor.channels}
            with LogWriter(part, _start(reader, decoder, own), axes=axes, overwrite=True) as writer:
                for fraction in log.write_to(writer):
                    progress(ServiceStep(ServiceStage.DECODING_LOG, int(99 * fraction), 100))
                progress(ServiceStep(ServiceStage.WRITING_LOG, 99, 100))
                for event in reader.events():
                    if between is None or between[0] <= event.t_ns <= between[1]:
                        writer.write_event(event)
                writer.close(closing_record(reader, decoder, log.last_ns))
            # Damage found on the way belongs into the start record, a late sample into its window: once more with them.
            reader.damage[damage:] = sorted(reader.damage[damage:])
            if len(reader.damage) == damage and (known or not log.late):
                break
            known = log.late
        os.replace(part, output)
    finally:
        part.unlink(missing_ok=True)
    return {
        "log": output,
        "samples": log.samples,
        "ledger": decoder.ledger(),
        "losses": decoder.losses(),
        "failures": decoder.failures,
        "absent": [name for name in decoder.channels if name not in log.samples],
        "damage": _damage(reader),
        "notes": [
            *decoder.notes,
            *reader.start.extra.get(NOT_USED, "").splitlines(),
            *pause_lines({name: stamps.found for name, stamps in log.stamps.items()}),
        ],
    }


def _between(reader: LogReader, limits: RunLimits) -> tuple[int, int]:
    """Begin and end of a part [ns]; the run starts with its first frame."""
    start_ns = int(min(next(reader.batches(source)).t_ns[0] for source in reader.sources()))
    last_ns = max(reader.span(source)[1] for source in reader.sources())
    marks = [Mark((e.t_ns - start_ns) / 1e9, e.text) for e in reader.events() if e.kind == EventKind.MARK]
    begin, end = limits.seconds(reader.path.name, marks)
    if begin > (seconds := (last_ns - start_ns) / 1e9):
        raise RunError(reader.path, [f"nothing was recorded after {begin:g} s: it has {seconds:.1f} s"])
    return start_ns + round(begin * 1e9), last_ns + 1 if end > seconds else start_ns + round(end * 1e9)


def open_decoder(
    reader: LogReader, rig_file: str | None, documents: list[Path], own: OwnDrivers | None = None
) -> Decoder:
    """The decoder of a log: by its own rig and documents, unless others are given.

    The files that a given rig file names take precedence over the recorded ones.

    Raises
    ------
    LacetError : no rig is known, or a file has faults, or the rig uses none of its name.
    """
    recorded = dict(reader.start.documents)
    if rig_file is not None:
        rig = Rig.load(rig_file)
        recorded = {k: text for k, text in recorded.items() if rig.folder is None or not (rig.folder / k).exists()}
    elif reader.start.rig_text:
        rig = Rig.parse(reader.start.rig_text, f"rig of {reader.path}")
    else:
        raise RunError(reader.path, ["no rig is recorded in it; give one with --rig FILE"])
    given = {path.name: _text(path) for path in documents}
    decoder = Decoder(rig, recorded | given, own.classes if own else None)
    for name in given:
        if name not in decoder.documents:
            known = ", ".join(sorted(decoder.documents)) or "none"
            raise UsageError(f"--dbc: no driver uses '{name}'{nearest(name, decoder.documents)} (used: {known})")
    if not decoder.channels:
        raise RunError(rig_file or reader.path, ["no sensor of the rig has both a driver and a bus: nothing to decode"])
    return decoder


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"--dbc {path}: {getattr(error, 'strerror', None) or 'not UTF-8 text'}") from error


def _damage(reader: LogReader) -> list[str]:
    """What is lost: before the log was written, as of a bus log cut short, and of the log itself."""
    return list(dict.fromkeys([*reader.start.extra.get("damage", "").splitlines(), *reader.damage]))


def _start(reader: LogReader, decoder: Decoder, own: OwnDrivers | None = None) -> StartRecord:
    extra = {key: text for key, text in reader.start.extra.items() if key != PART}  # what is written is one file
    if damage := _damage(reader):
        extra["damage"] = "\n".join(damage)
    documents = {**reader.start.documents, **decoder.documents, **(own.documents if own else {})}
    return replace(
        reader.start,
        rig_text=decoder.rig.text,
        wheel_reference=decoder.rig.wheel_reference,
        documents=documents,
        extra=extra,
    )
