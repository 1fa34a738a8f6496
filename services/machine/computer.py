"""Clock, disk and browser of this computer."""

from __future__ import annotations

import ctypes
import os
import shutil
import sys
import webbrowser
from collections.abc import Callable
from pathlib import Path

from lacet.services.acquisition.log_medium import RESERVE_BYTES
from lacet.services.machine.finding import Finding, State

LEAST_FREE = 5_000_000_000
"""Free space for logs below which there is a warning, beyond what a recording leaves on the disk [bytes]."""
_STA_UNSYNC = 0x40  # linux/timex.h


class _Timex(ctypes.Structure):
    """The head of linux' ``struct timex``; the rest is room for the kernel to write to."""

    _fields_ = (
        ("modes", ctypes.c_uint), ("offset", ctypes.c_long), ("freq", ctypes.c_long), ("maxerror", ctypes.c_long),
        ("esterror", ctypes.c_long), ("status", ctypes.c_int), ("rest", ctypes.c_byte * 256),
    )  # fmt: skip


def kernel_clock() -> tuple[bool, float] | None:
    """Whether the kernel's clock follows a reference, and its largest error [s]; None where the system does not say."""
    if not sys.platform.startswith("linux"):
        return None
    answer = _Timex()
    if ctypes.CDLL(None).adjtimex(ctypes.byref(answer)) < 0:
        return None
    return not answer.status & _STA_UNSYNC, answer.maxerror * 1e-6


def clock(found: tuple[bool, float] | None) -> Finding:
    """Finding on the clock, as `kernel_clock` gives it: stamps of several computers are compared by it."""
    if found is None:
        says = "not checked on this system: needed where several computers record or logs are joined by their time"
        return Finding("clock", State.ABSENT, says, "look at the system's settings of date and time")
    synchronised, error = found
    if synchronised:
        return Finding("clock", State.OK, f"synchronised, within {1e3 * error:.3g} ms")
    says = "not synchronised: its stamps drift against other computers', and it may jump while recording"
    return Finding("clock", State.WARNING, says, "sudo timedatectl set-ntp true (without a network: chrony with GPS)")


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


def browser(find: Callable[[], object] = webbrowser.get) -> Finding:
    """Finding on the browser that ``lacet ui --open`` opens."""
    try:
        found = find()
    except webbrowser.Error:
        says = "none found: needed by lacet ui --open only"
        return Finding("browser", State.ABSENT, says, "open the address that lacet ui prints, also from afar (ssh -L)")
    return Finding("browser", State.OK, str(getattr(found, "name", "there")))
