"""A trial from its number: a fresh car with one law hidden at an axle or a wheel, and the tables of its runs."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.making import cropped
from benchmarks.fresh.cars import fresh_car, fresh_rig
from benchmarks.fresh.drives import drawn_drives
from benchmarks.laws.forms import SETS, Force, Form, Rate
from lacet.daq.channels import CORNERS
from lacet.daq.formats.exchange import write_table
from lacet.simulate import Manoeuvre, OwnLaw, Sheet, SimulatedMotion, SimulationFailed, exchange_run
from lacet.simulate import run as simulate_drive
from lacet.simulate.vehicle_file import vehicle_text

FORCE = (60.0, 180.0)
"""Force of the law on the run used on which it is largest, what a spring and a damper could do left out [N RMS]."""
USED = 3
"""Runs used: sinus, braking and rough; one more is held out."""
CORNER = 0.25
"""Chance that a law acts at one wheel alone, where it can."""


@dataclass(frozen=True)
class Hidden:
    """What is hidden: a form with its constants, at a place, so large."""

    form: Form
    constants: Mapping[str, float]
    where: str
    size: float

    def law(self) -> OwnLaw:
        """The law for the simulator."""
        force, rate = self.form.make(self.constants)
        size = self.size
        return OwnLaw(self.where, lambda s, v, S, V, z: (size * force(s, v, S, V, z), rate(s, v, z)))

    def truth(self) -> dict[str, Any]:
        """The same as plain data."""
        return {"law": self.form.text, "constants": dict(self.constants), "where": self.where, "size": self.size}


def stream(name: str, number: int, *words: object) -> np.random.Generator:
    """Random numbers of a trial of a set."""
    text = " ".join(map(str, ("lacet laws 1", name, number, *words)))
    return np.random.default_rng(int.from_bytes(hashlib.sha256(text.encode()).digest()[:16], "big"))


def write(name: str, number: int, folder: Path) -> dict[str, Any]:
    """Tables, rig and vehicle file of a trial in a folder, all that is given away; what is hidden is returned."""
    form = SETS[name][number]
    for attempt in range(20):
        rng = stream(name, number, attempt)
        car, rig = fresh_car(rng, "laws"), fresh_rig(rng, "laws")
        used, held = drawn_drives(car, rng)
        runs = {**dict(list(used.items())[:USED]), **held}
        roads = {run: int(rng.integers(1, 2**31)) for run in runs}
        constants = {key: float(f"{rng.uniform(*bounds):.4g}") for key, bounds in form.constants.items()}
        where = str(rng.choice(["front", "rear"]))
        if not form.across and rng.random() < CORNER:
            where = str(rng.choice(CORNERS))
        goal = float(np.exp(rng.uniform(*np.log(FORCE))))
        try:
            bare = [simulate_drive(car, runs[run], (), roads[run]) for run in runs if run in used]
            largest = max(_bent(form.make(constants), motion, where) for motion in bare)
            hidden = Hidden(form, constants, where, goal / largest)
            motions = {run: simulate_drive(car, runs[run], (), roads[run], own=[hidden.law()]) for run in runs}
        except (SimulationFailed, OverflowError):
            continue
        seed = int(rng.integers(2**31))
        sheet = Sheet(zeros=True, gains=True, latencies=True, seed=seed)
        for index, (run, motion) in enumerate(motions.items()):
            part = folder / ("held" if run in held else "used")
            part.mkdir(parents=True, exist_ok=True)
            table = exchange_run(motion, rig, seed + 1 + index, sheet=sheet, name=run)
            write_table(cropped(table, runs[run].duration), part / f"{run}.parquet")
        (folder / "rig.toml").write_text(rig.text, encoding="utf-8")
        (folder / "vehicle.toml").write_text(vehicle_text(car), encoding="utf-8")
        return {**hidden.truth(), "runs": _speeds(runs)}
    raise RuntimeError(f"trial {number} of {name}: no car stays on its wheels with it")


def _speeds(runs: Mapping[str, Manoeuvre]) -> dict[str, float]:
    return {run: one.speed for run, one in runs.items()}


def _bent(law: tuple[Force, Rate], motion: SimulatedMotion, where: str) -> float:
    """RMS of a law of size 1 on a motion, beside a constant, a spring and a damper."""
    corner = CORNERS.index(where if where in CORNERS else f"{where[0]}l")
    (force, rate), step = law, 1.0 / motion.rate
    s, v = motion.travel[:, 0, corner], motion.travel[:, 1, corner]
    far, fast = motion.travel[:, 0, corner ^ 1], motion.travel[:, 1, corner ^ 1]
    z, values = 0.0, np.empty(s.size)
    for k, now in enumerate(zip(s.tolist(), v.tolist(), far.tolist(), fast.tolist(), strict=True)):
        values[k] = force(*now, z)
        z += step * rate(now[0], now[1], z)
    plain = np.column_stack([np.ones_like(s), s, v])
    rest = values - plain @ np.linalg.lstsq(plain, values, rcond=None)[0]
    return math.sqrt(float(np.mean(rest**2)))
