"""Drivers of sensors, one file each, found automatically in this folder: frames in, blocks out; no clock or socket."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from lacet.daq.errors import UsageError, nearest
from lacet.drivers.framework.base import Driver


def driver_names() -> tuple[str, ...]:
    """Names of the drivers in this folder, those of their files."""
    return tuple(sorted(entry.name for entry in pkgutil.iter_modules(__path__) if not entry.ispkg))


@cache
def _driver(name: str) -> type:
    """The class of a driver in this folder, which is loaded only now: some need large libraries."""
    module = importlib.import_module(f"{__name__}.{name}")
    return driver_class(vars(module), module.__name__, name, str(module.__file__))


def driver_class(namespace: Mapping[str, object], module: str, name: str, file: str) -> type:
    """The class derived from `Driver` that a driver's file defines. Raises UsageError where it is not as it should be.

    Parameters
    ----------
    namespace, module : what the file defines, and the module's name.
    name : of the driver, that of its file.
    """
    found = [
        item
        for item in namespace.values()
        if isinstance(item, type) and Driver in item.__mro__[1:] and item.__module__ == module
    ]
    if len(found) != 1:
        what = "no class" if not found else f"{len(found)} classes ({', '.join(one.__name__ for one in found)})"
        raise UsageError(
            f"{file}: a driver is one class derived from lacet.drivers.framework.base.Driver, and it has {what}"
        )
    if getattr(found[0], "name", None) != name:
        raise UsageError(f"{file}: its class must say name = '{name}', that of the file")
    return found[0]


def known_drivers() -> dict[str, type]:
    """Driver classes by name: the class derived from `Driver` in each file of this folder."""
    return {name: _driver(name) for name in driver_names()}


def open_driver(
    name: str,
    bus: str,
    options: Mapping[str, object] | None = None,
    folder: Path | None = None,
    documents: Mapping[str, str] | None = None,
    own: Mapping[str, type] | None = None,
) -> Driver:
    """The driver of a sensor of the rig.

    Parameters
    ----------
    name : driver name, that of its file.
    bus : bus as named in the rig file; the source of the frames it encodes.
    options : the driver's options in the rig file.
    folder : folder of the rig file, to which relative file names refer.
    documents : file name → text, recorded with a run; they take precedence over files on disk.
    own : drivers of the user's own by name, which have been trusted.

    Raises
    ------
    UsageError : no driver has that name.
    RigError : an option is unknown or wrong.
    DbcError : the DBC file is missing or has faults.
    """
    own = own or {}
    names = driver_names()
    if name not in own and name not in names:
        known = sorted({*names, *own})
        raise UsageError(
            f"there is no driver '{name}'{nearest(name, known)} (there are: {', '.join(known)}). A driver of your own, "
            f"drivers/{name}.py beside the rig file, is found only with that rig file: --rig FILE"
        )
    return (own[name] if name in own else _driver(name))(bus, options or {}, folder, documents or {})
