"""A user's effect tried on a run before it is kept: where it acts, or why these measurements cannot test it."""

from __future__ import annotations

from typing import Any

import numpy as np

from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.base import PhysicalEffect
from lacet.identify.effects.user_files import checked_columns
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.services.render.effect_text import why_not


def try_effect(cls: type[PhysicalEffect], run: PreparedRun, vehicle: Vehicle, reference: str) -> list[dict[str, Any]]:
    """Each variant, with every combination of its constants, on the first minute of a run.

    Plain data (``docs/json.md``, ``effect``, `tried`): rows it acts on, or why it cannot be tested. Raises UsageError
    where the law gives values that are not finite.
    """
    part = next(run.pieces())
    out: list[dict[str, Any]] = []
    for effect in cls.variants(vehicle, reference):
        lacking = part.lacks(effect)
        found = [] if lacking else [checked_columns(one, part.motion) for one in effect.shapes()]
        acts = [row for row in part.rows if any(row in table and np.any(table[row]) for table in found)]
        out.append({"effect": effect.key, "acts_on": acts, "why_not": why_not(lacking, acts)})
    return out
