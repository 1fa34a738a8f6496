"""Four runs of ten minutes with 60 channels: the tests' runs, repeated."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from lacet.daq.formats.exchange import write_table
from lacet.daq.formats.open_run import open_run
from lacet.daq.run import Signal

CAR = Path(__file__).parents[2] / "tests" / "data" / "car"
NAMES = ("sine", "rough", "sweep", "liftoff")
SECONDS, RATE, CHANNELS = 600, 250, 60
"""Length of a run [s], samples a second, columns of its table beside the time."""
SPREAD = 1e-3
"""Noise added to each sample, of its channel's standard deviation: so that no two seconds compress into one."""


def make_runs(folder: Path) -> None:
    """Write the runs, their rig and their vehicle into a study's folder, unless they are there already."""
    files = [folder / "runs" / f"{name}.parquet" for name in NAMES]
    if all(file.is_file() for file in files):
        return
    (folder / "runs").mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(1)
    samples = SECONDS * RATE
    t, sound = np.arange(samples) / RATE, np.zeros(samples, np.uint8)
    for file in files:
        run = open_run(CAR / file.name)
        signals = {}
        for name, s in run.signals.items():
            values = np.resize(s.values, (samples, s.values.shape[1]))
            signals[name] = Signal(t, values + SPREAD * s.values.std(0) * rng.standard_normal(values.shape), sound)
        signals["shaft.fl.torque"] = Signal(t, 100.0 * rng.standard_normal((samples, 1)), sound)
        assert sum(s.values.shape[1] for s in signals.values()) == CHANNELS
        write_table(replace(run, name=file.stem, signals=signals), file)
    for name in ("rig.toml", "vehicle.toml"):
        shutil.copy(CAR / name, folder / name)
