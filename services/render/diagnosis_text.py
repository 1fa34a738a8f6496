"""Rankings of missing effects in print, and how far the error fell when one was added."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lacet.services.render import tables


def print_diagnosis(result: Mapping[str, Any], most: int, why: bool) -> None:
    """Print the verdict and the ranking."""
    print(f"{result['says']}\n\n{tables.candidates(result, most)}\n", flush=True)
    if why:
        for c in result["candidates"]:
            print(f"  {c['effect']}: {c['why']}")


def print_change(item: Mapping[str, Any], what: str = "Added") -> None:
    """One line: how far the error fell."""
    used, held = item["used"], item["held"]
    text = f"{what} {item['effect']}: error ÷ floor {used['before']:.2f} → {used['after']:.2f} on the runs used"
    if held["before"] == held["before"]:
        text += f", {held['before']:.2f} → {held['after']:.2f} on those held out"
    print(f"{text}.\n", flush=True)
