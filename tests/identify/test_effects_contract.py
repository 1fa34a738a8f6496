"""What every effect in the catalogue owes, found by walking it: shapes, names, units, force against columns."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import cars
import numpy as np
import pytest

from daq.errors import UsageError
from daq.units import TO_SI
from identify.catalogue import base_model, catalogue, effect_classes, find_effect
from identify.chain import FrameMotion
from identify.effect import Effect, SensorFault
from identify.geometry import build_motion
from identify.motion import CornerMotion, Motion
from identify.rows import ROWS, row_unit

VEHICLE, RIG = cars.reference_car()
VEHICLE_T = cars.with_tables(VEHICLE)

EFFECTS = {
    reference: catalogue(VEHICLE_T, reference) for reference in ("contact", "hub")
}  # every effect in the folder, found by walking


@pytest.mark.parametrize("reference", ["contact", "hub"])
def test_every_effect_keeps_the_contract(reference: str) -> None:
    """Shapes, finite columns, rows that exist, parameters with names, units, bounds; force is columns times values."""
    signals = cars.random_signals(5)
    motion = build_motion(cars.recording(signals, VEHICLE_T, cars.in_reference(RIG, reference)))
    rng = np.random.default_rng(0)
    names: list[str] = []
    for key, effect in EFFECTS[reference].items():
        assert key == effect.key
        for text in (effect.about, effect.signature, effect.shown_by, effect.source):
            assert text.strip(), key
        assert effect.parameters, key
        for parameter in effect.parameters:
            assert parameter.unit, parameter
            assert parameter.low < parameter.high, parameter
            assert parameter.expect in ("positive", "negative", "any"), parameter
            assert {"positive": parameter.high > 0, "negative": parameter.low < 0, "any": True}[parameter.expect]
            assert 0 < parameter.prior < np.inf
        names += [parameter.name for parameter in effect.parameters]
        for one in effect.shapes():
            values = rng.normal(size=len(one.parameters))
            columns, force = one.columns(motion), one.force(motion, values)
            assert columns.keys() == force.keys(), key
            for row, table in columns.items():
                assert row in ROWS, (key, row)
                assert table.shape == (len(one.parameters), motion.t.size), (key, row, table.shape)
                assert np.all(np.isfinite(table)), (key, row)
                expected = values @ table
                atol = 1e-9 * (1.0 + np.max(np.abs(expected)))
                np.testing.assert_allclose(force[row], expected, atol=atol, err_msg=f"{key} {row}")
    assert len(names) == len(set(names)), "two effects share a parameter name"


# ---- units, by scaling mass, length and time

Dimension = tuple[int, int, int]
"""Powers of mass, length and time."""

_DIMENSION: dict[str, Dimension] = {
    "travel": (0, 1, 0), "rate": (0, 1, -1), "accel": (0, 1, -2), "steer": (0, 0, 0), "camber": (0, 0, 0),
    "pitch": (0, 0, 0), "centre": (0, 1, 0), "dp_ds": (0, 0, 0), "dphi_ds": (0, -1, 0), "wheel_dphi_ds": (0, -1, 0),
    "torque_work": (1, 1, -2), "torque": (1, 2, -2),
    "force": (1, 1, -2), "moment": (1, 2, -2), "spin_axis": (0, 0, 0), "spin": (0, 0, -1), "spin_accel": (0, 0, -2),
    "normal": (0, 0, 0), "height": (0, 1, 0), "deflection": (0, 1, 0), "deflection_rate": (0, 1, -1),
    "centre_accel": (0, 1, -2), "omega": (0, 0, -1), "omega_dot": (0, 0, -2), "t": (0, 0, 1), "velocity": (0, 1, -1),
    "attitude": (0, 0, 0),
}  # fmt: skip
_UNITS: dict[str, Dimension] = {
    "N": (1, 1, -2), "kg": (1, 0, 0), "m": (0, 1, 0), "s": (0, 0, 1), "rad": (0, 0, 0), "-": (0, 0, 0),
}  # fmt: skip
SCALE = (1.7, 2.3, 0.6)


def dimension(unit: str) -> Dimension:
    """Powers of mass, length and time of a unit such as ``N·s²/m``."""
    out = np.zeros(3, int)
    for place, part in enumerate(unit.split("/")):
        for factor in part.strip("()").split("·"):
            name, power = re.fullmatch(r"(\D+?)([²³⁴]?)", factor).groups()  # type: ignore[union-attr]
            sign = -1 if place else 1
            out += sign * (" ²³⁴".index(power) + 1 if power else 1) * np.array(_UNITS[name])
    return tuple(out.tolist())


def factor(of: Dimension) -> float:
    """What a quantity of this dimension is multiplied by."""
    return float(np.prod(np.array(SCALE) ** np.array(of)))


def scaled(part: Any) -> Any:
    """A motion, corner or frame in other units of mass, length and time."""
    changes: dict[str, Any] = {}
    for field in fields(part):
        value = getattr(part, field.name)
        if isinstance(value, FrameMotion | CornerMotion):
            changes[field.name] = scaled(value)
        elif isinstance(value, np.ndarray):
            changes[field.name] = value * factor(_DIMENSION[field.name])
        elif field.name == "corners":
            changes[field.name] = {c: scaled(corner) for c, corner in value.items()}
    return replace(part, **changes)


def in_other_units(effect: Effect, motion: Motion, powers: Mapping[str, Dimension]) -> dict[str, np.ndarray]:
    """Columns of an effect whose shape constants have these dimensions."""
    shape = {name: value * factor(powers[name]) for name, value in effect.shape.items()}
    return replace(effect, shape=shape).columns(motion)


@pytest.mark.parametrize("reference", ["contact", "hub"])
def test_units_of_parameters_are_those_of_the_law(reference: str) -> None:
    """In other units of mass, length and time every column changes as row unit ÷ parameter unit says.

    The dimension of a shape constant is not declared: some dimension must make the law right.
    """
    motion = build_motion(cars.recording(cars.random_signals(7), VEHICLE_T, cars.in_reference(RIG, reference)))
    other = scaled(motion)
    choices = [(0, 0, 0), (0, 1, 0), (0, 1, -1), (0, 0, 1), (0, 0, -1), (0, -1, 0), (1, 1, -2)]
    for effect in EFFECTS[reference].values():
        for parameter in effect.parameters:
            assert parameter.unit in TO_SI, f"{parameter.name}: a vehicle file cannot give a value in {parameter.unit}"
        if isinstance(effect, SensorFault):
            continue
        one = effect.shapes()[0]
        columns = one.columns(motion)
        found = [
            in_other_units(one, other, dict(zip(one.shape, powers, strict=True)))
            for powers in itertools.product(choices, repeat=len(one.shape))
        ]
        assert any(_homogeneous(one, columns, after) for after in found), f"{effect.key}: units do not fit the law"


def _homogeneous(effect: Effect, before: Mapping[str, np.ndarray], after: Mapping[str, np.ndarray]) -> bool:
    return all(
        np.allclose(
            after[row][k],
            before[row][k] * factor(tuple(np.subtract(dimension(row_unit(row)), dimension(parameter.unit)).tolist())),
            rtol=1e-9,
            atol=1e-12 * float(np.max(np.abs(after[row]))),
        )
        for row in before
        for k, parameter in enumerate(effect.parameters)
    )


# ---- the catalogue itself


def test_the_base_model_is_the_papers_table_2() -> None:
    """Bodies, springs, dampers, offsets, tyre stiffness; outboard mass for hub loads only."""
    kinds = {reference: {e.name for e in base_model(VEHICLE, reference)} for reference in EFFECTS}
    assert kinds["contact"] == {"body", "spring", "damper", "offset", "tyre_stiffness"}
    assert kinds["hub"] == kinds["contact"] | {"outboard_mass"}


def test_every_class_in_the_folder_is_in_the_catalogue() -> None:
    """Nothing is lost between the folder and the list of effects, and base effects come first."""
    families = {effect.name for effects in EFFECTS.values() for effect in effects.values()}
    assert families == set(effect_classes())
    order = [effect.base for effect in EFFECTS["hub"].values()]
    assert order == sorted(order, reverse=True)


def test_a_wrong_key_gets_the_nearest() -> None:
    """`anti_rol_bar.front` is a slip of the pen."""
    with pytest.raises(UsageError, match=r"did you mean 'anti_roll_bar\.front'"):
        find_effect("anti_rol_bar.front", EFFECTS["hub"])
    assert find_effect("anti_roll_bar.front", EFFECTS["hub"]).key == "anti_roll_bar.front"


_OWN = """
from identify.effects.anti_roll_bar import AntiRollBar

class Mine(AntiRollBar):
    name = "mine"
    about = "one of my own"
"""


def test_a_users_folder_joins_and_faults_in_it_are_named(tmp_path) -> None:
    """An effect in a user's file is found; a file that cannot be loaded or a second of the same name is an error."""
    (tmp_path / "mine.py").write_text(_OWN, encoding="utf-8")
    assert "mine.front" in catalogue(VEHICLE, "hub", [tmp_path])
    (tmp_path / "twice.py").write_text(_OWN.replace('"mine"', '"spring"'), encoding="utf-8")
    with pytest.raises(UsageError, match="two effects are called 'spring'"):
        catalogue(VEHICLE, "hub", [tmp_path])
    (tmp_path / "twice.py").write_text("import nothing_of_this_name", encoding="utf-8")
    with pytest.raises(UsageError, match=r"twice\.py"):
        catalogue(VEHICLE, "hub", [tmp_path])
