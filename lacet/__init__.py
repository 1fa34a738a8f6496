"""lacet: data acquisition and dynamic-parameter identification for an instrumented car."""

from __future__ import annotations

from pathlib import Path as _Path

_ROOMS = ("daq", "drivers", "identify", "services", "simulate")
_without_links = [name for name in _ROOMS if not (_Path(__file__).parent / name).is_dir()]
if _without_links:  # a checkout on Windows: git has written the links as small text files
    raise ImportError(
        f"this checkout of lacet has no working links ({', '.join(f'lacet/{name}' for name in _without_links)}). "
        "Install the wheel instead (pip install lacet), or let git make links: turn on Windows' developer mode, "
        "then run 'git config core.symlinks true' and 'git checkout -- lacet' in the checkout."
    )
