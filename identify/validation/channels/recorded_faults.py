"""Faults that the values of a run's channels show before any equation, alone or beside others of their kind."""

from __future__ import annotations

from lacet.daq.run import Run
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.validation.channels.recorded_values import Copies, copied_columns
from lacet.identify.validation.channels.sizes import (
    LeansAlike,
    NegativeDistance,
    OtherSize,
    SteersAgainst,
    TooQuiet,
    negative_distances,
    opposed_steer,
    other_sizes,
    quiet_columns,
    unmirrored_camber,
)
from lacet.identify.validation.channels.unusable_values import Unusable

RecordedFault = Unusable | Copies | TooQuiet | OtherSize | NegativeDistance | SteersAgainst | LeansAlike
"""A fault that a channel's values show, alone or beside others of their kind."""


def recorded_faults(run: Run, drive: PreparedRun) -> list[RecordedFault]:
    """Faults of what `without_unusable` leaves of a run, by its values; `drive` : that run, prepared."""
    rig = drive.recording.rig
    found: list[RecordedFault] = [*copied_columns(run)]
    quiet = quiet_columns(run, rig)
    named = {one.column for one in quiet}
    found += [*quiet, *(one for one in other_sizes(run, rig) if one.column not in named), *negative_distances(run)]
    found += unmirrored_camber(run, rig)
    steer = opposed_steer(drive)
    return found if steer is None else [*found, steer]
