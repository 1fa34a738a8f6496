"""Decoding of a whole log or capture: from its raw frames to a new log that holds both."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

from lacet.daq.errors import RunError, UsageError, nearest
from lacet.daq.formats.log import LogReader, LogWriter
from lacet.daq.formats.wire import StartRecord
from lacet.daq.rig import Rig
from lacet.identify.progress import silent
from lacet.services.acquisition.stream_decoder import Decoder, closing_record, decode_frames, write_decoded
from lacet.services.progress import Progress, ServiceStage, ServiceStep


def decode_log(
    raw: Path, output: Path, rig: str | None = None, documents: list[Path] | None = None, progress: Progress = silent
) -> dict[str, Any]:
    """Decode the raw frames of a log into a new one, which is complete or not written at all.

    Parameters
    ----------
    raw, output : the log read, and the one written; an existing file is replaced.
    rig, documents : files to use instead of those recorded.
    progress : receives the per cent done.

    Returns the result of ``lacet decode`` (``docs/json.md``). Raises LacetError where nothing can be decoded.
    """
    reader = LogReader(raw)
    if not reader.sources():
        raise RunError(raw, ["no raw frames in it: there is nothing to decode"])
    decoder = open_decoder(reader, rig, documents or [])
    part = output.with_name(output.name + ".part")
    try:
        progress(ServiceStep(ServiceStage.READING_LOG, 0, 100))
        frames = [reader.frames(source) for source in reader.sources()]
        progress(ServiceStep(ServiceStage.DECODING_LOG, 20, 100))
        blocks = decode_frames(decoder, frames)
        progress(ServiceStep(ServiceStage.WRITING_LOG, 40, 100))
        axes = {name: sensor.axes for sensor in decoder.rig.sensors for name in sensor.channels}
        with LogWriter(part, _start(reader, decoder), axes=axes, overwrite=True) as writer:
            for fraction in write_decoded(writer, frames, blocks):
                progress(ServiceStep(ServiceStage.WRITING_LOG, int(100 * (0.4 + 0.6 * fraction)), 100))
            last_ns = max((int(batch.t_ns.max()) for batch in frames if len(batch)), default=0)
            writer.close(closing_record(reader, decoder, last_ns))
        os.replace(part, output)
    finally:
        part.unlink(missing_ok=True)
    return {
        "log": output,
        "samples": {name: len(block) for name, block in blocks.items()},
        "ledger": decoder.ledger(),
        "losses": decoder.losses(),
        "absent": [name for name in decoder.channels if name not in blocks],
        "damage": list(reader.damage),
    }


def open_decoder(reader: LogReader, rig_file: str | None, documents: list[Path]) -> Decoder:
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
    decoder = Decoder(rig, recorded | given)
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


def _start(reader: LogReader, decoder: Decoder) -> StartRecord:
    extra = dict(reader.start.extra)
    if reader.damage:
        extra["damage"] = "\n".join(reader.damage)
    documents = {**reader.start.documents, **decoder.documents}
    return replace(
        reader.start,
        rig_text=decoder.rig.text,
        wheel_reference=decoder.rig.wheel_reference,
        documents=documents,
        extra=extra,
    )
