"""Drivers of sensors, one file each, found automatically in this folder: frames in, blocks out; no clock or socket."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from lacet.daq.errors import UsageError, nearest
from lacet.drivers.framework.base import Driver


@cache
def _found() -> dict[str, type]:
    drivers: dict[str, type] = {}
    for entry in pkgutil.iter_modules(__path__):
        if entry.ispkg:
            continue
        module = importlib.import_module(f"{__name__}.{entry.name}")
        for item in vars(module).values():
            if isinstance(item, type) and Driver in item.__mro__[1:] and item.__module__ == module.__name__:
                if item.name != entry.name:
                    raise TypeError(f"the driver in {module.__file__} calls itself '{item.name}', not '{entry.name}'")
                drivers[item.name] = item
    return drivers


def known_drivers() -> dict[str, type]:
    """Driver classes by name: the class derived from `Driver` in each file of this folder."""
    return dict(_found())


def open_driver(
    name: str,
    bus: str,
    options: Mapping[str, object] | None = None,
    folder: Path | None = None,
    documents: Mapping[str, str] | None = None,
) -> Driver:
    """The driver of a sensor of the rig.

    Parameters
    ----------
    name : driver name, that of its file.
    bus : bus as named in the rig file; the source of the frames it encodes.
    options : the driver's options in the rig file.
    folder : folder of the rig file, to which relative file names refer.
    documents : file name → text, recorded with a run; they take precedence over files on disk.

    Raises
    ------
    UsageError : no driver has that name.
    RigError : an option is unknown or wrong.
    DbcError : the DBC file is missing or has faults.
    """
    known = known_drivers()
    if name not in known:
        raise UsageError(f"there is no driver '{name}'{nearest(name, known)} (there are: {', '.join(sorted(known))})")
    return known[name](bus, options or {}, folder, documents or {})
