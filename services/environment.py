"""Is this environment fit to run lacet? Its folders have plain names that a foreign package may carry as well.

The standard library only, and nothing of lacet: it must work where lacet does not. The Makefile runs this file itself.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterable
from importlib.metadata import packages_distributions
from pathlib import Path

FOLDERS = ("daq", "drivers", "identify", "services", "simulate")
"""lacet's top-level packages."""

HOME = Path(__file__).resolve().parent.parent
"""The folder they lie in."""


def foreign_packages(names: Iterable[str] = FOLDERS, home: Path = HOME) -> dict[str, str]:
    """Packages that stand in the place of lacet's own: name → where it lies, and which distribution brought it.

    A package found elsewhere than in `home` hides lacet's. Where lacet is itself installed in site-packages, the
    files of both lie in one folder, and the distributions' own lists tell.
    """
    out: dict[str, str] = {}
    for name in names:
        spec = importlib.util.find_spec(name)
        if spec is None:
            continue
        place = Path(next(iter(spec.submodule_search_locations or []), spec.origin or "")).resolve()
        if place != home / name:
            out[name] = str(place)
    if not out and home.name not in ("site-packages", "dist-packages"):
        return out
    owners = packages_distributions()
    for name in names:
        others = sorted({owner for owner in owners.get(name, []) if owner != "lacet"})
        if others:
            out[name] = f"{out.get(name, home / name)}, installed by '{', '.join(others)}'"
    return out


def complaint(foreign: dict[str, str]) -> str:
    """What to tell the user, empty when all is well."""
    if not foreign:
        return ""
    lines = [f"  - '{name}' at {place}" for name, place in foreign.items()]
    return "\n".join(
        [
            "foreign packages in this Python environment have the names of lacet's own folders:",
            *lines,
            "Give lacet an environment of its own: run 'make clean' and 'make demo' in lacet's folder, or make a new",
            "one with 'python3 -m venv' and install lacet alone in it. (pre-commit brings a package named 'identify':",
            "keep it outside, for example with pipx.)",
        ]
    )


def main() -> int:
    """Print the complaint, if any. Returns 0 when the environment is fit, 2 when not."""
    text = complaint(foreign_packages())
    if text:
        print(f"lacet: {text}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
