"""Uploads from the browser into the study's folder: bounded, complete or not at all, never over another unasked."""

from __future__ import annotations

import errno
import filecmp
import json
import os
import secrets
import shutil
import time
import tomllib
import unicodedata
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect

from lacet.daq.errors import LacetError, UsageError
from lacet.daq.formats.exchange import METADATA_KEYS
from lacet.daq.formats.log import LogReader
from lacet.daq.formats.mf4 import FORMAT, read_map
from lacet.daq.maps.channel_map import ChannelMap
from lacet.daq.rig import Rig
from lacet.daq.sources.dbc_messages import read_dbc
from lacet.daq.vehicle import Vehicle
from lacet.services.workbench.file_changes import set_aside
from lacet.services.workbench.refusals import DiskFull, InTheWay, TooLarge
from lacet.services.workbench.run_files import FOLDER, KINDS, RAW
from lacet.services.workbench.session_cache import SessionCache

MOST = 4_000_000_000
"""Default largest size of an upload [bytes]."""
SPARE = 50_000_000
"""Space that an upload leaves free on the disk, for the study itself [bytes]."""
_PIECE = 1 << 20
_DAY = 86400.0
_TOML: dict[str, Callable[[Path], Any]] = {
    "rig.toml": lambda file: Rig.load(file, kept=True),  # whose drivers are never looked for beside an upload
    "vehicle.toml": Vehicle.load,
}
_UNSEEN = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
"""Kinds of characters that are not seen, or turn the text around them: a name with one looks like another."""
_BESIDE = (".toml", ".json", ".dbc")
"""Suffixes of a channel map, of the metadata of a CSV table, and of the description of a bus."""


def safe_name(name: str) -> str:
    """A file name from the browser, checked. Raises UsageError for one that could leave the folder."""
    bad = not name or name != Path(name).name or name.startswith(".") or len(name.encode("utf-8", "replace")) > 200
    if bad or any(c in '\\:*?"<>|' or unicodedata.category(c) in _UNSEEN for c in name):
        raise UsageError(f"'{name[:80]}' cannot be the name of a file here: letters, digits, - and _ are safe")
    if name not in _TOML and Path(name).suffix.lower() not in (*KINDS, *_BESIDE):
        raise UsageError(
            f"'{name}' is no run: give {', '.join(KINDS)}, what stands beside one ({', '.join(_BESIDE)}), "
            "or rig.toml, vehicle.toml"
        )
    return name


async def take(
    cache: SessionCache, name: str, length: int | None, body: AsyncIterator[bytes], most: int, replace: bool = False
) -> dict[str, Any]:
    """Store an upload; `length` as announced [bytes]; `replace` : in place of the file of that name, kept aside.

    Returns its file, and whether it is a raw capture that has to be decoded. Raises Refusal or UsageError, after
    removing what was written.
    """
    name = safe_name(name)
    if length is not None and length > most:
        raise TooLarge(f"{name} has {length:,} bytes, more than the {most:,} that are taken (--most-upload)")
    folder = cache.folder if name in _TOML else cache.folder / FOLDER
    if not replace:
        _refuse_there(folder / name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if length is not None and length + SPARE > free(folder):
            raise DiskFull(f"{name} has {length:,} bytes, the disk has room for {max(0, free(folder) - SPARE):,}")
    except OSError as error:
        raise UsageError(f"{folder}: {error.strerror}; start lacet ui with a folder that can be written to") from None
    part = folder / f".{secrets.token_hex(8)}.part{Path(name).suffix}"
    try:
        await _written(part, name, body, most)
        return await run_in_threadpool(_placed, cache, part, folder / name, replace)
    except ClientDisconnect:
        raise UsageError(f"{name} did not come to its end: drop it again") from None
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise DiskFull(f"the disk is full: {name} was not kept; make room and drop it again") from None
        raise UsageError(f"{name} cannot be written: {error.strerror}") from None
    finally:
        part.unlink(missing_ok=True)


async def _written(part: Path, name: str, body: AsyncIterator[bytes], most: int) -> None:
    count, waiting = 0, bytearray()
    with part.open("xb") as file:
        async for chunk in body:
            count += len(chunk)
            if count > most:
                raise TooLarge(f"{name} has more than the {most:,} bytes that are taken (--most-upload)")
            waiting += chunk
            if len(waiting) >= _PIECE:
                await run_in_threadpool(write, file, bytes(waiting))
                waiting.clear()
        await run_in_threadpool(write, file, bytes(waiting))
        file.flush()
        os.fsync(file.fileno())


def sweep(cache: SessionCache) -> None:
    """Remove incomplete uploads of interrupted servers, a day old or older."""
    for folder in (cache.folder, cache.folder / FOLDER):
        for part in folder.glob(".*.part*"):
            with suppress(OSError):
                if time.time() - part.stat().st_mtime > _DAY:
                    part.unlink()


def write(file: Any, data: bytes) -> None:
    """Write a piece (tests replace this by a full disk)."""
    file.write(data)


def free(folder: Path) -> int:
    """Free space on the disk of a folder [bytes]."""
    return shutil.disk_usage(folder).free


def _placed(cache: SessionCache, part: Path, target: Path, replace: bool) -> dict[str, Any]:
    raw = False
    if target.suffix in _BESIDE:
        try:
            _TOML.get(target.name, _CHECKS[target.suffix])(part)
        except LacetError as error:
            raise UsageError(str(error).replace(str(part), target.name)) from None
    elif target.suffix.lower() == ".mcap":
        try:
            log = LogReader(part)
            raw = bool(log.sources()) and not log.channels()
        except LacetError:
            pass  # kept: the list of runs reports its fault
    if replace:
        set_aside(cache, target)
    if raw:
        target = cache.folder / RAW / target.name
        target.parent.mkdir(exist_ok=True)
    # The capture exists without a run (else it had been refused): its interrupted decoding is repeated.
    if not (raw and target.is_file() and filecmp.cmp(part, target, shallow=False)):
        _move(part, target)
    return {"file": target.name, "name": target.stem, "bytes": target.stat().st_size, "raw": raw}


def _check_map(path: Path) -> None:
    """Check a channel map, of the kind that it says it is. Raises UsageError for the file of a car or a rig."""
    with suppress(OSError, ValueError):
        kind = str(tomllib.loads(path.read_text(encoding="utf-8")).get("format", "")).partition(" ")[0]
        for name in _TOML:
            if kind == f"lacet-{name.removesuffix('.toml')}":
                raise UsageError(f"{path}: is no channel map but a {kind} file: give it the name {name}")
    (read_map if FORMAT in path.read_text(encoding="utf-8", errors="replace") else ChannelMap.load)(path)


def _read_metadata(path: Path) -> None:
    """Check that a file is the metadata of a CSV table. Raises UsageError."""
    try:
        metadata = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, OSError) as error:
        raise UsageError(f"{path}: is no JSON: {error}") from None
    unknown = [key for key in metadata if key not in METADATA_KEYS] if isinstance(metadata, dict) else ["no object"]
    if unknown:
        raise UsageError(f"{path}: {', '.join(unknown)}: known are {', '.join(METADATA_KEYS)}")


def _move(part: Path, target: Path) -> None:
    """Give a file its name unless another has it: a hard link fails then, where a rename would replace the other."""
    try:
        os.link(part, target)
    except FileExistsError:
        _refuse_there(target)
        raise
    except OSError as error:
        if error.errno not in (errno.EPERM, errno.ENOTSUP, errno.EXDEV, errno.EMLINK):
            raise
        _refuse_there(target)
        part.rename(target)


def _refuse_there(target: Path) -> None:
    if target.exists():
        place = target.parent.name
        raise InTheWay(
            f"there is one in {place}/ already: replace it in the list of files, or give this one another name"
        )


_CHECKS: dict[str, Callable[[Path], Any]] = {".toml": _check_map, ".json": _read_metadata, ".dbc": read_dbc}
