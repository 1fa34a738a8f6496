"""Parameters and derived values in plain words, with the paper's symbol or the formula's beside."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from typing import Any

from lacet.identify.car.car_tree import AXLE, CHASSIS, FIRST_JOINT, WHEEL
from lacet.services.render.effect_text import effect_label
from lacet.services.render.rows import CORNER_WORDS

_RIGID = {
    "XX": "roll inertia", "YY": "pitch inertia", "ZZ": "yaw inertia", "XY": "product of inertia xy",
    "XZ": "product of inertia xz", "YZ": "product of inertia yz", "MX": "first moment x", "MY": "first moment y",
    "MZ": "first moment z", "M": "mass",
}  # fmt: skip
_OF_WHEEL = {
    "ZZ": "inertia about its axle",
    "XX": "inertia across its axle",
    "MZ": "first moment along its axle",
    "M": "mass",
}
_FAMILIES = {
    "anti_roll_bar": "anti-roll bar rate", "spring": "spring rate", "damper": "damper rate", "coulomb": "friction",
    "offset": "static suspension force", "tyre_stiffness": "tyre stiffness", "tyre_damping": "tyre damping",
    "outboard_mass": "mass of rim and tyre",
}  # fmt: skip
"""The one parameter of an effect, where its key does not say what it is."""
_PLACES = {**CORNER_WORDS, "front": "front", "rear": "rear"}
_PAPER = {"spring": "ks", "damper": "hs", "offset": "off", "coulomb": "fs", "tyre_stiffness": "ks"}
"""The paper's symbols of the suspensions and tyres, each with the number of a joint."""
_AT = {**dict.fromkeys(_PAPER, 2), "tyre_stiffness": 8}
"""Places of those joints after the first of a corner's branch: damper clearance and tyre deflection."""
_RIGID_NAME = re.compile(r"(XX|YY|ZZ|XY|XZ|YZ|MX|MY|MZ|M)(\d+)")

_DERIVED = {
    "ride_rate": ("ride rate", "k·kt/(k + kt)"),
    "static_load": ("wheel load at rest", "Fz"),
    "damping_ratio": ("body's damping ratio", "ζ"),
    "ride_frequency": ("body's natural frequency", "f"),
    "hop_frequency": ("wheel's natural frequency", "f"),
    "hop_damping_ratio": ("wheel's damping ratio", "ζ"),
    "heave.frequency": ("heave frequency", "f"),
    "heave.damping_ratio": ("heave damping ratio", "ζ"),
    "pitch.frequency": ("pitch frequency", "f"),
    "pitch.damping_ratio": ("pitch damping ratio", "ζ"),
    "roll.frequency": ("roll frequency", "f"),
    "roll.damping_ratio": ("roll damping ratio", "ζ"),
    "roll_stiffness": ("roll stiffness", "K"),
    "roll_stiffness_springs": ("of it springs", "k·t²/2"),
    "roll_stiffness_bars": ("of it anti-roll bar", "kb·t²"),
    "roll_stiffness_share.front": ("front share of roll stiffness", "Kf/(Kf + Kr)"),
    "roll_gradient": ("body roll per g", "φ/g"),
    "load_transfer": ("load transfer per g", "ΔFz"),
    "load_transfer_elastic": ("of it through springs and bar", "K·(φ − φa)/t"),
    "load_transfer_geometric": ("of it through the roll centre", "ms·h·g/t"),
    "load_transfer_unsprung": ("of it unsprung", "mu·hu·g/t"),
    "load_transfer_share.front": ("front share of load transfer", "ΔFz,f/ΔFz"),
    "static_share.front": ("weight on the front wheels", ""),
    "static_share.left": ("weight on the left wheels", ""),
    "static_share.cross": ("weight on front left and rear right", ""),
}


def derived_name(name: str) -> tuple[str, str]:
    """A derived value in plain words without its place, and its symbol or formula (``docs/derived.md``)."""
    family, summed, _ = name.partition(".sum.")
    if summed:
        return f"{_FAMILIES.get(family, effect_label(family))}, sum of all places", "Σ"
    kind = name if name in _DERIVED else name.partition(".")[0]
    return _DERIVED.get(kind, (name.replace("_", " ").replace(".", ", "), ""))


def parameter_name(name: str, effect: str) -> tuple[str, str]:
    """A parameter in plain words, and the paper's symbol of it, or lacet's where the paper has none.

    ``M6`` of the chassis is ``sprung mass``; ``spring.fl.k`` is ``front left spring rate`` and the paper's ``ks27``.
    """
    rigid = _RIGID_NAME.fullmatch(name)
    if rigid and effect.startswith("body."):
        return _rigid(rigid[1], int(rigid[2])), name
    family, *where, last = name.split(".")
    place = ".".join(where)
    if family in _FAMILIES and place in _PLACES:
        words = f"{_PLACES[place]} {_FAMILIES[family]}"
    elif place in _PLACES:
        words = f"{_PLACES[place]} {effect_label(family)}: {last}"
    else:
        words = f"{effect_label(effect)}: {last}"
    if place in FIRST_JOINT and family in _PAPER:
        return words, f"{_PAPER[family]}{FIRST_JOINT[place] + _AT[family]}"
    return words, name


def _rigid(kind: str, number: int) -> str:
    """A parameter of a rigid body by its number in the paper."""
    if number == CHASSIS:
        return "sprung mass" if kind == "M" else f"body: {_RIGID[kind]}"
    for bodies, what, words in ((AXLE, "wheel carrier", _RIGID), (WHEEL, "wheel", _OF_WHEEL)):
        for corner, own in bodies.items():
            if own == number:
                return f"{what} {CORNER_WORDS[corner]}: {words[kind]}"
    return f"{_RIGID[kind]} of body {number}"


def summed(parameter: Mapping[str, Any], added: Collection[str]) -> str:
    """The sum that the value of an added effect's parameter is, with the other parameters in it.

    Empty where the runs show the parameter alone, and for parameters of the base model: their groups are the paper's.
    """
    alone = parameter["group"] == parameter["name"]
    return "" if alone or parameter["effect"] not in added else str(parameter["group"])
