"""A trial from its number: a car, a rig, runs and hidden effects, and the folder of tables that is given away."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.making import cropped
from benchmarks.fresh.cars import fresh_car, fresh_rig
from benchmarks.fresh.drives import drawn_drives
from benchmarks.fresh.laws import CLASSES, FAULTS, Part, drawn_parts
from benchmarks.fresh.sizing import Suspension, measurable, roots
from lacet.daq.formats.exchange import write_table
from lacet.daq.rig import Rig
from lacet.simulate import Car, CarMotion, Hidden, Manoeuvre, Sheet, SimulationFailed, exchange_run
from lacet.simulate import run as simulate_drive
from lacet.simulate.linkage import SecondCar
from lacet.simulate.vehicle_file import vehicle_text

SETS = ("development", "test")
TESTABLE = 15.0
"""Least √λ of a hidden effect beside all others, by `sizing`; by the identification's own equations about 12."""
MOST = 66.0
"""Largest √λ of a part that is sized by it."""
TURNS = 4
"""Simulations to get sizes right."""
DRAWS = 12
"""Draws of what is hidden on one car, before another car is drawn."""
ATTEMPTS = 20


def class_of(number: int) -> str:
    """Class of a trial: they take turns."""
    return CLASSES[number % len(CLASSES)]


def stream(name: str, number: int, *words: object) -> np.random.Generator:
    """Random numbers of a trial of a set: streams of two sets, trials or purposes have nothing in common."""
    if name not in SETS:
        raise ValueError(f"no set is called '{name}': {', '.join(SETS)}")
    text = " ".join(map(str, ("lacet fresh 1", name, number, *words)))
    return np.random.default_rng(int.from_bytes(hashlib.sha256(text.encode()).digest()[:16], "big"))


@dataclass(frozen=True)
class Trial:
    """All of a trial but its noise.

    `parts` what is hidden, with `roots`, √λ of each (NaN where it is not computed); `usual` whether sizes are those
    usual on cars instead of drawn by √λ; `measured` effects that the instruments see and no model lacks.
    """

    name: str
    number: int
    attempt: int
    car: Car | SecondCar
    rig: Rig
    used: Mapping[str, Manoeuvre]
    held: Mapping[str, Manoeuvre]
    measured: tuple[Hidden, ...]
    parts: tuple[Part, ...]
    roots: tuple[float, ...]
    usual: bool
    motions: Mapping[str, CarMotion]

    @property
    def kind(self) -> str:
        """Its class."""
        return class_of(self.number)

    @cached_property
    def sheet(self) -> Sheet:
        """Errors of its instruments, drawn from the sensor sheet."""
        seed = int(stream(self.name, self.number, "instruments").integers(2**31))
        return Sheet(zeros=True, gains=True, latencies=True, seed=seed)

    def truth(self) -> dict[str, Any]:
        """What is hidden, and all that was drawn, as plain data."""
        return {
            "set": self.name,
            "trial": self.number,
            "class": self.kind,
            "attempt": self.attempt,
            "sizes": "usual" if self.usual else "by √λ",
            "measured": [[h.name, h.size] for h in self.measured],
            "parts": [part.truth(root) for part, root in zip(self.parts, self.roots, strict=True)],
            "runs": {
                run: {"use": use, "manoeuvre": one.name, **asdict(one)}
                for use, runs in (("used", self.used), ("held", self.held))
                for run, one in runs.items()
            },
            "car": self.car.truth(),
        }


class Unsized(Exception):
    """What was drawn cannot be made testable on these runs."""


class Drive:
    """A car's runs used, simulated with whatever is hidden."""

    car: Car | SecondCar
    suspensions: Mapping[str, Suspension] | None = None
    """Of a car on linkages."""

    def __init__(self, name: str, number: int, attempt: int):
        rng = stream(name, number, "car", attempt)
        self._draw(fresh_car(rng, "fresh"), rng)

    def _draw(self, car: Car | SecondCar, rng: np.random.Generator) -> None:
        """Rig, runs and roads of a car."""
        self.car, self.rig = car, fresh_rig(rng, "fresh")
        self.used, self.held = drawn_drives(car.sizes if isinstance(car, SecondCar) else car, rng)
        self.measured: tuple[Hidden, ...] = ()
        if rng.random() < 0.5:
            self.measured = tuple(
                Hidden(f"{kind}.{axle}", float(f"{rng.uniform(*bounds):.4g}"))
                for kind, bounds in (("rolling_resistance", (0.002, 0.008)), ("camber_thrust", (0.3, 0.9)))
                for axle in ("front", "rear")
            )
        self._roads = [int(seed) for seed in rng.integers(1, 2**31, len(self.used) + len(self.held))]

    def motions(self, runs: Mapping[str, Manoeuvre], parts: Sequence[Part]) -> dict[str, CarMotion]:
        hidden = [*self.measured, *(part.hidden for part in parts if not part.hidden.of_sensor)]
        names = [*self.used, *self.held]
        return {run: simulate_drive(self.car, runs[run], hidden, self._roads[names.index(run)]) for run in runs}

    @cached_property
    def tolerance(self) -> dict[str, float]:
        """Fault of an instrument → what the sensor sheet allows of it."""
        return {name: self.rig.tolerance(channel, entry) for name, channel, entry, _ in FAULTS}

    @cached_property
    def bare(self) -> list[CarMotion]:
        """The runs used with nothing hidden."""
        return list(self.motions(self.used, ()).values())


def sized(drive: Drive, parts: Sequence[Part], usual: bool) -> tuple[list[Part], list[float], dict[str, Any]]:
    """Parts of a size that makes each testable beside the others, their √λ, and the motions with them hidden.

    Raises Unsized where a part would be larger than is plausible, or the sizes do not settle.
    """
    mechanical = [i for i, part in enumerate(parts) if measurable(part)]
    now = [part if i in mechanical else part.of_size(part.usual) for i, part in enumerate(parts)]
    first = roots(now, drive.bare, drive.rig, drive.suspensions) if mechanical else []  # of size 1
    for i in mechanical:
        part, root = parts[i], first[i]
        if not root > 0.0:
            raise Unsized
        wanted = part.usual if usual and abs(part.usual) * root >= TESTABLE else part.hidden.size * part.goal / root
        now[i] = _plausible(part, wanted)
    for _ in range(TURNS):
        motions = drive.motions(drive.used, now)
        found = roots(now, list(motions.values()), drive.rig, drive.suspensions)
        low = [i for i in mechanical if found[i] < TESTABLE]
        high = [i for i in mechanical if found[i] > MOST and not usual]
        if not low and not high:
            return now, found, motions
        for i in [*low, *high]:
            now[i] = _plausible(parts[i], now[i].hidden.size * parts[i].goal / max(found[i], 1e-3))
    raise Unsized


def _plausible(part: Part, size: float) -> Part:
    if not abs(size) <= abs(part.law.largest):
        raise Unsized
    return part.of_size(size)


def make(name: str, number: int) -> Trial:
    """The trial of a number of a set: always the same one.

    Half of the trials have sizes usual on cars (more, where that is not testable), half have √λ drawn. What cannot be
    made testable on the car's runs is drawn anew, as is a car that leaves the road. Raises RuntimeError when no draw is
    possible.
    """
    for attempt in range(ATTEMPTS):
        drive = Drive(name, number, attempt)
        for draw in range(DRAWS):
            rng = stream(name, number, "effects", attempt, draw)
            usual = bool(rng.random() < 0.5)
            parts = drawn_parts(class_of(number), rng, drive.tolerance)
            try:
                now, found, motions = sized(drive, parts, usual)
                held = drive.motions(drive.held, now)
            except (Unsized, SimulationFailed):
                continue
            return Trial(
                name, number, attempt, drive.car, drive.rig, drive.used, drive.held, drive.measured, tuple(now),
                tuple(found), usual, {**motions, **held},
            )  # fmt: skip
    raise RuntimeError(f"trial {number} of {name}: no car and effects in {ATTEMPTS * DRAWS} draws")


def write(trial: Trial, folder: Path) -> Path:
    """``used/*.parquet``, ``held/*.parquet``, ``rig.toml`` and ``vehicle.toml`` in a folder: all that is given away."""
    faults = [part.hidden for part in trial.parts if part.hidden.of_sensor]
    for use, runs in (("used", trial.used), ("held", trial.held)):
        (folder / use).mkdir(parents=True, exist_ok=True)
        for run, manoeuvre in runs.items():
            noise = int(stream(trial.name, trial.number, "noise", run).integers(2**31))
            table = exchange_run(trial.motions[run], trial.rig, noise, faults=faults, sheet=trial.sheet, name=run)
            write_table(cropped(table, manoeuvre.duration), folder / use / f"{run}.parquet")
    (folder / "rig.toml").write_text(trial.rig.text, encoding="utf-8")
    (folder / "vehicle.toml").write_text(vehicle_text(trial.car), encoding="utf-8")
    return folder


def write_truth(trial: Trial, file: Path) -> None:
    """What is hidden, for scoring by hand; kept out of the trial's folder."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(trial.truth(), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
