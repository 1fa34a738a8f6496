"""One long run out of tables driven one after the other, again and again: python tiled.py OUT MINUTES TABLE…"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from lacet.daq.formats.exchange import write_table
from lacet.daq.formats.open_run import open_run
from lacet.daq.run import Signal


def main() -> None:
    """Write the table. Where one ends and the next begins the signals jump, as nothing in a car does."""
    out, minutes, runs = sys.argv[1], float(sys.argv[2]), [open_run(file) for file in sys.argv[3:]]
    signals: dict[str, Signal] = {}
    for name, first in runs[0].signals.items():
        step = float(np.median(np.diff(first.t)))
        parts = [run.signals[name] for run in runs]
        length = sum(len(part.t) for part in parts)
        times = max(1, round(minutes * 60.0 / (length * step)))
        values = np.tile(np.concatenate([part.values for part in parts]), (times, 1))
        flags = np.tile(np.concatenate([part.flags for part in parts]), times)
        signals[name] = Signal(first.t[0] + step * np.arange(length * times), values, flags)
    write_table(replace(runs[0], signals=signals), out)


main()
