"""Curves of a run for a page that draws them itself: measured, modelled and error by row, packed small.

A curve is its samples, or the lowest and the highest of each block of them in turn where there are more than the page
has room for. Values are whole numbers of 16 bits between the curve's ends; one of them marks a hole.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lacet.identify.car.rows import Row
from lacet.identify.validation.score import Comparison
from lacet.services.render.figures.envelope import block_extremes
from lacet.services.render.figures.panels import ERROR, MODEL
from lacet.services.render.figures.study_plots import row_title

SCRIPT = Path(__file__).with_name("curves.js").read_text(encoding="utf-8")
"""What draws the curves, once in a page."""
SCRIPT_HASH = "sha256-" + base64.b64encode(hashlib.sha256(SCRIPT.encode()).digest()).decode()
"""Its digest as a content security policy names it."""
STYLE = f"""
b.model {{ color: {MODEL}; }} b.error {{ color: {ERROR}; }}
.curves {{ display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 520px), 1fr)); gap: 4px 16px; }}
.curves figure {{ margin: 0; }}
.curves figcaption {{ font-size: 0.8rem; font-variant-numeric: tabular-nums; min-height: 2.6em; }}
.curves canvas {{ width: 100%; height: 150px; display: block; cursor: crosshair; touch-action: pan-y; }}
"""
ROOM = 600_000
"""Room for the curves of all runs in a page [bytes]."""
MOST, LEAST = 4000, 200
"""Largest and smallest number of values of a curve."""
_HOLE = 65535
_BYTES = 8.0 / 3.0
"""Bytes of a value: two, written with four characters for three of them."""


def room_of(parts: Sequence[Comparison]) -> int:
    """Values of each curve, so that those of all runs have room in a page."""
    curves = 3 * sum(len(part.measured) for part in parts)
    return int(min(MOST, max(LEAST, ROOM / (_BYTES * max(curves, 1)))))


def curves_html(part: Comparison, values: int) -> str:
    """The curves of a run as an element; `values` : most of each curve."""
    rows = [_row(part, row, values) for row in part.measured]
    body = json.dumps(rows, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")
    return f'<div class="curves"><script type="application/json">{body}</script></div>'


def _row(part: Comparison, row: Row, values: int) -> dict[str, Any]:
    t, score = part.t[row], part.scores[row]
    dt = float(np.median(np.diff(t)))
    place = np.round((t - t[0]) / dt).astype(np.intp)
    series = (
        ("measured", "ink", 1.4, part.measured[row]), ("modelled", MODEL, 1.1, part.modelled[row]),
        ("error (about the mean)", ERROR, 0.9, part.residual(row) + float(np.mean(part.measured[row]))),
    )  # fmt: skip
    count = int(place[-1]) + 1
    block = 1 if count <= values else -(-2 * count // values)
    packed: list[dict[str, Any]] = []
    for name, colour, width, own in series:
        grid = np.full(count, np.nan, np.float32)
        grid[place] = own
        drawn = grid if block == 1 else np.stack(block_extremes(grid, block), axis=1).ravel()
        packed.append({"name": name, "colour": colour, "width": width, "n": drawn.size, **pack(drawn)})
    return {
        "row": row, "title": row_title(part, row), "unit": score.unit, "bad": not score.judged,
        "t0": round(float(t[0]), 4), "dt": dt if block == 1 else 0.5 * block * dt, "n": packed[0]["n"],
        "series": [{key: value for key, value in one.items() if key != "n"} for one in packed],
    }  # fmt: skip


def pack(values: NDArray[np.float32]) -> dict[str, Any]:
    """A curve as its lowest value, the size of a step, and whole numbers of steps in base 64."""
    good = np.isfinite(values)
    low, high = (float(values[good].min()), float(values[good].max())) if good.any() else (0.0, 0.0)
    step = (high - low) / (_HOLE - 1) or 1.0
    codes = np.full(values.size, _HOLE, "<u2")
    codes[good] = np.round((values[good] - low) / step).astype("<u2")
    return {"low": low, "step": step, "data": base64.b64encode(codes.tobytes()).decode()}
