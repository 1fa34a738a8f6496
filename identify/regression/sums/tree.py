"""Merging of many parts in a tree whose shape depends on their number and order alone.

Floating-point sums depend on the order of their terms. The order here is that of the parts, wherever and whenever each
was made, so that a fit has the same bits on one process and on any number of workers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

WIDTH = 8
"""Number of parts merged at once."""

T = TypeVar("T")


def groups(count: int) -> list[range]:
    """Places of the parts that are merged at once, of `count` parts."""
    return [range(start, min(start + WIDTH, count)) for start in range(0, count, WIDTH)]


def merged(parts: Iterable[T], merge: Callable[[Sequence[T]], T]) -> T:
    """The parts merged level by level, `groups` of them at once, as soon as they are there.

    Raises ValueError when there is none.
    """
    levels: list[list[T]] = []
    for part in parts:
        _add(levels, 0, part, merge)
    rest: list[T] = []
    for level in levels:
        rest = _joined([*level, *rest], merge)
    if not rest:
        raise ValueError("nothing to merge")
    return rest[0]


def _add(levels: list[list[T]], height: int, part: T, merge: Callable[[Sequence[T]], T]) -> None:
    """Put a part on its level; a full level is merged into one part of the next."""
    if height == len(levels):
        levels.append([])
    levels[height].append(part)
    if len(levels[height]) == WIDTH:
        whole = merge(levels[height])
        levels[height] = []
        _add(levels, height + 1, whole, merge)


def _joined(parts: list[T], merge: Callable[[Sequence[T]], T]) -> list[T]:
    return [merge(parts)] if len(parts) > 1 else parts
