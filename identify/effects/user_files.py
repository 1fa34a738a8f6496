"""Checks of a user's own effect classes, whose faults are reported with file, class and method.

The same fault in one of lacet's own effects is a bug, and raises its own exception.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Sequence
from typing import Any, TypeVar, cast

import numpy as np

from lacet.daq.errors import LacetError, UsageError
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import Motion
from lacet.identify.car.rows import ROWS, Row
from lacet.identify.effects.base import Effect, Parameter, PhysicalEffect, SensorFault, columns_by_row
from lacet.identify.multibody.vectors import Array

OWN_MODULES = "lacet_user_effects."
"""Prefix of the names of modules made from a user's files."""

_TEXTS = ("name", "about", "signature", "shown_by", "source")
T = TypeVar("T")

_ROOMS = ("daq", "drivers", "identify", "services", "simulate")
"""Packages of lacet, some of which were top-level packages in earlier versions."""
_RENAMED = {"Effect": "PhysicalEffect"}
"""Names of earlier versions → present names."""


def is_own(cls: type[Effect]) -> bool:
    """Whether a class comes from a user's file."""
    return cls.__module__.startswith(OWN_MODULES)


def check_imports(source: str, file: str) -> None:
    """Check of the imports of a user's file: names of `lacet` itself, and none from inside it.

    Raises UsageError with the line, and the line to write instead. A text that is no Python passes: loading it reports
    the place.
    """
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError):
        return
    for node in ast.walk(tree):
        match node:
            case ast.ImportFrom(module=str(module), names=names, level=0) if _inside(module):
                wanted = sorted({_RENAMED.get(one.name, one.name) for one in names})
            case ast.ImportFrom(module="lacet", names=names, level=0) if any(one.name in _ROOMS for one in names):
                wanted = ["…"]
            case ast.Import(names=names) if any(_inside(one.name) for one in names):
                wanted = ["…"]
            case _:
                continue
        raise UsageError(
            f"{file}: line {node.lineno}: '{ast.unparse(node)}' reaches inside lacet; effect files import from lacet "
            f"itself. Write: from lacet import {', '.join(wanted)}"
        )


def _inside(module: str) -> bool:
    first, _, rest = module.partition(".")
    return first in _ROOMS or (first == "lacet" and rest.partition(".")[0] in _ROOMS)


def vetted(cls: type[Effect]) -> None:
    """Check of a user's effect class. Raises UsageError where a class with a name is incomplete."""
    if not is_own(cls) or "name" not in vars(cls):
        return
    if not issubclass(cls, PhysicalEffect | SensorFault):
        raise UsageError(f"{_place(cls)} must derive from PhysicalEffect (SuspensionForce, TyreForce) or SensorFault")
    if inspect.isabstract(cls):
        missing = ", ".join(sorted(cls.__abstractmethods__))
        raise UsageError(f"{_place(cls)} must also define {missing}")
    absent = [name for name in _TEXTS if not (isinstance(found := getattr(cls, name, None), str) and found.strip())]
    if absent:
        raise UsageError(f"{_place(cls)} must say its {', '.join(absent)} (a text each)")


def own_variants(cls: type[Effect], vehicle: Vehicle, reference: str, runs: Sequence[str] = ()) -> Sequence[Effect]:
    """Variants of an effect class, those for single runs included. Raises UsageError for faults in a user's class."""
    if not is_own(cls):
        return [*cls.variants(vehicle, reference), *cls.for_runs(runs)]
    found: Any = _call(cls, "variants", lambda: [*cls.variants(vehicle, reference), *cls.for_runs(runs)])
    for one in found:
        if not isinstance(one, cls):
            raise UsageError(f"{_place(cls)}.variants must give effects, found {type(one).__name__}")
        parameters: Any = _call(cls, "parameters", lambda one=one: tuple(one.parameters))
        if not parameters or not all(isinstance(p, Parameter) for p in parameters):
            raise UsageError(f"{_place(cls)}.parameters must be one Parameter or more: (self.named(…),)")
        for p in parameters:
            if not (np.isfinite(p.low) and np.isfinite(p.high) and p.low < p.high):
                raise UsageError(f"{_place(cls)}.parameters: {p.name} needs finite bounds, low below high")
    return found


def checked_columns(effect: PhysicalEffect, motion: Motion) -> dict[Row, Array]:
    """Regressor columns of an effect, row → (p, N). Raises UsageError for faults in a user's class."""
    cls = type(effect)
    if not is_own(cls):
        return columns_by_row(effect, motion)
    found: Any = _call(cls, "columns", lambda: effect.columns(motion))
    if not isinstance(found, dict):
        raise UsageError(f"{_place(cls)}.columns must give a dictionary row → (p, N), found {type(found).__name__}")
    shape = (len(effect.parameters), motion.t.size)
    out: dict[Row, Array] = {}
    for row, table in cast(dict[Any, Any], found).items():
        if row not in ROWS:
            raise UsageError(f"{_place(cls)}.columns: there is no row {row!r} (lacet info --rows lists them)")
        array: Array = _call(cls, f"columns of {row}", lambda table=table: np.asarray(table, float))
        if array.shape != shape:
            raise UsageError(
                f"{_place(cls)}.columns: {row} has shape {array.shape}, expected (parameters, samples) = {shape}"
            )
        bad = np.flatnonzero(~np.all(np.isfinite(array), axis=0))
        if bad.size:
            when = f"t = {motion.t[bad[0]]:.2f} s of {motion.name}"
            raise UsageError(f"{_place(cls)}.columns: {row} has no finite value at {when} ({bad.size} samples in all)")
        out[Row.parse(row)] = array
    return motion.with_body_rows(out)


def _call(cls: type[Effect], method: str, function: Callable[[], T]) -> T:
    try:
        return function()
    except LacetError:
        raise
    except Exception as cause:  # as above: the user's fault, reported with its place
        raise UsageError(f"{_place(cls)}.{method} fails: {_line(cls, cause)}{type(cause).__name__}: {cause}") from cause


def _line(cls: type[Effect], cause: Exception) -> str:
    """``line 12: ``, the deepest line of the user's file in the traceback of a fault."""
    file, number, trace = _file(cls), 0, cause.__traceback__
    while trace is not None:
        number = trace.tb_lineno if trace.tb_frame.f_code.co_filename == file else number
        trace = trace.tb_next
    return f"line {number}: " if number else ""


def _file(cls: type[Effect]) -> str:
    return inspect.getfile(cls)


def _place(cls: type[Effect]) -> str:
    return f"{_file(cls)}: {cls.__name__}"
