"""Cache of a ranking's simulations in the study: the noise floor, and the noise in the candidates' columns.

Files are in ``.cache`` of the study's folder, which may be removed at any time. Their names hold a digest of their
origin: contents of runs, rig, vehicle and user's effects, filters, model, number of draws and lacet's own sources.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

import lacet.identify
from lacet.identify.selection.regressor_noise import RegressorNoise
from lacet.identify.validation.noise_floor import NoiseFloor
from lacet.services.workspace.study import Study, Version

KEPT = 6
"""Number of files kept of each kind; the oldest are removed."""


def floor_key(study: Study, version: Version) -> str:
    """Digest of all that the noise floor of a version depends on."""
    digest = hashlib.sha256(_sources())
    filters = {k: getattr(study.filters, k) for k in ("rate", "pre_cutoff", "fit_cutoff", "order", "edge")}
    model = [(key, sorted(shape.items())) for key, shape in version.effects.items()]
    digest.update(repr((sorted(filters.items()), model, study.draws)).encode())
    own = sorted(file for file in (study.folder / "effects").glob("*") if file.is_file())
    for file in (study.folder / "rig.toml", study.folder / "vehicle.toml", *own, *study.paths()):
        digest.update(file.name.encode() + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()[:24]


def load_floor(study: Study, key: str) -> NoiseFloor | None:
    """The noise floor stored under a key, or None."""
    arrays = _load(study, f"floor-{key}")
    if arrays is None:
        return None
    runs = 1 + max(int(name.split("|")[0]) for name in arrays)
    draws = tuple(
        {name.split("|")[1]: a.astype(float) for name, a in arrays.items() if name.startswith(f"{run}|")}
        for run in range(runs)
    )
    return NoiseFloor.of(draws)


def save_floor(study: Study, key: str, floor: NoiseFloor) -> NoiseFloor:
    """Store a noise floor; returns it as it will be read, in single precision."""
    single = {f"{d}|{row}": a.astype(np.float32) for d, part in enumerate(floor.draws) for row, a in part.items()}
    _save(study, f"floor-{key}", single)
    return NoiseFloor.of(tuple({row: a.astype(np.float32).astype(float) for row, a in p.items()} for p in floor.draws))


def load_noise(study: Study, key: str) -> RegressorNoise | None:
    """The noise in the columns stored under a key, or None."""
    arrays = _load(study, f"noise-{key}")
    return None if arrays is None else RegressorNoise.from_arrays(arrays)


def save_noise(study: Study, key: str, noise: RegressorNoise) -> None:
    """Store the noise in the columns."""
    _save(study, f"noise-{key}", noise.arrays())


@cache
def _sources() -> bytes:
    """Digest of the identification's sources, so that another version of lacet simulates anew."""
    digest = hashlib.sha256()
    for file in sorted(Path(str(lacet.identify.__file__)).parent.rglob("*.py")):
        digest.update(file.read_bytes())
    return digest.digest()


def _load(study: Study, name: str) -> dict[str, np.ndarray] | None:
    file = study.folder / ".cache" / f"{name}.npz"
    try:
        with np.load(file, allow_pickle=False) as found:
            return dict(found)
    except (OSError, ValueError, EOFError, KeyError, BadZipFile):  # absent, or truncated while it was written
        return None


def _save(study: Study, name: str, arrays: Mapping[str, np.ndarray]) -> None:
    """Write a complete file or none. A folder without write access costs time only."""
    folder = study.folder / ".cache"
    part = folder / f"{name}.{os.getpid()}.npz"
    try:
        folder.mkdir(exist_ok=True)
        (folder / ".gitignore").write_text("*\n", encoding="utf-8")
        np.savez(part, **arrays)  # pyright: ignore[reportArgumentType]
        part.replace(folder / f"{name}.npz")
        kind = name.split("-")[0]
        for old in sorted(folder.glob(f"{kind}-*.npz"), key=lambda file: -file.stat().st_mtime)[KEPT:]:
            old.unlink(missing_ok=True)
    except OSError:
        with suppress(OSError):
            part.unlink(missing_ok=True)
