"""Effect classes of one-line effects: their variants, parameters and regressor columns."""

from __future__ import annotations

import ast
import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, NoReturn, Self, cast

import numpy as np

from lacet.daq.errors import UsageError
from lacet.daq.expressions.expression import Expression
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import Motion
from lacet.identify.effects.base import Bend, Effect, Parameter, PhysicalEffect, expected_columns, in_turn
from lacet.identify.effects.language.linearity import along_run
from lacet.identify.effects.language.parser import Line, LineFault, RowLaw, read_line
from lacet.identify.multibody.vectors import Array

WHEEL_FORCE, WHEEL_MOMENT, CAR_MOMENT = 4000.0, 1200.0, 4000.0
"""Bounds of a plausible effect: a wheel's static load [N], and that load at a wheel's radius and at a metre [N·m]."""
_TRAVEL = {"travel", "rate"}
_DRAWS = 512
_WIDER = (1.0, 2.0, 4.0, 8.0)
"""Multiples of its states' usual range at which a law is evaluated that is zero within (a stop with a wide gap)."""


class OneLine(PhysicalEffect):
    """An effect written as one line; `effect_class` makes a subclass for each line."""

    line: ClassVar[Line]
    plausible: ClassVar[dict[str, tuple[float, float]]]
    """Smallest and largest plausible value of each parameter [SI]."""
    units: ClassVar[dict[str, str]]
    """SI unit of each parameter, which follows from the law."""
    bend: ClassVar[Bend]
    """Where its law bends within the noise (`SuspensionForce.bend`)."""

    @property
    def conditional(self) -> bool:
        """Whether its columns are expectations of the law given the noisy record."""
        return self.bend is not Bend.NOWHERE

    @classmethod
    def variants(cls, vehicle: Vehicle, reference: str) -> Sequence[Self]:
        """The variants at the places its line allows: both axles (one value left and right) and each corner."""
        first = {name: values[0] for name, values in cls.grids.items()}
        return [cls(where, dict(first)) for where in cls.line.places]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The line's parameters, with the units that follow from the law."""
        out: list[Parameter] = []
        for name in self.line.parameters:
            low, high = self.plausible[name]
            expect = "positive" if low >= 0 else "negative" if high <= 0 else "any"
            out.append(self.named(name, self.units[name], low, high, expect))
        return tuple(out)

    def acted_on(self) -> Iterator[tuple[str, str, RowLaw]]:
        """Rows acted on: (row, corner, law), the corner empty for a chassis row."""
        for law in self.line.rows:
            for corner in law.corners(self.where):
                yield (f"{law.row}.{corner}" if corner else law.row), corner, law

    def lacks(self, motion: Motion) -> tuple[str, ...]:
        """Channels of its states that a run lacks, in the rows that the run has or combines."""
        there = motion.equations
        uses = [(use, corner) for row, corner, law in self.acted_on() for use in law.uses.values() if row in there]
        return tuple(dict.fromkeys(channel for use, corner in uses for channel in use.lacks(motion, corner)))

    def columns(self, motion: Motion) -> dict[str, Array]:
        """The law's terms in the rows acted on, or their expectation. Raises UsageError where one is not finite."""
        return expected_columns(self._plain, motion, [corner for _, corner, _ in self.acted_on() if corner], self.bend)

    def _plain(self, motions: Sequence[Motion]) -> dict[str, Array]:
        out: dict[str, Array] = {}
        names, count = list(self.line.parameters), len(motions) * motions[0].t.size
        functions = along_run(float(np.ptp(motions[0].t)) / max(1, motions[0].t.size - 1))
        for row, corner, law in self.acted_on():
            values = {name: in_turn([use.value(one, corner) for one in motions]) for name, use in law.uses.items()}
            table = out.setdefault(row, np.zeros((len(names), count)))
            for name, term in law.terms.items():
                with np.errstate(all="ignore"):
                    part = term.series({**values, **self.shape}, count, functions)
                if not np.all(finite := np.isfinite(part)):
                    self._refuse_not_finite(motions[0], row, law, values, int(np.argmin(finite)))
                table[names.index(name)] += part
        return out

    def _refuse_not_finite(self, motion: Motion, row: str, law: RowLaw, values: dict[str, Array], at: int) -> NoReturn:
        states = ", ".join(f"{n} = {values[n][at]:.4g} {use.state.unit}" for n, use in law.uses.items())
        raise UsageError(
            f"{self.key}: {law.text} has no finite value in {row} at t = {motion.t[at % motion.t.size]:.2f} s of "
            f"{motion.name}, where {states or 'no state is in it'}. Write the law so that it has one there, as in "
            "/max(abs(rate), 0.01 m/s)"
        )


def one_line_effects(text: str, vehicle: Vehicle, reference: str) -> Sequence[Effect]:
    """The variants of the effect that one line of text defines, for wheel loads in `reference`."""
    return effect_class(read_line(text)).variants(vehicle, reference)


def effect_class(line: Line) -> type[OneLine]:
    """The effect class of a line that has a name. Raises LineFault where no plausible size of a parameter follows."""
    law = "; ".join(f"{law.named}: {law.text}" for law in line.rows)
    states = ", ".join(dict.fromkeys(use.state.name.replace("_", " ") for use in line.states.values()))
    attributes: dict[str, Any] = {
        "__doc__": f"{line.about or law}.", "__module__": __name__, "line": line, "name": line.name,
        "about": line.about or law,
        "signature": "; ".join(f"{law.named} row follows {law.text}" for law in line.rows),
        "shown_by": f"a run in which {states or 'the car'} changes much",
        "source": "one line of the user's",
        "rows": tuple(dict.fromkeys(law.row for law in line.rows)),
        "grids": dict(line.grids),
        "grid_units": {name: line.constants[name].unit for name in line.grids},
        "instantaneous": not line.has_memory,
        "bend": _bend(line),
        "units": {name: line.unit(name) for name in line.parameters},
        "plausible": {name: line.bounds.get(name) or _plausible(line, name) for name in line.parameters},
    }  # fmt: skip
    return cast(type[OneLine], type(f"OneLine_{line.name}", (OneLine,), attributes))


def _bend(line: Line) -> Bend:
    """Where a line's law bends: one with functions, of the travel and rate of its own wheel alone."""
    uses = [use for law in line.rows for use in law.uses.values()]
    own = {use.state.name for use in uses if use.wheel == "own"}
    if line.has_memory or len(own) != len({(use.state.name, use.wheel) for use in uses}) or not own <= _TRAVEL:
        return Bend.NOWHERE
    if not any(
        isinstance(node, ast.Call) for law in line.rows for term in law.terms.values() for node in ast.walk(term.tree)
    ):
        return Bend.NOWHERE
    # The travel is known to a tenth of a millimetre: where both are in it, the rate is what matters.
    return Bend.RATE if "rate" in own else Bend.TRAVEL


def _plausible(line: Line, parameter: str) -> tuple[float, float]:
    """± the largest value with which the law stays within a plausible force at the usual range of its states.

    A parameter in several rows is bounded by each; of the shape constants tried, those count that allow most.
    """
    sizes: list[float] = []
    for shape in itertools.product(*line.grids.values()):
        constants = dict(zip(line.grids, shape, strict=True))
        each = [_size(law, law.terms[parameter], constants) for law in line.rows if parameter in law.terms]
        sizes += [min(size for size in each if size)] if any(each) else []
    if not sizes:
        unit = line.unit(parameter)
        says = f"no plausible size of {parameter} follows: at every usual size of its states the law is zero or "
        raise LineFault(
            line.text, f"{says}not finite. Give bounds at the end of the line: ', {parameter} in -500..500 {unit}'"
        )
    size = float(f"{max(sizes):.1e}")
    return -size, size


def _size(law: RowLaw, term: Expression, constants: dict[str, float]) -> float:
    """Plausible force ÷ the largest |term| in the usual range of its states; 0 where the term is zero or not finite."""
    plausible = WHEEL_FORCE
    if law.first_row.unit == "N·m":
        plausible = CAR_MOMENT if law.first_row.kind == "chassis" else WHEEL_MOMENT
    for wider in _WIDER:
        rng = np.random.default_rng(0)
        states = {
            name: wider * rng.uniform(use.state.low, use.state.high, _DRAWS) for name, use in sorted(law.uses.items())
        }
        with np.errstate(all="ignore"):
            found = np.abs(term.series({**states, **constants}, _DRAWS))
        found = found[np.isfinite(found)]
        largest = float(np.max(found)) if found.size else 0.0
        if largest > 0.0 and math.isfinite(plausible / largest) and plausible / largest > 0.0:
            return plausible / largest
    return 0.0
