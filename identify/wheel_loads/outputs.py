"""Forces of a run without dynamometers that its rows determine: never a side force by wheel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CORNERS
from lacet.identify.car.rows import Row
from lacet.identify.effects.base import AXLES
from lacet.identify.multibody.vectors import Array
from lacet.identify.wheel_loads.tyre_contact import UNKNOWNS

FORCES = (
    *(f"wheel.{c}.force_estimated.z" for c in CORNERS),
    "car.force_estimated.x",
    *(f"axle.{axle}.force_estimated.x" for axle in AXLES),
    *(f"axle.{axle}.force_estimated.y" for axle in AXLES),
)
"""Names of the forces, in the order of all reports; axes of the wheels on the road (`tyre_contact.WheelAxes`)."""


def _sums() -> Array:
    """(forces, unknowns) what each force is of the unknowns."""
    out = np.zeros((len(FORCES), len(UNKNOWNS)))
    for i, name in enumerate(FORCES):
        place, _, axis = name.split(".")[-3:] if not name.startswith("car") else ("car", "", "x")
        wanted = [f"x.{axle}" for axle in AXLES] if place == "car" else [f"{axis}.{place}"]
        for unknown in wanted:
            out[i, UNKNOWNS.index(unknown)] = 1.0
    return out


SUMS = _sums()
"""(forces, unknowns): each force as a sum of unknowns."""


def row_of(name: str) -> Row:
    """The row whose noise floor a force is measured against: that of the suspension, or of the chassis along it."""
    place, _, axis = name.split(".")[-3:] if not name.startswith("car") else ("", "", "x")
    return Row(f"suspension.{place}") if axis == "z" else Row(f"chassis.f{axis}")


@dataclass(frozen=True)
class EstimatedForce:
    """A force of a run without dynamometers.

    Attributes
    ----------
    name : one of `FORCES`.
    value : (n,) [N]; NaN where the run's rows do not determine it.
    half95 : (n,) half of the 95 % band [N].
    parts : source of the band → 1 σ that it adds, RMS over the run [N]; of constants what the band would lose without.
    row : the row whose noise floor it is measured against; `floor` : that, dynamometers included [N].
    """

    name: str
    value: Array
    half95: Array
    parts: Mapping[str, float]
    row: Row
    floor: float

    unit = "N"

    @property
    def determined(self) -> NDArray[np.bool_]:
        """(n,) whether the run's rows determine it."""
        return np.isfinite(self.value)


@dataclass(frozen=True)
class RunConstant:
    """A constant of the run that the loads depend on: a sensor's zero, a change of mass, something assumed.

    `name`; `mean` before the run; `sigma` of that; `value` and `sigma_after` what the run makes of both, in its unit.
    """

    name: str
    kind: str
    mean: float
    sigma: float
    value: float
    sigma_after: float


@dataclass(frozen=True, repr=False)
class EstimatedForces:
    """Wheel forces of a run without dynamometers, up to the fit's cut-off, with 95 % bands.

    Attributes
    ----------
    run : name of the run.
    t : (n,) s, the instants after decimation.
    forces : by name: vertical at each wheel, longitudinal of the car and by axle, lateral by axle.
    reference : ``contact`` or ``hub``, that of the study's wheel loads.
    rows : rows of the equations that were joined.
    constants : what the run says of its sensors' zeros and of all that is assumed.
    cutoff : of the fit's filter, up to which the forces hold [Hz].
    """

    run: str
    t: Array
    forces: Mapping[str, EstimatedForce]
    reference: str
    rows: tuple[Row, ...]
    constants: tuple[RunConstant, ...]
    cutoff: float

    def __getitem__(self, name: str) -> EstimatedForce:
        return self.forces[name]

    def __repr__(self) -> str:
        said = ", ".join(
            f"{name} ± {float(f'{np.nanmean(force.half95):.2g}'):g} N"
            for name, force in self.forces.items()
            if force.determined.any()
        )
        return f"EstimatedForces(run {self.run}, {self.t.size} instants: {said})"
