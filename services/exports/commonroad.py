"""CommonRoad: vehicle parameters in the YAML form of commonroad-vehicle-models, in its names and units.

Source: Althoff and Würsching (2020), CommonRoad: Vehicle Models; version 3.0.2 of the package.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lacet.daq.channels import CORNERS
from lacet.daq.errors import UsageError
from lacet.daq.vehicle import Vehicle
from lacet.services.exports.car import Part

LEFT_OUT = {
    "l, w": "outer dimensions are not in a vehicle file",
    "steering, longitudinal": "limits of actuators are not identified",
    "I_xz_s": "the format does not say its sign",
    "K_ras, K_rad, K_lt": "lateral compliance of the suspension pin and of the tyre is no effect of the model",
    "h_raf, h_rar, D_f, D_r, E_f, E_r": "the bench table's kinematics are not given in this form",
    "T_sb": "the split of the brakes is not identified",
    "tire": "tyre forces along and across the road are measured and have no law",
    "trailer": "there is none",
}
"""What the format has and lacet does not know → why."""
_ORDER = (
    "m", "m_s", "m_uf", "m_ur", "a", "b", "I_Phi_s", "I_y_s", "I_z", "K_sf", "K_sdf", "K_sr", "K_sdr", "T_f", "T_r",
    "K_tsf", "K_tsr", "K_zt", "h_cg", "h_s", "I_uf", "I_ur", "I_y_w", "R_w", "T_se",
)  # fmt: skip


class _Parameters:
    """Entries of the file: name → value, and what it is."""

    def __init__(self, result: Mapping[str, Any]):
        self.known = {p["name"]: p["value"] for p in result["parameters"]}
        self.entries: dict[str, tuple[float, str]] = {}
        self.lacking: dict[str, str] = {}

    def mean(self, name: str, axle: str, pattern: str, about: str) -> None:
        """Mean over the corners of an axle of an identified parameter."""
        corners = [c for c in CORNERS if c[0] in axle]
        names = [pattern.format(c=c) for c in corners]
        if lost := [n for n in names if n not in self.known]:
            self.lacking[name] = f"{', '.join(lost)} not identified"
            return
        self.entries[name] = float(np.mean([self.known[n] for n in names])), about

    def put(self, name: str, value: float, about: str) -> None:
        """A value with what it is."""
        self.entries[name] = float(value), about


def commonroad_text(
    vehicle: Vehicle, result: Mapping[str, Any], title: str, added: Sequence[str]
) -> tuple[str, dict[str, str]]:
    """The parameters as YAML text, and what was left out → why.

    `added` : keys of the model's effects that the base model has not.

    Raises UsageError when the runs do not determine the mass and centre of gravity of the chassis.
    """
    found = _Parameters(result)
    names = ("XX6", "XY6", "XZ6", "YY6", "YZ6", "ZZ6", "MX6", "MY6", "MZ6", "M6")
    if lost := [n for n in ("MX6", "MZ6", "M6") if n not in found.known]:
        raise UsageError(
            f"CommonRoad's models need mass and centre of gravity; the runs do not determine {', '.join(lost)}: lacet "
            "identify --why says what is missing; parameters can be exported as .toml, .mat, .csv or .json"
        )
    corners = vehicle.corners
    base = (
        float(np.mean([corners[c].position[0] for c in ("fl", "fr")])),
        float(np.mean([corners[c].position[0] for c in ("rl", "rr")])),
    )
    height = float(np.mean([corners[c].height for c in ("fl", "fr")]))
    chassis = Part.of(np.array([found.known.get(n, 0.0) for n in names]))
    found.put("m_s", chassis.mass, "sprung mass [kg]")
    found.put("a", base[0] - chassis.com[0], "centre of gravity of the sprung mass to the front axle [m]")
    found.put("b", chassis.com[0] - base[1], "centre of gravity of the sprung mass to the rear axle [m]")
    found.put("h_s", height + chassis.com[2], "centre of gravity of the sprung mass above ground [m]")
    for name, k, about in (("I_Phi_s", 0, "roll"), ("I_y_s", 1, "pitch"), ("I_z", 2, "yaw")):
        if names[(0, 3, 5)[k]] in found.known:
            found.put(name, float(chassis.tensor[k, k]), f"moment of inertia of the sprung mass in {about} [kg m^2]")
        else:
            found.lacking[name] = f"{names[(0, 3, 5)[k]]} not identified"
    _unsprung(found, vehicle, result, chassis, height)
    for axle, letter in (("front", "f"), ("rear", "r")):
        track = corners[f"{letter}l"].position[1] - corners[f"{letter}r"].position[1]
        found.mean(f"K_s{letter}", letter, "spring.{c}.k", f"wheel rate of the springs, {axle} [N/m]")
        found.mean(f"K_sd{letter}", letter, "damper.{c}.c", f"wheel rate of the dampers, {axle} [N s/m]")
        found.put(f"T_{letter}", track, f"track, {axle} [m], from the vehicle file")
        bar = f"anti_roll_bar.{axle}.k"
        if bar in found.known:
            found.put(f"K_ts{letter}", -found.known[bar] * track**2, f"-{bar} times track squared [N m/rad]")
        elif f"anti_roll_bar.{axle}" in result["effects"]:
            found.lacking[f"K_ts{letter}"] = f"{bar} not identified"
        else:
            found.put(f"K_ts{letter}", 0.0, f"the model has no anti-roll bar, {axle} [N m/rad]")
    found.mean("K_zt", "fr", "tyre_stiffness.{c}.kt", "vertical stiffness of a tyre [N/m]")
    found.put(
        "R_w", float(np.mean([c.tyre_radius for c in corners.values()])),
        "ASSUMED: unloaded tyre radius of the vehicle file; the rolling radius is smaller [m]",
    )  # fmt: skip
    driven = [all(corners[f"{a}{s}"].driven for s in "lr") for a in "fr"]
    if driven[0] != driven[1]:
        found.put("T_se", float(driven[0]), "share of the engine's torque at the front, from the driven wheels")
    else:
        found.lacking["T_se"] = "the split of the engine's torque between two axles is not identified"
    laws = {key: "the format has no place for it" for key in added if not key.startswith("anti_roll_bar.")}
    left_out = {**LEFT_OUT, **found.lacking, **laws}
    lines = [f"# {title}", "# Parameters of commonroad-vehicle-models, in its names and units (SI).", ""]
    for name in _ORDER:
        if name in found.entries:
            value, about = found.entries[name]
            lines += [f"# {about}", f"{name}: {value!r}"]
    lines += ["", "# Left out, because lacet does not know them:"]
    lines += [f"# {name}: {why}" for name, why in left_out.items()]
    return "\n".join(lines) + "\n", left_out


def _unsprung(found: _Parameters, vehicle: Vehicle, result: Mapping[str, Any], chassis: Part, height: float) -> None:
    """Unsprung masses, and what needs them: total mass, its centre of gravity, inertia of the axles."""
    from lacet.identify.car.car_tree import AXLE

    hub = result["wheel_reference"] == "hub"
    mass: dict[str, float] = {}
    for c in CORNERS:
        wanted = [f"M{AXLE[c]}", *([f"outboard_mass.{c}.m"] if hub else [])]
        if lost := [n for n in wanted if n not in found.known]:
            for name in ("m", f"m_u{c[0]}", "h_cg", f"I_u{c[0]}"):
                found.lacking[name] = f"{', '.join(lost)} not identified"
        else:
            mass[c] = sum(found.known[n] for n in wanted)
    for letter, axle in (("f", "front"), ("r", "rear")):
        pair = [c for c in mass if c[0] == letter]
        if len(pair) == 2:
            total = sum(mass[c] for c in pair)
            found.put(f"m_u{letter}", total, f"unsprung mass, {axle} [kg]")
            spread = sum(mass[c] * vehicle.corners[c].position[1] ** 2 for c in pair)
            found.put(f"I_u{letter}", spread, f"of the unsprung mass about x, {axle}: at its wheel centres [kg m^2]")
    if len(mass) == 4:
        total = chassis.mass + sum(mass.values())
        up = chassis.mass * chassis.com[2] + sum(m * vehicle.corners[c].position[2] for c, m in mass.items())
        found.put("m", total, "mass [kg]")
        found.put("h_cg", height + up / total, "centre of gravity of the whole above ground [m]")
    wheels = [f"ZZ{AXLE[c] + 3}" for c in CORNERS]
    if hub:
        found.lacking["I_y_w"] = "rim and tyre are outboard of the dynamometers"
    elif lost := [n for n in wheels if n not in found.known]:
        found.lacking["I_y_w"] = f"{', '.join(lost)} not identified"
    else:
        found.put("I_y_w", float(np.mean([found.known[n] for n in wheels])), "moment of inertia of a wheel [kg m^2]")
