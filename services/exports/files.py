"""Exported files: which form a file is to have, and the writing of it, whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from lacet.daq.errors import UsageError, nearest
from lacet.daq.formats.result import FORMAT, plain
from lacet.daq.vehicle import Vehicle
from lacet.identify.regression.wls import Fit
from lacet.services.exports.tables import errors_table, ranking_table, values_table, write_table


class Form(Enum):
    """Form of an exported file: its word on the command line, suffixes, and what it holds."""

    VEHICLE = "vehicle", (".toml",), "vehicle file with the identified values as a-priori values"
    MJCF = "mjcf", (".xml",), "model that MuJoCo simulates by itself"
    URDF = "urdf", (".urdf", ".xml"), "tree, inertias and joint damping for robotics programs"
    COMMONROAD = "commonroad", (".yaml", ".yml"), "vehicle parameters of commonroad-vehicle-models"
    MATLAB = "matlab", (".mat",), "all results as MATLAB structs"
    RESULTS = "results", (".json",), "all results as lacet identify --json writes them, and the diagnosis"
    VALUES = "values", (".csv", ".parquet"), "parameters, whole-vehicle and derived values with intervals"
    ERRORS = "errors", (".csv", ".parquet"), "error of every row of every run"
    RANKING = "ranking", (".csv", ".parquet"), "missing effects as last ranked by lacet diagnose"
    RUN = "run", (".mf4",), "decoded channels of a run as MDF"
    ROWS = "rows", (".mcap",), "decoded channels of a log, one message a sample"

    def __init__(self, word: str, suffixes: tuple[str, ...], about: str):
        self.word, self.suffixes, self.about = word, suffixes, about

    @property
    def of_run(self) -> bool:
        """Whether it is made of a run and not of a fit."""
        return self in (Form.RUN, Form.ROWS)


def form_of(path: Path, word: str | None, of_run: bool) -> Form:
    """The form of a file by its suffix, or by the word given. Raises UsageError with what there is."""
    forms = [form for form in Form if form.of_run == of_run]
    suffix = path.suffix.lower()
    known = "; ".join(f"{'/'.join(form.suffixes)} {form.word}" for form in forms)
    subject = "a run" if of_run else "an identified car"
    if word is not None:
        found = next((form for form in Form if form.word == word), None)
        if found is None:
            raise UsageError(f"--as {word}: there is no such form{nearest(word, [f.word for f in Form])}; {known}")
        if found.of_run != of_run:
            raise UsageError(
                f"--as {word} is made of {'a run' if found.of_run else 'a study'}; {subject} gives {known}"
            )
        if suffix not in found.suffixes:
            raise UsageError(f"{path}: {word} goes into a file {' or '.join(found.suffixes)}, not '{suffix}'")
        return found
    chosen = next((form for form in forms if suffix in form.suffixes), None)
    if chosen is None:
        other = next((form for form in Form if suffix in form.suffixes), None)
        hint = f": it is made of {'a run' if other.of_run else 'a study'}" if other else nearest(
            suffix, [s for form in forms for s in form.suffixes]
        )  # fmt: skip
        raise UsageError(f"{path}: '{suffix}' is no form of {subject}{hint}; there are {known}")
    return chosen


@dataclass(frozen=True)
class Identified:
    """What can be exported of an identified car.

    `result` : of the fit as plain data (``docs/json.md``, identify); `fitted` gives the fit, where it is needed;
    `diagnosis` the last ranking as plain data, or None; `title` where the numbers come from.
    """

    vehicle: Vehicle
    result: Mapping[str, Any]
    fitted: Callable[[], Fit]
    diagnosis: Mapping[str, Any] | None
    title: str


@dataclass(frozen=True)
class Written:
    """A file written: its path and form, what is in it in words, and what the form could not hold → why."""

    path: Path
    form: Form
    says: str
    left_out: Mapping[str, str]


@contextmanager
def replacing(path: Path, force: bool = False) -> Generator[Path]:
    """A file beside `path` to write to; it takes the place of `path` when all is written, and is removed otherwise.

    Raises UsageError when there is a file already and it may not be replaced, or the folder does not exist.
    """
    if path.exists() and not force:
        raise UsageError(f"{path} exists: give another name, or --force")
    if not path.parent.is_dir():
        raise UsageError(f"{path}: there is no folder {path.parent}")
    part = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        yield part
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def export_car(car: Identified, path: Path, form: Form, force: bool = False) -> Written:
    """Write an identified car, or its results, in one form. Raises LacetError with what is lacking."""
    with replacing(path, force) as part:
        says, left_out = _WRITERS[form](car, part)
    return Written(path, form, says, left_out)


def _text(part: Path, text: str) -> None:
    part.write_text(text, encoding="utf-8")


def _vehicle(car: Identified, part: Path) -> tuple[str, Mapping[str, str]]:
    from lacet.services.exports.vehicle_file import vehicle_text

    _text(part, vehicle_text(car.vehicle, car.result, car.title))
    left_out: dict[str, str] = {}
    if extra := _added(car):
        left_out["effects"] = f"the file has values for comparison, no laws: give --add {' --add '.join(extra)} again"
    if car.result["wheel_reference"] == "hub":
        left_out["mass, cog, inertia of the whole vehicle"] = "from hub loads they lack rims and tyres"
    return f"geometry as it was, {len(car.result['parameters'])} identified values", left_out


def _added(car: Identified) -> list[str]:
    """Keys of the effects of a model that the base model has not."""
    return [key for key in car.result["effects"] if not key.startswith(_BASE)]


_BASE = ("body.", "spring.", "damper.", "offset.", "outboard_mass.", "tyre_stiffness.")
"""Beginnings of the keys of base-model effects."""


def _model(car: Identified, part: Path, form: Form) -> tuple[str, Mapping[str, str]]:
    from lacet.services.exports.car import exported_car
    from lacet.services.exports.mjcf import mjcf_text
    from lacet.services.exports.urdf import not_in_urdf, urdf_text

    exported = exported_car(car.fitted())
    _text(part, (mjcf_text if form is Form.MJCF else urdf_text)(exported, car.title))
    says = "bodies, joints, springs, dampers, bars, tyre springs" if form is Form.MJCF else "bodies, joints, damping"
    notes = {
        "assumed": "; ".join(exported.chosen),
        "tyre forces along and across the road": "lacet has no law for them",
    }
    return says, {**(not_in_urdf(exported) if form is Form.URDF else {}), **exported.left_out, **notes}


def _commonroad(car: Identified, part: Path) -> tuple[str, Mapping[str, str]]:
    from lacet.services.exports.commonroad import commonroad_text

    text, left_out = commonroad_text(car.vehicle, car.result, car.title, _added(car))
    _text(part, text)
    return "CommonRoad vehicle parameters", left_out


def _matlab(car: Identified, part: Path) -> tuple[str, Mapping[str, str]]:
    from lacet.services.exports.matlab import write_mat

    write_mat(part, car.result, car.diagnosis, car.title)
    return "struct lacet: p, values, errors" + (", ranking" if car.diagnosis else ""), {}


def _results(car: Identified, part: Path) -> tuple[str, Mapping[str, str]]:
    body = {"format": FORMAT, "command": "export", "title": car.title, **car.result, "diagnosis": car.diagnosis}
    _text(part, json.dumps(plain(body), indent=1, ensure_ascii=False) + "\n")
    return "results", {}


def _table(car: Identified, part: Path, form: Form) -> tuple[str, Mapping[str, str]]:
    if form is Form.RANKING:
        if car.diagnosis is None:
            raise UsageError("there is no ranking to export: run lacet diagnose first")
        table = ranking_table(car.diagnosis)
    else:
        table = (errors_table if form is Form.ERRORS else values_table)(car.result)
    write_table(table, part)
    return f"{len(table.rows)} rows: {', '.join(table.columns)}", {}


_WRITERS: Mapping[Form, Callable[[Identified, Path], tuple[str, Mapping[str, str]]]] = {
    Form.VEHICLE: _vehicle,
    Form.MJCF: lambda car, part: _model(car, part, Form.MJCF),
    Form.URDF: lambda car, part: _model(car, part, Form.URDF),
    Form.COMMONROAD: _commonroad,
    Form.MATLAB: _matlab,
    Form.RESULTS: _results,
    Form.VALUES: lambda car, part: _table(car, part, Form.VALUES),
    Form.ERRORS: lambda car, part: _table(car, part, Form.ERRORS),
    Form.RANKING: lambda car, part: _table(car, part, Form.RANKING),
}
