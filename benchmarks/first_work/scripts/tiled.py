"""One long run out of tables driven one after the other, again and again: python tiled.py OUT MINUTES TABLE…"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from lacet.daq.formats.exchange import write_table
from lacet.daq.formats.open_run import open_run
from lacet.daq.run import Signal

PAUSE = 1.0
"""Between two tables nothing is recorded [s]."""


def main() -> None:
    """Write the table. Between one and the next is a pause, as if the recorder had been stopped: nothing jumps."""
    out, minutes, runs = sys.argv[1], float(sys.argv[2]), [open_run(file) for file in sys.argv[3:]]
    signals: dict[str, Signal] = {}
    for name, first in runs[0].signals.items():
        step = float(np.median(np.diff(first.t)))
        parts = [run.signals[name] for run in runs]
        length = sum(len(part.t) for part in parts)
        parts *= max(1, round(minutes * 60.0 / (length * step)))
        starts = np.cumsum([first.t[0], *(len(part.t) * step + PAUSE for part in parts[:-1])])
        t = np.concatenate([start + part.t - part.t[0] for start, part in zip(starts, parts, strict=True)])
        values, flags = (np.concatenate([getattr(part, which) for part in parts]) for which in ("values", "flags"))
        signals[name] = Signal(t, values, flags)
    write_table(replace(runs[0], signals=signals), out)


main()
