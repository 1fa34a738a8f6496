"""What every effect in the catalogue owes, found by walking it: shapes, names, units, force against columns."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from lacet.daq.errors import UsageError
from lacet.daq.units import TO_SI
from lacet.identify.car.kinematics import build_motion
from lacet.identify.car.motion import CornerMotion, Motion
from lacet.identify.car.rows import ROWS, Row
from lacet.identify.effects.base import Effect, is_sensor_fault
from lacet.identify.effects.catalogue import base_model, catalogue, effect_classes, find_effect
from lacet.identify.effects.excluded import EXCLUDED
from lacet.identify.multibody.chain import FrameMotion
from lacet.services.workspace.effect_files import own_classes
from tests.identify import cars

VEHICLE, RIG = cars.reference_car()
VEHICLE_T = cars.with_tables(VEHICLE)

RUNS = ("exact", "another")
"""The run of `cars.recording`, and one more."""
EFFECTS = {
    reference: catalogue(VEHICLE_T, reference, runs=RUNS) for reference in ("contact", "hub")
}  # every effect in the folder, found by walking
FAMILIES = effect_classes()
FAULTS = {key: fault for key, e in EFFECTS["hub"].items() if (fault := e.as_fault)}


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
            assert np.isfinite(parameter.low)
            assert np.isfinite(parameter.high)
        names += [parameter.name for parameter in effect.parameters]
        for one in (shape for shape in effect.shapes() if shape.as_fault is None):
            values = rng.normal(size=len(one.parameters))
            columns, force = one.columns(motion), one.force(motion, values)
            assert columns.keys() == force.keys(), key
            for row, table in columns.items():
                assert row in ROWS, (key, row)
                assert table.shape == (len(one.parameters), motion.t.size), (key, row, table.shape)
                assert np.all(np.isfinite(table)), (key, row)
                assert _declared(row, one.rows), f"{key} acts on {row} and does not say so"
                expected = values @ table
                atol = 1e-9 * (1.0 + np.max(np.abs(expected)))
                np.testing.assert_allclose(force[row], expected, atol=atol, err_msg=f"{key} {row}")
    assert len(names) == len(set(names)), "two effects share a parameter name"


def _declared(row: str, rows: tuple[str, ...]) -> bool:
    return row in rows or row.partition(".")[0] in rows


def test_what_the_measurements_hold_says_why_and_has_no_namesake() -> None:
    """Texts and a reason of each effect that cannot be missing; none is in the catalogue too."""
    assert len(EXCLUDED) >= 5
    assert len({one.name for one in EXCLUDED}) == len(EXCLUDED)
    for one in EXCLUDED:
        assert one.name not in FAMILIES
        for text in (one.about, one.law, one.signature, one.shown_by, one.source):
            assert len(text.strip()) > 3, one.name
        assert len(one.measured_by) > 20


@pytest.mark.parametrize("name", FAMILIES)
def test_every_family_says_what_it_is(name: str) -> None:
    """Texts, rows that are acted on, families it looks like."""
    family = FAMILIES[name]
    for text in (family.about, family.signature, family.shown_by, family.source):
        assert len(text.strip()) > 3, name
    assert family.__doc__
    assert set(family.looks_like) <= set(FAMILIES) - {name}
    for other in family.looks_like:
        if not FAMILIES[other].base:
            assert name in FAMILIES[other].looks_like, f"{name} looks like {other}, which does not look like it"
    found = [e for effects in EFFECTS.values() for e in effects.values() if e.name == name]
    assert found
    if is_sensor_fault(family):
        assert not family.rows, "a fault acts on the rows its channels enter"
        return
    motions = [
        build_motion(cars.recording(cars.random_signals(5), VEHICLE_T, cars.in_reference(RIG, reference)))
        for reference in EFFECTS
    ]
    acted = {row for e in found for m in motions for row, table in e.shapes()[0].columns(m).items() if np.any(table)}
    for row in family.rows:
        assert any(_declared(one, (row,)) for one in acted), f"{name} says it acts on {row} and does not"


# ---- units, by scaling mass, length and time

Dimension = tuple[int, int, int]
"""Powers of mass, length and time."""

_DIMENSION: dict[str, Dimension] = {
    "travel": (0, 1, 0), "rate": (0, 1, -1), "accel": (0, 1, -2), "steer": (0, 0, 0), "camber": (0, 0, 0),
    "pitch": (0, 0, 0), "axes": (0, 0, 0), "centre": (0, 1, 0), "shift": (0, 1, 0), "dp_ds": (0, 0, 0),
    "dphi_ds": (0, -1, 0), "wheel_dphi_ds": (0, -1, 0), "torque_work": (1, 1, -2), "torque": (1, 2, -2),
    "torque_on_carrier": (1, 2, -2), "wheel_on_carrier": (0, 0, 0),
    "force": (1, 1, -2), "moment": (1, 2, -2), "spin_axis": (0, 0, 0), "spin": (0, 0, -1), "spin_accel": (0, 0, -2),
    "normal": (0, 0, 0), "height": (0, 1, 0), "deflection": (0, 1, 0), "deflection_rate": (0, 1, -1),
    "centre_accel": (0, 1, -2), "omega": (0, 0, -1), "omega_dot": (0, 0, -2), "t": (0, 0, 1), "velocity": (0, 1, -1),
    "attitude": (0, 0, 0),
}  # fmt: skip
_UNITS: dict[str, Dimension] = {
    "N": (1, 1, -2), "kg": (1, 0, 0), "m": (0, 1, 0), "s": (0, 0, 1), "rad": (0, 0, 0), "-": (0, 0, 0),
    "µm": (0, 1, 0), "µrad": (0, 0, 0),
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
        if effect.as_fault is not None:
            continue
        for parameter in effect.parameters:
            assert parameter.unit in TO_SI, f"{parameter.name}: a vehicle file cannot give a value in {parameter.unit}"
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
            before[row][k]
            * factor(tuple(np.subtract(dimension(Row.parse(row).unit), dimension(parameter.unit)).tolist())),
            rtol=1e-9,
            atol=1e-12 * float(np.max(np.abs(after[row]))),
        )
        for row in before
        for k, parameter in enumerate(effect.parameters)
    )


# ---- left and right

_POLAR = {"shift", "centre", "dp_ds", "force", "normal", "centre_accel", "accel", "velocity"}
"""Vectors that a mirror at the middle plane turns in y; of others (moments, rates) it turns x and z."""
_AXIAL = {"dphi_ds", "wheel_dphi_ds", "moment", "spin_axis", "omega", "omega_dot", "attitude"}
_ANGLES = {"steer", "camber"}
_OTHER = {"fl": "fr", "fr": "fl", "rl": "rr", "rr": "rl"}
_ODD_ROWS = {"chassis.fy", "chassis.mx", "chassis.mz"}


def mirrored(part: Any) -> Any:
    """A motion, corner or frame as a mirror at the middle plane shows it (wheels' own frames left as they are)."""
    changes: dict[str, Any] = {}
    for field in fields(part):
        value, name = getattr(part, field.name), field.name
        if name == "corners":
            changes[name] = {_OTHER[c]: mirrored(corner) for c, corner in value.items()}
        elif name in ("body", "axle"):
            changes[name] = mirrored(value)
        elif isinstance(value, np.ndarray) and value.ndim == 2:
            flip = [[1.0], [-1.0], [1.0]] if name in _POLAR else [[-1.0], [1.0], [-1.0]]
            assert name in _POLAR | _AXIAL, name
            changes[name] = value * flip
        elif name == "axes":  # the mirror before the rotation and after it
            changes[name] = value * np.outer([1.0, -1.0, 1.0], [1.0, -1.0, 1.0])[:, :, None]
        elif name in _ANGLES:
            changes[name] = -value
    return replace(part, **changes)


@pytest.mark.parametrize("reference", ["contact", "hub"])
def test_left_and_right_are_alike(reference: str) -> None:
    """The mirrored car has the mirrored forces: columns with their rows' signs, an axle's and the whole car's too."""
    motion = build_motion(cars.recording(cars.random_signals(6), VEHICLE_T, cars.in_reference(RIG, reference)))
    other = mirrored(motion)
    for effect in EFFECTS[reference].values():
        if effect.as_fault is not None or effect.name in (
            "body",
            "payload",
        ):  # those have parameters that a mirror turns round
            continue
        twin = replace(effect, where=_OTHER.get(effect.where, effect.where))
        before, after = effect.shapes()[-1].columns(motion), twin.shapes()[-1].columns(other)
        swapped = {row: ".".join(_OTHER.get(word, word) for word in row.split(".")) for row in before}
        assert set(swapped.values()) == set(after), effect.key
        for row, there in swapped.items():
            sign = -1.0 if row in _ODD_ROWS else 1.0
            size = float(np.max(np.abs(before[row]))) + 1e-12
            np.testing.assert_allclose(
                after[there], sign * before[row], atol=1e-9 * size, err_msg=f"{effect.key} {row}"
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
    assert families == set(FAMILIES)
    order = [effect.base for effect in EFFECTS["hub"].values()]
    assert order == sorted(order, reverse=True)


def test_a_wrong_key_gets_the_nearest() -> None:
    """`anti_rol_bar.front` is a slip of the pen."""
    with pytest.raises(UsageError, match=r"did you mean 'anti_roll_bar\.front'"):
        find_effect("anti_rol_bar.front", EFFECTS["hub"])
    assert find_effect("anti_roll_bar.front", EFFECTS["hub"]).key == "anti_roll_bar.front"


_OWN = """
from lacet import SuspensionForce

class Mine(SuspensionForce):
    name = "mine"
    about = "one of my own"
    signature, shown_by, source = "a force that follows travel", "rolling", "made up"

    @property
    def parameters(self):
        return (self.named("k", "N/m", -1e5, 1e5, "any"),)

    def law(self, travel, rate):
        return travel
"""


def test_a_users_folder_joins_and_faults_in_it_are_named(tmp_path) -> None:
    """An effect in a user's file is found; a file that cannot be loaded or a second of the same name is an error."""
    (tmp_path / "mine.py").write_text(_OWN, encoding="utf-8")
    assert "mine.front" in catalogue(VEHICLE, "hub", own_classes(tmp_path))
    (tmp_path / "twice.py").write_text(_OWN.replace('"mine"', '"spring"'), encoding="utf-8")
    with pytest.raises(UsageError, match="two effects are called 'spring'"):
        catalogue(VEHICLE, "hub", own_classes(tmp_path))
    (tmp_path / "twice.py").write_text("import nothing_of_this_name", encoding="utf-8")
    with pytest.raises(UsageError, match=r"twice\.py"):
        catalogue(VEHICLE, "hub", own_classes(tmp_path))


@pytest.mark.parametrize(
    ("line", "instead"),
    [
        ("from identify.effect import SuspensionForce, Parameter", "from lacet import Parameter, SuspensionForce"),
        ("from identify.effect import Effect", "from lacet import PhysicalEffect"),
        ("from identify.motion import Motion", "from lacet import Motion"),
        ("from lacet.identify.effects.base import TyreForce", "from lacet import TyreForce"),
        ("from lacet.identify import effects", "from lacet import effects"),
        ("from lacet import identify", "from lacet import …"),
        ("import lacet.identify.effects.base", "from lacet import …"),
    ],
)
def test_a_users_file_of_an_earlier_version_is_refused_naming_the_new_line(tmp_path, line: str, instead: str) -> None:
    """The line at fault and what to write instead; the same in a comment or a text is nobody's business."""
    file = tmp_path / "mine.py"
    file.write_text(f"# from identify.effect import Effect\n{line}\n{_OWN}", encoding="utf-8")
    with pytest.raises(UsageError) as refused:
        catalogue(VEHICLE, "hub", own_classes(tmp_path))
    assert str(file) in str(refused.value)
    assert "line 2" in str(refused.value)
    assert str(refused.value).endswith(f"Write: {instead}")
