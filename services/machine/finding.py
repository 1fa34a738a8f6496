"""One thing looked at on this computer, how it is, and what to do about it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class State(StrEnum):
    """How a thing is: as it should be, not there and only needed for what the finding says, or amiss."""

    OK = "ok"
    ABSENT = "absent"
    WARNING = "warning"


@dataclass(frozen=True)
class Finding:
    """What was found of one thing.

    Attributes
    ----------
    name : the thing, ``CAN``.
    state : how it is.
    says : what was found, in one sentence.
    remedy : what to do; empty where there is nothing to do.
    """

    name: str
    state: State
    says: str
    remedy: str = ""
