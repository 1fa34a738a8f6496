"""Two results held against each other, value by value."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any


def differences(was: Any, now: Any, relative: float = 0.0, at: str = "") -> Iterator[str]:
    """What differs, one line each: the place, what was stored, what is now.

    `relative` : numbers may differ by this part of the larger one; 0 asks for the same digits.
    """
    if isinstance(was, dict) and isinstance(now, dict):
        for key in [*was, *(key for key in now if key not in was)]:
            if key not in was or key not in now:
                yield f"{at}/{key}: {'gone' if key in was else 'new'}"
            else:
                yield from differences(was[key], now[key], relative, f"{at}/{key}")
    elif isinstance(was, list) and isinstance(now, list) and len(was) == len(now):
        for number, (one, other) in enumerate(zip(was, now, strict=True)):
            yield from differences(one, other, relative, f"{at}[{number}]")
    elif not _same(was, now, relative):
        yield f"{at}: {_short(was)} → {_short(now)}"


def _same(was: Any, now: Any, relative: float) -> bool:
    numbers = all(isinstance(one, int | float) and not isinstance(one, bool) for one in (was, now))
    if numbers and relative > 0.0:
        return math.isclose(was, now, rel_tol=relative, abs_tol=1e-9)
    return was == now and type(was) is type(now)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 200 else f"{text[:200]} … ({len(text)} characters)"
