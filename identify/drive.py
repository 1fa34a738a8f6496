"""One run ready for fitting: its motion, and every effect's columns after the parallel filter and decimation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from daq.channels import CHANNELS
from daq.rig import Rig
from daq.run import Run
from daq.vehicle import Vehicle
from identify.effect import Effect
from identify.filters import Filters, decimate
from identify.geometry import build_motion
from identify.motion import Motion
from identify.noise import draw_noise
from identify.reconstruct import Recording, Signals, bring_together
from identify.vectors import Array


class Drive:
    """A recording with its motion; what is computed for one effect is kept for the next question.

    Parameters
    ----------
    recording : channels on one grid.
    """

    def __init__(self, recording: Recording):
        self.recording = recording
        self._noisy: dict[tuple[int, int], Drive] = {}
        self._columns: dict[tuple[str, tuple[tuple[str, float], ...]], dict[str, Array]] = {}

    @classmethod
    def of(cls, run: Run, vehicle: Vehicle, rig: Rig, filters: Filters | None = None) -> Drive:
        """Bring a run together. Raises RunError when it is too short."""
        return cls(bring_together(run, vehicle, rig, filters or Filters()))

    @property
    def name(self) -> str:
        """The run's name."""
        return self.recording.run

    @cached_property
    def motion(self) -> Motion:
        """The motion and loads at full rate."""
        return build_motion(self.recording)

    @cached_property
    def rows(self) -> tuple[str, ...]:
        """Rows with a measured left side and at least one usable sample."""
        return tuple(row for row in self.motion.rows if len(self.motion.kept(row)))

    @cached_property
    def index(self) -> Mapping[str, np.ndarray]:
        """Kept sample indices by row."""
        return {row: self.motion.kept(row) for row in self.rows}

    @cached_property
    def measured(self) -> dict[str, Array]:
        """Left sides after the parallel filter, at the kept samples: row → (n,)."""
        return self.decimated({row: self.motion.measured(row) for row in self.rows})

    def columns(self, effect: Effect) -> dict[str, Array]:
        """An effect's columns after the parallel filter, at the kept samples: row → (p, n)."""
        key = (effect.key, tuple(sorted(effect.shape.items())))
        if key not in self._columns:
            self._columns[key] = self.decimated(effect.columns(self.motion))
        return self._columns[key]

    def decimated(self, rows: Mapping[str, Array]) -> dict[str, Array]:
        """Filter (…, N) series of rows and keep their samples; rows this drive lacks are left out."""
        return {
            row: decimate(series, self.motion.filters, self.index[row])
            for row, series in rows.items()
            if row in self.index
        }

    def matrix(self, effects: Sequence[Effect], row: str) -> Array:
        """(n, p) observation matrix of a row, all effects side by side, zero where an effect does not act."""
        n = len(self.index[row])
        parts = [
            columns[row] if row in (columns := self.columns(effect)) else np.zeros((len(effect.parameters), n))
            for effect in effects
        ]
        return np.concatenate(parts).T if parts else np.zeros((n, 0))

    def noisy(self, draw: int, sign: int, seed: Sequence[int]) -> Drive:
        """This run with one more draw of its channels' noise added or subtracted; kept for the next fit.

        The wheel loads are left alone: they stand on the left side only, where noise brings no bias.
        """
        key = (draw, sign)
        if key not in self._noisy:
            recording = self.recording
            values = recording.signals.value
            moving = [name for name in values if CHANNELS[name].family not in ("wheel.force", "wheel.moment")]
            noise = draw_noise(recording, moving, np.random.default_rng(seed))
            moved = {**values, **{name: values[name] + sign * noise[name] for name in moving}}
            signals = Signals.differentiated(moved, recording.filters.rate)
            self._noisy[key] = Drive(recording.with_signals(signals))
        return self._noisy[key]

    def forget_motion(self) -> None:
        """Let go of the full-rate motion, which is rebuilt if asked for again; columns made so far are kept."""
        self.__dict__.pop("motion", None)

    def can(self, effect: Effect) -> str:
        """Why an effect cannot be computed on this run, or an empty string."""
        absent = [channel for channel in effect.needs if channel not in self.motion.channels]
        return f"{', '.join(absent)} not measured in {self.name}" if absent else ""
