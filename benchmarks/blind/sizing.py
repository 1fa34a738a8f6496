"""How large a hidden effect is made: by the √λ of an oracle, which knows the law and its constants.

√λ of an effect of known size is the length of its columns times the true values, in units of each row's noise floor,
after everything that may pass for it is partialled out: the model's parameters, each run's zeros and the sheet's gains
and latencies, with their priors. It grows with the size: the motion of a car without the effect gives a first size, one
simulation with it checks that (noise as the sheet says, no zeros or tolerances drawn). What no candidate stands for is
measured by what it leaves in runs without noise.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.cases import BANDS, CAUSE_BANDS, CAUSES, SINGLES, SIZES, TOLERANCES, Cell, Part
from benchmarks.blind.identifying import Tables, floor, tables
from benchmarks.blind.making import BUILD, forget, write_trial
from lacet.daq.errors import LacetError
from lacet.identify.effects.base import Effect
from lacet.identify.regression.sensor_offsets import zeros_of
from lacet.identify.regression.tolerances import sheet_responses
from lacet.identify.regression.wls import Fit, FitOptions, fit

Array = NDArray[np.float64]
TURNS = 3
"""Simulations to get a size right."""
DRAWS = 20


class Oracle:
    """What may pass for an effect on some runs, to be partialled out of it.

    `sigma` row → weight; a fault's own entry of the sheet (`own`) does not excuse it.
    """

    def __init__(self, fitted: Fit, sigma: dict[str, float], own: Effect | None):
        self.fitted, self.sigma = fitted, sigma
        self.rows = [(d, row) for d, run in enumerate(fitted.runs) for row in run.rows]
        sensitivities = fitted.sensitivities
        keep, effects = fitted.base.independent, fitted.model.physics
        physics = np.concatenate([fitted.runs[d].matrix(effects, row)[:, keep] / sigma[row] for d, row in self.rows])
        priors = [fitted.model.parameters[int(i)].prior for i in keep]
        blocks = [physics]
        for d, (run, sensitivity) in enumerate(zip(fitted.runs, sensitivities, strict=True)):
            zeros = zeros_of(run, sensitivity)
            blocks.append(
                self.stacked([zeros.columns if k == d else {} for k in range(len(fitted.runs))], len(zeros.names))
            )
            priors += zeros.sigma.tolist()
        responses = [sheet_responses(d, s) for d, s in zip(fitted.runs, sensitivities, strict=True)]
        ours = own.sheet_entries if own else frozenset[tuple[str, str]]()
        for entry in dict.fromkeys(entry for part in responses for entry in part):
            if entry[:2] not in ours:
                parts = [{row: a[:, None] for row, a in part.get(entry, {}).items()} for part in responses]
                blocks.append(self.stacked(parts, 1))
                priors.append(1.0)
        columns = np.column_stack(blocks)
        columns = np.concatenate([columns, np.diag(1.0 / np.array(priors))])
        lengths = np.linalg.norm(columns, axis=0)
        self.q = np.linalg.qr(columns[:, lengths > 0] / lengths[lengths > 0])[0]

    def stacked(self, parts: Sequence[dict[str, Array]], width: int) -> Array:
        """(n, width) of row → (n_row, width) by drive, weighted."""
        out: list[Array] = []
        for d, row in self.rows:
            n = len(self.fitted.runs[d].index[row])
            out.append(parts[d].get(row, np.zeros((n, width))) / self.sigma[row])
        return np.concatenate(out)

    def columns(self, effect: Effect) -> Array:
        """(n, p) of an effect or a fault."""
        runs = self.fitted.runs
        found = [d.effect_columns(effect, s) for d, s in zip(runs, self.fitted.sensitivities, strict=True)]
        return self.stacked([{row: a.T for row, a in part.items()} for part in found], len(effect.parameters))

    def left(self, series: Array) -> float:
        """Length of a weighted series (n,) after partialling."""
        return float(np.linalg.norm(self.partial(series)))

    def partial(self, series: Array) -> Array:
        """What of a weighted series (n,) nothing else explains; priors below it."""
        padded = np.concatenate([series, np.zeros(len(self.q) - len(series))])
        rest = padded - self.q @ (self.q.T @ padded)
        rest -= self.q @ (self.q.T @ rest)
        return rest

    def force(self, effect: Effect, values: Sequence[float]) -> Array:
        """(n,) what an effect with these parameter values does."""
        columns = self.columns(effect)
        padded = np.zeros(columns.shape[1])
        padded[: len(values)] = values
        return columns @ padded

    def root_lambda(self, effect: Effect, values: Sequence[float]) -> float:
        """√λ of an effect with these parameter values, were its columns free of noise."""
        return self.left(self.force(effect, values))

    def stands_out(self, effect: Effect, values: Sequence[float]) -> float:
        """√λ as these runs have it: the effect is looked for in what the model leaves of them.

        Noise in what its columns are made of hides a part: of dry friction at small travel rates more than half.
        """
        force = self.force(effect, values)
        return float(np.sum(self.partial(force) * self.partial(self.measured()))) / self.left(force)

    def measured(self) -> Array:
        """(n,) left sides of the equations, weighted."""
        return np.concatenate([self.fitted.runs[d].measured[row] / self.sigma[row] for d, row in self.rows])

    def excess(self) -> float:
        """√ of the weighted squares that a model leaves of its own runs."""
        return self.left(self.measured())


def true_effect(part: Part, found: Tables) -> Effect:
    """The catalogue's effect with the true constants. Raises KeyError when it has none of that name."""
    effect = found.known[part.key]
    return replace(effect, shape={**effect.shape, **part.constants})


def _cell(part: Part, size: float) -> Cell:
    return Cell(f"size/{part.hidden}", "single", "", 1, (part,), (part.of_size(size),))


def look(part: Part, size: float, folder: Path) -> float:
    """√λ of one effect of this size, simulated."""
    cell = _cell(part, size)
    shutil.rmtree(folder, ignore_errors=True)
    sigma = _nothing_hidden()[2]
    write_trial(folder, cell, 0, 1.0 if part.key else 0.0, tolerances=False)
    found = tables(folder)
    fitted = fit(found.model(()), found.used, FitOptions(unbias=False))
    if not part.key:
        return Oracle(fitted, sigma, None).excess()
    effect = true_effect(part, found)
    return Oracle(fitted, sigma, effect).stands_out(effect, true_values(part, size))


def true_values(part: Part, size: float) -> list[float]:
    """The catalogue's parameters; the size where the laws differ and they are not known."""
    return [v * size for v in part.values or (1.0,)]


@cache
def _nothing_hidden() -> tuple[Tables, Fit, dict[str, float]]:
    """Tables of the car as it is, with fit and floor."""
    folder = BUILD / "sizing" / "nothing"
    if not (folder / "vehicle.toml").is_file():
        write_trial(folder, Cell("size/nothing", "null", "", 1), 0)
    found = tables(folder)
    return found, fit(found.model(()), found.used, FitOptions(unbias=False)), dict(floor(folder, (), DRAWS).sigma)


def guess(part: Part, goal: float) -> float:
    """A first size: from that of another band, or from how the effect would show in the motion of a car without it."""
    name = part.key or part.hidden
    known = json.loads(SIZES.read_text(encoding="utf-8")) if SIZES.is_file() else {}
    if settled := [entry for band in BANDS if "size" in (entry := known.get(f"{name}/{band}", {}))]:
        nearest = min(settled, key=lambda entry: abs(np.log(entry["root_lambda"] / goal)))
        ratio = goal / nearest["root_lambda"]
        size = nearest["size"] * (1.0 / ratio if part.inverse else ratio)
        return float(f"{part.largest if _beyond(part, size) else size:.3g}")
    found, fitted, sigma = _nothing_hidden()
    probe = (10.0 if part.inverse else 0.1) * part.largest
    if part.key not in found.known:
        return probe
    effect = true_effect(part, found)
    root = Oracle(fitted, sigma, effect).root_lambda(effect, true_values(part, probe))
    size = probe * min(10.0, goal / max(root, 1e-9))
    return float(f"{size:.3g}")


def tolerated(part: Part, found: Tables) -> float:
    """What the sensor sheet allows of a fault [unit of its size]; 0 for physics."""
    effect = found.known.get(part.key)
    return effect.sheet_bound(found.rig) if effect else 0.0


def _beyond(part: Part, size: float) -> bool:
    return abs(size) < abs(part.largest) if part.inverse else abs(size) > abs(part.largest)


def size_of(part: Part, band: str) -> dict[str, float | str]:
    """The size that has the √λ of a band, and the √λ it got; or why there is none."""
    low, high, goal = BANDS[band]
    folder = BUILD / "sizing" / f"{part.hidden}-{band}"
    size, root = guess(part, goal), float("nan")
    for _ in range(TURNS):
        try:
            root = look(part, size, folder / f"{size!r}")
        except (LacetError, KeyError) as cause:
            return {"why": f"at {size:.4g}: {cause}"}
        if root < 0.0 and part.values:
            return {"why": "the catalogue has the opposite sign: this case's row is wrong"}
        root = abs(root)
        if low <= root <= high and abs(root / goal - 1.0) < 0.25:
            break
        wanted = size * (root / goal if part.inverse else goal / root)
        if _beyond(part, wanted):
            if root >= low and not _beyond(part, size):
                break
            if size == part.largest:
                return {"why": f"at the largest plausible size ({part.largest:g}) √λ is {root:.1f}"}
            wanted = part.largest
        forget(_cell(part, size))
        size = float(f"{wanted:.3g}")
    limit = TOLERANCES * tolerated(part, _nothing_hidden()[0])
    shutil.rmtree(folder, ignore_errors=True)
    if abs(size) < limit:  # √λ of a fault is linear in its size: the motion is the same
        least = root * limit / abs(size)
        if least > high:
            return {"why": f"the sheet allows {limit:.3g} ({TOLERANCES:g} tolerances), at which √λ is {least:.0f}"}
        size, root = float(f"{np.sign(size) * limit:.3g}"), least
    if not low <= root <= high:
        return {"why": f"√λ is {root:.1f} at {size:.4g} after {TURNS} simulations"}
    return {"size": size, "root_lambda": round(root, 1)}


def settle(names: Sequence[str], bands: Sequence[str], tell: bool = True) -> None:
    """Find the sizes that are missing, and keep them in `SIZES`."""
    parts = {**SINGLES, **CAUSES}
    for name in names:
        part = parts[name]
        if not part.known or (part.key and part.key not in _nothing_hidden()[0].known):
            print(f"{name}: not in this simulator or this catalogue", flush=True)
            continue
        for band in bands if part.key else [b for b in bands if b in CAUSE_BANDS]:
            known = json.loads(SIZES.read_text(encoding="utf-8")) if SIZES.is_file() else {}
            entry = known.get(f"{name}/{band}", {})
            if "size" not in entry:
                entry = size_of(part, band)
                known[f"{name}/{band}"] = entry
                SIZES.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n", encoding="utf-8")
            if tell:
                print(f"{name}/{band}: {entry}", flush=True)
