"""Vehicle file of a simulated car: its geometry in the format of ``docs/vehicle.md``."""

from __future__ import annotations

import math

import numpy as np

from lacet.daq.channels import CORNERS
from lacet.daq.joint_tables import joints_text
from lacet.simulate.cars import Axle, Car
from lacet.simulate.linkage.bench import BenchTables
from lacet.simulate.linkage.cars import SecondCar


def vehicle_text(of: Car | SecondCar) -> str:
    """The car's geometry in the format of ``docs/vehicle.md``: the identification's a-priori knowledge.

    Of a second car with the tables of its virtual bench: the joints of each corner, which are used, and the bump test
    of each axle, which is where a reader deletes them.
    """
    car = of.sizes if isinstance(of, SecondCar) else of
    moves = "its wheels hang on linkages" if isinstance(of, SecondCar) else "each wheel centre moves along body z only"
    source = "geometry of the simulated car"

    def row(key: str, value: float, unit: str) -> str:
        return f'{key} = {{ value = {value!r}, unit = "{unit}", source = "{source}" }}'

    def axle(name: str, of: Axle, height: float) -> list[str]:
        lines = [
            "",
            f"[axle.{name}]",
            row("track", of.track, "m"),
            row("wheel_centre_height", height, "m"),
            row("tyre_radius", of.radius, "m"),
            row("static_camber", round(math.degrees(of.camber), 6), "deg"),
            row("static_toe", round(math.degrees(of.toe), 6), "deg"),
        ]
        if of.steered:
            lines += [
                row("caster", round(math.degrees(of.caster), 6), "deg"),
                row("kingpin_inclination", round(math.degrees(of.kingpin_inclination), 6), "deg"),
            ]
        return [*lines, f"driven = {str(of.driven).lower()}", 'brakes = "outboard"']

    def table(name: str, series: dict[str, np.ndarray]) -> list[str]:
        lines = ["", f"[axle.{name}.kinematics]"]
        for key, values in series.items():
            angle = key in ("camber", "toe", "pitch")
            shown = [round(float(v), 5) + 0.0 for v in (np.degrees(values) if angle else 1e3 * values)]
            unit = "deg" if angle else "mm"
            lines.append(
                f'{key} = {{ value = {shown}, unit = "{unit}", source = "virtual bench, both wheels in bump" }}'
            )
        return lines

    tables = BenchTables.of(of) if isinstance(of, SecondCar) else None
    heights = [round(height, 6) for height in car.heights.tolist()]
    differing: list[str] = []
    for corner, height in zip(CORNERS, heights, strict=True):
        if height != heights[2 if corner[0] == "r" else 0]:
            differing += ["", f"[corner.{corner}]", row("wheel_centre_height", height, "m")]
    return "\n".join(
        [
            'format = "lacet-vehicle 1"',
            f'name = "{car.name}"',
            f'description = "Geometry of the simulated car {car.name}; {moves}."',
            "",
            "[geometry]",
            row("wheelbase", car.wheelbase, "m"),
            *axle("front", car.front, heights[0]),
            *(table("front", tables.kinematics["front"]) if tables else ()),
            *axle("rear", car.rear, heights[2]),
            *(table("rear", tables.kinematics["rear"]) if tables else ()),
            *differing,
            *([joints_text(tables.joints, "virtual bench")] if tables else [""]),
        ]
    )
