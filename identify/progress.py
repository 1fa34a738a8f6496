"""What long computations call to say how far they are. What is called may raise, to end them there."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[int, int], None]
"""Told how many are done, and of how many."""
Tell = Callable[[str], None]
"""Told what is done now."""


def unheard(_: int, __: int) -> None:
    """Nobody wants to know."""


def silent(_: str) -> None:
    """Nobody is told."""
