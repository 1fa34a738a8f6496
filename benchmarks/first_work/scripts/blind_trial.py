"""One blind trial, in either commit: python blind_trial.py make | try CELL FOLDER DRAWS, or nothing but the imports.

`make` writes its tables into FOLDER, `try` identifies from them and scores the answer.
"""

from __future__ import annotations

import sys
from pathlib import Path

import scipy.linalg  # noqa: F401  (its threads are limited too, whichever commit is measured)
from threadpoolctl import threadpool_limits

from benchmarks.blind.cases import cells
from benchmarks.blind.scoring import tables_of, trial

SEED = 1
"""Of a cell's trials this one simulates a noise floor of its own, as a user's ranking does."""


def main() -> None:
    """Run it."""
    if len(sys.argv) < 2:
        return
    task, name, folder, draws = sys.argv[1:]
    cell = cells()[name]
    with threadpool_limits(1):  # as the blind benchmark does
        if task == "make":
            tables_of(cell, SEED, Path(folder))
        else:
            record = trial(cell, SEED, Path(folder), int(draws))
            if "failed" in record:
                raise SystemExit(record["failed"])
            print(record["added"])


main()
