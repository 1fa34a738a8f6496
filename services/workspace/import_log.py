"""Import of logs that other systems wrote: by a channel map into a log that everything else takes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lacet.daq.blocks import Block
from lacet.daq.errors import RunError, UsageError
from lacet.daq.formats import exchange
from lacet.daq.formats.log import LogWriter
from lacet.daq.formats.open_run import is_own
from lacet.daq.formats.wire import StartRecord
from lacet.daq.maps.assembly import ChannelPiece
from lacet.daq.maps.channel_map import ChannelMap
from lacet.daq.maps.conversion import Conversion
from lacet.daq.maps.mapped_run import mapped_run
from lacet.daq.pauses import Stamps, pauses
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.progress import silent
from lacet.services.progress import Progress, ServiceStage, ServiceStep
from lacet.services.render.pauses import pause_lines

MESSAGE_SAMPLES = 4096
"""Samples of a channel in one message of the log."""


def import_logs(
    paths: Sequence[Path], map_: ChannelMap, output: Path, rig: str | None = None, vehicle: str | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:  # fmt: skip
    """Write the run of one or more logs of one drive, complete or not at all.

    Parameters
    ----------
    paths, map_ : the logs and their channel map.
    output : an MCAP log, written piece by piece, however long the logs; or an exchange table (``.parquet``, ``.csv``),
        for channels of one time base.
    rig, vehicle : stored with the run; by default those that the map names.

    Returns the result of ``lacet import`` (``docs/json.md``). Raises LacetError where no channel can be made.
    """
    named = {"rig": rig or map_.metadata.get("rig", ""), "vehicle": vehicle or map_.metadata.get("vehicle", "")}
    if output.suffix.lower() in exchange.SUFFIXES:
        return _as_table(paths, map_, output, named)
    if output.suffix.lower() != ".mcap":
        raise UsageError(f"{output}: give a log (.mcap), which keeps everything, or a table ({exchange.SUFFIXES[0]})")
    progress(ServiceStep(ServiceStage.IMPORTING_LOG, 0, 100))
    conversion = Conversion.of(paths, map_)
    part = output.with_name(output.name + ".part")
    samples: dict[str, int] = {}
    usable: dict[str, int] = {}
    stamps: dict[str, Stamps] = {}
    spans: list[float] = []
    try:
        pieces = conversion.pieces()
        first = next(pieces, None)  # only now the log's beginning is known
        if first is None:
            raise RunError(paths[0], [*conversion.notes, "no channel of the map has samples in it"])
        start_ns = conversion.start_ns or 0
        with LogWriter(part, _start(paths, map_, conversion, start_ns, named), overwrite=True) as writer:
            piece: ChannelPiece | None = first
            while piece is not None:
                block = _block(piece, start_ns)
                edges = [*range(0, len(block), MESSAGE_SAMPLES), len(block)]
                for message in writer.messages(block, edges):
                    writer.write(message)
                samples[piece.channel] = samples.get(piece.channel, 0) + len(block)
                usable[piece.channel] = usable.get(piece.channel, 0) + int(np.count_nonzero(block.flags == 0))
                stamps.setdefault(piece.channel, Stamps()).add(piece.t)
                spans += [float(piece.t[0]), float(piece.t[-1])]
                spans = [min(spans), max(spans)]
                progress(ServiceStep(ServiceStage.IMPORTING_LOG, int(99 * conversion.done), 100))
                piece = next(pieces, None)
        part.replace(output)
    finally:
        conversion.close()
        part.unlink(missing_ok=True)
    without = [name for name, count in usable.items() if not count]
    notes = [*conversion.notes, *(f"{name}: no sample has a value" for name in without)]
    notes += pause_lines({name: one.found for name, one in stamps.items()})
    return {
        "log": output, "files": [str(path) for path in paths], "duration": spans[1] - spans[0], "samples": samples,
        "usable": usable, "notes": notes, "without_unit": conversion.without_unit,
    }  # fmt: skip


def imported(
    paths: Sequence[Path], map_: Path | None, folder: Path, progress: Progress = silent
) -> list[Path]:  # fmt: skip
    """The runs of files: lacet's own as they are, those of other systems imported into a folder by the map.

    Without a map all are as they are. Raises LacetError as `import_logs`.
    """
    if map_ is None:
        return list(paths)
    by_map = ChannelMap.load(map_)
    out: list[Path] = []
    for path in paths:
        if is_own(path):
            out.append(path)
            continue
        folder.mkdir(parents=True, exist_ok=True)
        target = folder / f"{path.stem}.mcap"
        if any(other != path and other.stem == path.stem for other in paths):
            target = folder / f"{path.resolve().parent.name}-{path.stem}{path.suffix}.mcap"
        import_logs([path], by_map, target, progress=progress)
        out.append(target)
    return out


def _start(
    paths: Sequence[Path], map_: ChannelMap, conversion: Conversion, start_ns: int, named: dict[str, str]
) -> StartRecord:
    about = map_.metadata
    return StartRecord(
        run_id=f"{start_ns}-{paths[0].stem}", started_ns=start_ns,
        vehicle_text=Vehicle.load(named["vehicle"]).text if named["vehicle"] else "",
        rig_text=Rig.load(named["rig"]).text if named["rig"] else "",
        documents={Path(map_.name).name: map_.text},
        vehicle=named["vehicle"], manoeuvre=about.get("manoeuvre", ""),
        wheel_reference=about.get("wheel_reference", ""), brakes=about.get("brakes", "unknown"),
        notes=about.get("notes", ""), software="lacet import",
        extra={"imported": "\n".join(conversion.notes), "files": "\n".join(path.name for path in paths)},
    )  # fmt: skip


def _block(piece: ChannelPiece, start_ns: int) -> Block:
    t_ns = start_ns + np.round(piece.t * 1e9).astype(np.int64)
    return Block(piece.channel, t_ns, piece.values, piece.flags)


def _as_table(paths: Sequence[Path], map_: ChannelMap, output: Path, named: dict[str, str]) -> dict[str, Any]:
    without: list[str] = []
    run = mapped_run(paths, map_, without)
    try:
        exchange.write_table(run, output)
    except RunError as error:
        raise RunError(
            output, [*error.faults, f"a log keeps every time base: -o {output.with_suffix('.mcap')}"]
        ) from None
    return {
        "log": output, "files": [str(path) for path in paths], "duration": run.duration,
        "samples": {name: len(one.t) for name, one in run.signals.items()},
        "usable": {name: int(np.count_nonzero(one.usable)) for name, one in run.signals.items()},
        "notes": [*run.problems, *pause_lines({name: pauses(one.t) for name, one in run.signals.items()})],
        "without_unit": without,
    }  # fmt: skip
