"""Options of a sensor in the rig file that several drivers share, with checks that report every fault at once."""

from __future__ import annotations

from collections.abc import Mapping

from lacet.daq.channels import CORNERS
from lacet.daq.errors import RigError, nearest


def corner_map(name: str, options: Mapping[str, object], fitted: tuple[str, ...]) -> dict[str, str]:
    """Corner on the wire → corner of the channels, from a sensor's option ``corners`` in the rig file.

    With as many entries as corners on the wire they are the wheels that these are mounted at, in the order fl, fr, rl,
    rr (two exchanged entries are two exchanged wires). With fewer, only those wheels are read, each under its own name.

    Raises
    ------
    RigError : an entry is no corner, is repeated, or is not on the wire.
    """
    wanted = options.get("corners")
    if wanted is None:
        return {corner: corner for corner in fitted}
    place = f"options of driver '{name}'"
    if not isinstance(wanted, list | tuple) or not wanted or not all(isinstance(entry, str) for entry in wanted):
        raise RigError(place, [f'corners = {wanted!r}: give a list of wheels, e.g. ["fl", "fr", "rl", "rr"]'])
    entries = [str(entry) for entry in wanted]
    faults = [
        f"corners: '{entry}' is not one of {', '.join(CORNERS)}{nearest(entry, CORNERS)}"
        for entry in entries
        if entry not in CORNERS
    ]
    faults += [f"corners: '{entry}' comes twice" for entry in dict.fromkeys(entries) if entries.count(entry) > 1]
    positional = len(entries) == len(fitted)
    if not faults and not positional:
        faults = [
            f"corners: '{entry}' is not on the wire, which carries {', '.join(fitted)}"
            for entry in entries
            if entry not in fitted
        ]
    if faults:
        raise RigError(place, faults)
    return dict(zip(fitted, entries, strict=True)) if positional else {entry: entry for entry in entries}


def check_options(name: str, options: Mapping[str, object], known: tuple[str, ...]) -> None:
    """Check of a sensor's options in the rig file against those that the driver has.

    Raises
    ------
    RigError : with every unknown option and the nearest known one.
    """
    faults = [
        f"'{key}' is not an option of this driver{nearest(key, known)} (it has: {', '.join(known) or 'none'})"
        for key in options
        if key not in known
    ]
    if faults:
        raise RigError(f"options of driver '{name}'", faults)
