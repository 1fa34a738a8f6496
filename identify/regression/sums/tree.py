"""Merging of many parts in a tree whose shape depends on their number and order alone.

Floating-point sums depend on the order of their terms. The order here is that of the parts, wherever and whenever each
was made, so that a fit has the same bits on one process and on any number of workers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import reduce
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


def summed(parts: Iterable[T], add: Callable[[T, T], T]) -> T:
    """The parts as `merged` by adding one after the other, with the same bits; only one sum a level is held.

    `add` may change its first argument, a part or a sum of parts, and return it.

    Raises ValueError when there is none.
    """
    levels: list[tuple[int, T] | None] = []
    for part in parts:
        _sum(levels, 0, part, add)
        del part  # not to be held while the next one is made
    sums = [level[1] for level in levels if level is not None]
    if not sums:
        raise ValueError("nothing to merge")
    return reduce(lambda rest, level: add(level, rest), sums)


def _sum(levels: list[tuple[int, T] | None], height: int, part: T, add: Callable[[T, T], T]) -> None:
    """Add a part to the sum of its level; that of a full level goes to the next."""
    if height == len(levels):
        levels.append(None)
    there = levels[height]
    count, whole = (1, part) if there is None else (there[0] + 1, add(there[1], part))
    levels[height] = (count, whole) if count < WIDTH else None
    if count == WIDTH:
        _sum(levels, height + 1, whole, add)


def _joined(parts: list[T], merge: Callable[[Sequence[T]], T]) -> list[T]:
    return [merge(parts)] if len(parts) > 1 else parts
