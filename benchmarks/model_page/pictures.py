"""Every picture of ``docs/model.md`` by the name of its file."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from benchmarks.model_page import frames, rows, tree
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle

PICTURES = Path(__file__).parents[2] / "docs" / "images" / "model"
CAR = "peugeot-406"


def pictures() -> dict[str, Figure]:
    """Name → picture, of the shipped car and rig."""
    vehicle, rig = Vehicle.load(CAR), Rig.load(CAR)
    return {"tree": tree.draw(vehicle), "frames": frames.draw(vehicle, rig), "rows": rows.draw()}
