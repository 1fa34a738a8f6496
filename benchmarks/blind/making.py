"""What a trial gives away: exchange tables of the runs, the rig's and the vehicle's file. Nothing else leaves here."""

from __future__ import annotations

import ast
import hashlib
import os
import pickle
import shutil
import zlib
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.blind.cases import Cell
from lacet.daq.channels import CHANNELS
from lacet.daq.formats.exchange import write_table
from lacet.daq.rig import Rig
from lacet.daq.run import Run, Signal
from lacet.simulate import Hidden, Sheet, SimulatedMotion, exchange_run, find_car, make_manoeuvre
from lacet.simulate import run as simulate_drive
from lacet.simulate.vehicle_file import vehicle_text

HOME = Path(__file__).parents[2]
BUILD = HOME / "build" / "blind"
EDGE = 0.15
"""Left out at both ends of a run [s], so that tables are alike whatever latencies were drawn."""


def code_of(*folders: str) -> str:
    """Digest of the sources in some folders, but for what they say: results of other code are not mixed."""
    digest = hashlib.sha256()
    for folder in folders:
        for file in sorted((HOME / folder).rglob("*.py")):
            said = without_words(file.read_text(encoding="utf-8"))
            digest.update(file.relative_to(HOME).as_posix().encode() + b"\0" + said.encode())
    return digest.hexdigest()[:12]


def without_words(source: str) -> str:
    """Python source without comments and docstrings, laid out alike."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [one for one in body if not _is_text(one)] or [ast.Pass()]
    return ast.unparse(tree)


def _is_text(statement: object) -> bool:
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )


@cache
def simulator_code() -> str:
    """Digest of the simulator."""
    return code_of("simulate")


_latest: dict[Path, dict[str, SimulatedMotion]] = {}


def _folder(cell: Cell) -> Path:
    """Where a motion is kept: by what decides it. Faults of the instruments are not part of a motion."""
    words = "; ".join(f"{h.name}={h.size!r},{sorted(h.shape.items())}" for h in _mechanical(cell))
    key = hashlib.sha256(f"{cell.campaign} {cell.road} {words}".encode()).hexdigest()[:16]
    return BUILD / f"motions-{simulator_code()}" / key


def _mechanical(cell: Cell) -> tuple[Hidden, ...]:
    return tuple(h for h in cell.hidden if not h.of_sensor)


def motions(cell: Cell) -> dict[str, SimulatedMotion]:
    """Every run, simulated once and kept in ``build/``."""
    folder, campaign = _folder(cell), cell.campaign
    if folder not in _latest:
        found: dict[str, SimulatedMotion] = {}
        for index, name in enumerate((*campaign.used, *campaign.held)):
            file = folder / f"{name}.pickle"
            if file.is_file():
                found[name] = pickle.loads(file.read_bytes())
                continue
            manoeuvre, seed = make_manoeuvre(name, duration=campaign.duration), 1000 * (cell.road + 1) + index
            found[name] = simulate_drive(find_car(campaign.car), manoeuvre, _mechanical(cell), seed)
            folder.mkdir(parents=True, exist_ok=True)
            part = file.with_suffix(f".{os.getpid()}")
            part.write_bytes(pickle.dumps(found[name]))
            part.replace(file)
        _latest.clear()  # 90 MB each: one at a time
        _latest[folder] = found
    return _latest[folder]


def forget(cell: Cell) -> None:
    """Delete stored motions that no other cell shares."""
    if _mechanical(cell):
        shutil.rmtree(_folder(cell), ignore_errors=True)


def drifts(rig: Rig, rng: np.random.Generator) -> tuple[Hidden, ...]:
    """Each column's zero off by one more draw of its tolerance, and moving by a draw of the sheet's drift."""
    out: list[Hidden] = []
    for sensor in rig.sensors:
        for channel in sensor.channels:
            for column in CHANNELS[channel].columns:
                for fault, entry in (("sensor_zero", "zero"), ("sensor_drift", "drift")):
                    tolerance = rig.tolerance(channel, entry)
                    if tolerance > 0.0:
                        out.append(Hidden(fault, tolerance * float(rng.standard_normal()), where=column))
    return tuple(out)


def measured(cell: Cell, seed: int, noise: float | None = None, tolerances: bool = True) -> dict[str, Run]:
    """The runs of a trial. The oracle's instruments may have other `noise` than the cell says, and no `tolerances`."""
    rig = Rig.load(cell.campaign.rig)
    drawn = zlib.crc32(f"{cell.name} {seed}".encode())
    sheet = Sheet(zeros=tolerances, gains=tolerances, latencies=tolerances, seed=drawn)
    noise = cell.noise if noise is None else noise
    faults = tuple(h for h in cell.hidden if h.of_sensor)
    out: dict[str, Run] = {}
    for index, (name, motion) in enumerate(motions(cell).items()):
        extra = drifts(rig, np.random.default_rng([drawn, index])) if cell.drift and tolerances else ()
        run = exchange_run(
            motion, rig, drawn + 7919 * (index + 1), faults=(*faults, *extra), sheet=sheet,
            noise=noise,
        )  # fmt: skip
        out[name] = cropped(run, cell.campaign.duration)
    return out


def cropped(run: Run, duration: float) -> Run:
    """A run without its edges, stamps from the run's start."""
    signals: dict[str, Signal] = {}
    for name, s in run.signals.items():
        inside = (s.t >= EDGE - 1e-9) & (s.t <= duration - EDGE + 1e-9)
        signals[name] = Signal(s.t[inside], s.values[inside], s.flags[inside])
    return replace(run, signals=signals)


def write_trial(folder: Path, cell: Cell, seed: int, noise: float | None = None, tolerances: bool = True) -> Path:
    """``used/*.parquet``, ``held/*.parquet``, ``rig.toml`` and ``vehicle.toml`` in a folder: all that is given away."""
    for part in ("used", "held"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    for name, run in measured(cell, seed, noise, tolerances).items():
        write_table(run, folder / ("used" if name in cell.campaign.used else "held") / f"{name}.parquet")
    (folder / "rig.toml").write_text(Rig.load(cell.campaign.rig).text, encoding="utf-8")
    (folder / "vehicle.toml").write_text(vehicle_text(find_car(cell.campaign.car)), encoding="utf-8")
    return folder
