"""Calls that only some systems have, behind names that all can import: locks, forced writes, polls, Linux' wires."""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from lacet.daq.errors import UsageError

SYSTEM = sys.platform
"""The system, as Python names it."""

NICE = 10
"""Priority of what must not disturb a recorder, as of the command `nice`."""

force: Callable[[int], None] = getattr(os, "fdatasync", os.fsync)
"""Force what is written to a file to the medium, by descriptor."""


def lock(descriptor: int) -> None:
    """Lock a file for as long as it is open, where system and file system have locks; others see it by `is_locked`."""
    with suppress(ImportError, OSError):
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def is_locked(descriptor: int) -> bool:
    """Whether another has locked a file; False where there are no locks."""
    try:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except (ImportError, OSError):
        return False
    return False


def lower_priority() -> None:
    """Give other programs on this machine precedence, such as a recorder; nothing where the system has no such call."""
    if hasattr(os, "nice"):
        os.nice(NICE)


def poller() -> Any:
    """A poll object of the system. Raises UsageError where there is none (Windows)."""
    if not hasattr(select, "poll"):
        raise linux_only("wires")
    return select.poll()


def is_unread(descriptor: int) -> bool:
    """Whether nobody reads any more what is written to a pipe or a socket; False where the system cannot say."""
    if not hasattr(select, "poll"):
        return False
    watched = select.poll()
    watched.register(descriptor, 0)  # of its own accord the system says that the other end is gone
    return bool(watched.poll(0))


def require_linux(what: str) -> None:
    """Raise UsageError on a system that is not Linux; `what` : what is asked for, a plural."""
    if not SYSTEM.startswith("linux"):
        raise linux_only(what)


def linux_only(what: str) -> UsageError:
    """The error for what only Linux can do."""
    return UsageError(
        f"{what} need Linux: SocketCAN, stamps and loss counts of the kernel. Logs made there are decoded, identified "
        "and diagnosed on this system"
    )
