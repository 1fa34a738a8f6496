"""Clock, disk and browser of this computer."""

from __future__ import annotations

import os
import shutil
import webbrowser
from collections.abc import Callable
from pathlib import Path

from lacet.services.acquisition.host_clock import short_synchronisation
from lacet.services.acquisition.log_medium import RESERVE_BYTES
from lacet.services.machine.finding import Finding, State

LEAST_FREE = 5_000_000_000
"""Free space for logs below which there is a warning, beyond what a recording leaves on the disk [bytes]."""

BROWSERS = ("firefox", "chromium", "chromium-browser", "google-chrome", "microsoft-edge", "brave-browser", "epiphany")
"""Programs that are browsers, which Python does not look for without a display."""


def clock(found: str) -> Finding:
    """Finding on the clock, in the words of `host_clock.synchronisation`: computers are compared by their stamps."""
    match short_synchronisation(found):
        case "synchronised":
            return Finding("clock", State.OK, found)
        case "unknown":
            says = f"{found}; needed where several computers record, or logs are joined by their time"
            return Finding("clock", State.ABSENT, says, "look at the system's settings of date and time")
        case _:
            says = f"{found}: stamps drift against other computers', and the clock may be set while recording"
            return Finding("clock", State.WARNING, says, "sudo timedatectl set-ntp true (without a network: GPS)")


def disk(folder: Path, usage: Callable[[Path], tuple[int, int, int]] = shutil.disk_usage) -> Finding:
    """Finding on the room for logs in a folder, which need not be there yet.

    `usage` : total, used and free space of a folder's disk [bytes].
    """
    name = f"disk of {folder}"
    there = next((one for one in (folder, *folder.absolute().parents) if one.is_dir()), None)
    if there is None or not os.access(there, os.W_OK):
        return Finding(name, State.WARNING, "this user may not write there", "name another folder: --logs DIR")
    free = usage(there)[2] - RESERVE_BYTES
    says = f"{max(free, 0) / 1e9:.3g} GB for logs"
    if free < LEAST_FREE:
        return Finding(name, State.WARNING, says, "make room, or name another disk's folder: --logs DIR")
    return Finding(name, State.OK, says)


def browser(find: Callable[[], object] = webbrowser.get, which: Callable[[str], str | None] = shutil.which) -> Finding:
    """Finding on the browser that ``lacet ui --open`` opens.

    `find` : the browser that can be opened here; `which` : the path of a program.
    """
    try:
        found = find()
    except webbrowser.Error:
        there = next((path for path in map(which, BROWSERS) if path), None)
        without = "there is no display to open it on" if there else "none found"
        says = f"{f'{there}, but ' if there else ''}{without}: needed by lacet ui --open only"
        return Finding("browser", State.ABSENT, says, "open the address that lacet ui prints, also from afar (ssh -L)")
    return Finding("browser", State.OK, str(getattr(found, "name", "there")))
