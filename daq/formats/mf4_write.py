"""Writer of runs as measured MDF files (``.mf4``, version 4.10), which `mf4.read_mf4` and any MDF tool read again."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from lacet.daq.channels import CHANNELS
from lacet.daq.errors import RunError
from lacet.daq.parts import from_part
from lacet.daq.rig import WHEEL_REFERENCES
from lacet.daq.run import BRAKES, METADATA_KEYS, Run

PROGRAM = b"lacet\0\0\0"
"""Program that wrote a file, by its identification block, bytes 16 to 24."""
METADATA = "lacet-run.json"
RIG = "rig.toml"
VEHICLE = "vehicle.toml"
"""Names of the attachments: what is declared of the run, and the texts of its rig and vehicle files."""


def write_mf4(run: Run, path: Path, start_ns: int | None = None) -> None:
    """Write a run: one group a channel, its columns named as in an exchange table, in SI units, with comments.

    Samples that are not usable are marked invalid. `start_ns` : instant of time 0 [ns since the Unix epoch]. Raises
    RunError for a run without channels, or when the file cannot be written.
    """
    if not run.signals:
        raise RunError(path, ["there is nothing to write: the run has no channels"])
    # Imported here: pandas, which it depends on, takes seconds to load.
    with from_part("logs"):
        from asammdf import MDF
        from asammdf import Signal as Column

    with MDF(version="4.10") as mdf:
        mdf.identification.program_identification = PROGRAM
        if start_ns is not None:
            mdf.header.start_time = datetime.fromtimestamp(start_ns / 1e9, UTC)
        mdf.header.comment = f"{run.name}: a run of lacet; channels in SI units (lacet info --channels)"
        for name, signal in run.signals.items():
            channel, bad = CHANNELS[name], ~signal.usable
            columns: list[Any] = [
                Column(
                    np.ascontiguousarray(signal.values[:, k]), signal.t, name=column, unit=channel.unit,
                    comment=f"{channel.about}; {channel.axes} axes unless the rig says otherwise",
                    invalidation_bits=bad if bad.any() else None,
                )
                for k, column in enumerate(channel.columns)
            ]  # fmt: skip
            mdf.append(columns, acq_name=name, comment=channel.about, common_timebase=True)
        declared = {key: value for key in METADATA_KEYS if (value := getattr(run, key))}
        for name, text in ((METADATA, json.dumps(declared, ensure_ascii=False, indent=1)), (RIG, run.rig_text),
                           (VEHICLE, run.vehicle_text)):  # fmt: skip
            if text:
                mdf.attach(text.encode("utf-8"), file_name=name, comment="of lacet", mime="text/plain")
        try:
            mdf.save(path, overwrite=True, compression=2)
        except OSError as cause:
            raise RunError(path, [f"cannot be written: {cause.strerror}"]) from None


def is_written_here(path: Path) -> bool:
    """Whether `write_mf4` wrote a file."""
    with path.open("rb") as stream:
        return stream.read(24)[16:] == PROGRAM


def attached(mdf: Any) -> dict[str, str]:
    """Texts of the attachments that `write_mf4` writes, by name; empty for a file of another system."""
    out: dict[str, str] = {}
    for index, block in enumerate(getattr(mdf, "attachments", ())):
        name = Path(str(block.file_name)).name
        if name in (METADATA, RIG, VEHICLE):
            data, _, _ = mdf.extract_attachment(index)
            out[name] = bytes(data).decode("utf-8")
    return out


def declared(texts: dict[str, str]) -> dict[str, str]:
    """What a file's attachments declare of its run: key of `METADATA_KEYS` → text."""
    try:
        found: Any = json.loads(texts.get(METADATA, "{}"))
    except ValueError:
        return {}
    allowed = {"wheel_reference": WHEEL_REFERENCES, "brakes": BRAKES}
    kept = {key: str(found[key]) for key in METADATA_KEYS if isinstance(found, dict) and key in found}
    return {key: text for key, text in kept.items() if text in allowed.get(key, (text,))}
