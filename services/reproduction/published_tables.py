"""Published values of the paper's tables 1 to 7, with the parameter of lacet that each corresponds to.

Nothing here is corrected silently: where our copy of the paper is not legible, or two lines are interchanged, the
line has a note. Tables 1 to 4 are the identification of a simulated car, 5 to 7 that of the real one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

ILLEGIBLE = "not legible in our copy of the paper"
ZERO = "the paper counts travel from another zero (about 0.3 m away): its number is no static load"


@dataclass(frozen=True)
class Line:
    """One line of a table.

    Attributes
    ----------
    table : number of the table; `name` : the parameter's name in the paper; `unit` : unit of its numbers.
    apriori, estimated, sxr : as printed [unit, unit, %]; None where the paper has no value or it is not legible.
    key : the same quantity in lacet: a parameter, or a value of the whole vehicle (`mass`, ``cog.x``, ``Ixx``).
    scale : printed number = scale × lacet's SI value: 1000 for millimetres, negative where the paper's axes, x to the
        rear and y to the right, reverse the sign.
    note : note for the reader of the line.
    """

    table: int
    name: str
    unit: str
    apriori: float | None
    estimated: float | None
    sxr: float | None
    key: str
    scale: float = 1.0
    note: str = ""

    @property
    def error(self) -> float | None:
        """The paper's own error, estimate minus a-priori value [unit]."""
        return None if self.estimated is None or self.apriori is None else self.estimated - self.apriori

    @property
    def offset(self) -> bool:
        """Whether the line is a static offset of a suspension, which depends on the paper's zero of travel."""
        return self.key.startswith("offset.")

    @property
    def of_friction(self) -> bool:
        """Whether the line is a suspension's friction, which not every car has."""
        return self.key.startswith("coulomb.")


Printed = tuple[float | None, float | None, float | None]
"""A-priori value, estimate and sxr [%] as printed."""

_WHOLE = {
    "XX": ("Ixx", "kg·m²", 1.0),
    "YY": ("Iyy", "kg·m²", 1.0),
    "ZZ": ("Izz", "kg·m²", 1.0),
    "XY": ("Ixy", "kg·m²", 1.0),
    "XZ": ("Ixz", "kg·m²", -1.0),
    "YZ": ("Iyz", "kg·m²", -1.0),
    "X_G": ("cog.x", "mm", -1000.0),
    "Y_G": ("cog.y", "mm", -1000.0),
    "Z_G": ("cog.z", "mm", 1000.0),
    "M": ("mass", "kg", 1.0),
}
_TABLE_1: dict[str, Printed] = {
    "XX6": (630.0, 644.66, 0.96),
    "YY6": (2250.0, 2329.26, 0.14),
    "ZZ6": (2734.0, 2840.83, 0.52),
    "XY6": (None, None, None),
    "XZ6": (20.0, 30.54, 2.01),
    "YZ6": (None, None, None),
    "X_G": (1112.5, 1111.06, 0.002),
    "Y_G": (0.0, -5.16, 38.05),
    "Z_G": (259.7, 261.43, 2.00),
    "M6": (1668.5, 1668.55, 0.07),
}
_TABLE_5: dict[str, Printed] = {
    "XX_G": (630.0, 760.31, 1.35),
    "ZZ_G": (2734.0, 2783.96, 0.36),
    "XZ_G": (20.0, 45.0, 1.16),
    "X_G": (1112.5, 1131.06, 0.06),
    "Y_G": (0.0, -5.16, 0.80),
    "Z_G": (259.7, 246.69, 1.14),
    "M6": (1668.5, 1668.53, 0.07),
}
_NOTES = {
    (1, "XY6"): ILLEGIBLE,
    (1, "YZ6"): ILLEGIBLE,
    (1, "Y_G"): "columns shifted in our copy, read across",
    (1, "Z_G"): "columns shifted in our copy, read across",
    (5, "XX_G"): "printed as ZZ_G: table 5 interchanges the two",
    (5, "ZZ_G"): "printed as XX_G: table 5 interchanges the two",
}
_CORNERS = {9: "rl", 18: "rr", 27: "fl", 36: "fr"}
_KINDS = {"fs": ("coulomb", "f", "N"), "off": ("offset", "f0", "N"), "ks": ("spring", "k", "N/m"),
          "hs": ("damper", "c", "N·s/m"), "h": ("damper", "c", "N·s/m")}  # fmt: skip
_TABLE_2: dict[int, dict[str, Printed]] = {
    9: {"ks": (22000.0, 22295.78, 0.02), "hs": (3800.0, 3823.86, 0.07), "off": (None, 9639.46, 0.01)},
    18: {"ks": (22000.0, 22193.35, 0.06), "hs": (3800.0, 3843.34, 0.02), "off": (None, 9474.54, 0.01)},
    27: {"ks": (20000.0, 20683.35, 0.06), "hs": (3200.0, 3198.86, 0.02), "off": (None, 10421.41, 0.01)},
    36: {"ks": (20000.0, 20604.04, 0.02), "hs": (3200.0, 3188.27, 0.07), "off": (None, 10512.0, 0.01)},
}
_TABLE_6: dict[int, dict[str, Printed]] = {
    9: {
        "fs": (None, 19.80, 4.94),
        "off": (None, 11376.21, 0.91),
        "ks": (22000.0, 27059.51, 1.32),
        "h": (4200.0, 4526.08, 1.24),
    },
    18: {
        "fs": (None, 44.91, 1.93),
        "off": (None, 9992.02, 0.97),
        "ks": (22000.0, 23317.02, 1.44),
        "h": (4200.0, 4274.80, 1.07),
    },
    27: {
        "fs": (None, 32.94, 3.04),
        "off": (None, 12890.90, 0.75),
        "ks": (20000.0, 27129.51, 1.18),
        "h": (3200.0, 3306.20, 1.36),
    },
    36: {
        "fs": (None, 50.35, 1.92),
        "off": (None, 13103.00, 0.77),
        "ks": (20000.0, 27084.50, 1.24),
        "h": (3200.0, 3408.44, 1.21),
    },
}
_BARS: dict[str, tuple[str, Printed]] = {
    "karr": ("rear", (19185.0, 24785.43, 0.70)),
    "karf": ("front", (19780.0, 18394.90, 0.89)),
}
_TABLE_3: dict[int, tuple[str, Printed]] = {
    14: ("rl", (None, 1.02, 1.50)),
    23: ("rr", (1.0, 1.02, 1.40)),
    32: ("fl", (1.0, -51.72, 5.42)),
    41: ("fr", (1.0, -51.60, 4.78)),
}
_TABLE_4: dict[int, tuple[str, Printed]] = {
    15: ("rl", (200000.0, 203483.93, 0.07)),
    24: ("rr", (200000.0, 196251.29, 0.08)),
    33: ("fl", (200000.0, 206040.0, 0.12)),
    42: ("fr", (200000.0, 194402.9, 0.13)),
}
_TABLE_7: dict[int, tuple[str, Printed]] = {
    15: ("rl", (200000.0, 216502.50, 0.32)),
    24: ("rr", (200000.0, 217816.21, 0.31)),
    33: ("fl", (200000.0, 232581.41, 0.37)),
    42: ("fr", (200000.0, 230549.08, 0.37)),
}


def _lines() -> Iterator[Line]:
    for table, rows in ((1, _TABLE_1), (5, _TABLE_5)):
        for name, printed in rows.items():
            key, unit, scale = _WHOLE[name if name in _WHOLE else name.rstrip("6").removesuffix("_G")]
            yield Line(table, name, unit, *printed, key, scale, _NOTES.get((table, name), ""))
    for joint, rows in _TABLE_2.items():
        yield from _corner(2, joint, rows)
    for number, (_, printed) in _TABLE_3.items():
        note = "" if printed[0] is not None else "a-priori value blank in our copy"
        yield Line(3, f"ZZ{number}", "kg·m²", *printed, f"ZZ{number}", note=note)
    for number, (corner, printed) in _TABLE_4.items():
        yield Line(4, f"ks{number}", "N/m", *printed, f"tyre_stiffness.{corner}.kt")
    for joint, rows in _TABLE_6.items():
        yield from _corner(6, joint, rows)
    for name, (axle, printed) in _BARS.items():
        yield Line(6, name, "N/m", *printed, f"anti_roll_bar.{axle}.k")
    for number, (corner, printed) in _TABLE_7.items():
        yield Line(7, f"kt{number}", "N/m", *printed, f"tyre_stiffness.{corner}.kt")


def _corner(table: int, joint: int, rows: dict[str, Printed]) -> Iterator[Line]:
    for kind, printed in rows.items():
        effect, parameter, unit = _KINDS[kind]
        note = ZERO if kind == "off" else ""
        yield Line(table, f"{kind}{joint}", unit, *printed, f"{effect}.{_CORNERS[joint]}.{parameter}", note=note)


LINES: tuple[Line, ...] = tuple(sorted(_lines(), key=lambda line: line.table))
"""Every line of tables 1 to 7, table by table."""

SPIN_ROWS = {f"ZZ{number}": f"spin.{corner}" for number, (corner, _) in _TABLE_3.items()}
"""Spin inertia → the row of the equations from which the paper identifies it."""

TITLES = {
    1: "the whole vehicle, simulation",
    2: "the suspensions, simulation",
    3: "the wheels, simulation",
    4: "the tyres, simulation",
    5: "the whole vehicle, experiment",
    6: "the suspensions, experiment",
    7: "the tyres, experiment",
}
