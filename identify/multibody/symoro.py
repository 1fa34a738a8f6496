"""SYMORO's ``.par`` files: the table of a robot and the inertial parameters it has, as text with symbols.

Format: Khalil and Creusot (1997), "SYMORO+: a system for the symbolic modelling of robots"; OpenSYMORO's files. Keys
are read in either case. A closed loop is given there as a tree of NL bodies, then NJ − NL cut joints and as many frames
that close them: the tree is what is read.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from lacet.daq.errors import FileFault
from lacet.daq.expressions.expression import Expression
from lacet.identify.multibody.chain_notes import (
    ChainNote,
    ConstantPosition,
    GeometryMissing,
    GravityAssumed,
    LoadsLeftOut,
    LoopsCut,
    ParametersMissing,
)
from lacet.identify.multibody.rigid_body import FRICTION, PARAMETERS
from lacet.identify.multibody.symbolic_table import FIXED, GEOMETRY, Row, SymbolicTable

_LOADS = ("FX", "FY", "FZ", "CX", "CY", "CZ")
_BASE_MOTION = ("W0", "WP0", "V0", "VP0")
_COUNTS = ("NL", "NJ", "NF")
_FLAGS = ("is_floating", "is_mobile")
_VARIABLE = re.compile(r"(q|t|th|theta|r)_?\d+", re.IGNORECASE)


class ParError(FileFault, ValueError):
    """A ``.par`` file with faults."""


@dataclass(frozen=True)
class ParFile:
    """Contents of a SYMORO ``.par`` file.

    Attributes
    ----------
    name : of the robot, or nothing.
    table : the tree.
    gravity : acceleration of gravity in the ground frame, three entries; None when the file is silent.
    absent : standard, rotor and friction parameters that the file gives as 0: the body or joint has none.
    rotors : whether the file lists rotor inertias, which SYMORO counts among the inertial parameters.
    given : parameters that the file gives as something else than their own symbol.
    symbols : every symbol of the file.
    notes : what was assumed or left out.
    """

    name: str
    table: SymbolicTable
    gravity: tuple[Expression, ...] | None
    absent: frozenset[str]
    rotors: bool
    given: Mapping[str, Expression]
    symbols: frozenset[str]
    notes: tuple[ChainNote, ...]

    def field(
        self, values: Mapping[str, float], default: Sequence[float]
    ) -> tuple[tuple[float, ...], GravityAssumed | None]:
        """Gravity [m/s²] with the symbols' values; `default`, with a note, where its third entry has none (``G3``).

        Raises ValueError when another entry has no value.
        """
        if self.gravity is None:
            return tuple(default), GravityAssumed(tuple(default))
        lacks = sorted({s for e in self.gravity for s in e.symbols if s not in values})
        if not lacks:
            return tuple(e.value(values) for e in self.gravity), None
        if any(e.symbols or e.value({}) for e in self.gravity[:2]):
            raise ValueError(f"G needs the values of {', '.join(lacks)}: values={{'{lacks[0]}': …}}, or gravity=(…)")
        return tuple(default), GravityAssumed(tuple(default), tuple(lacks))


@dataclass(frozen=True)
class _Entry:
    text: str
    line: int


def read_par(text: str, name: str = "par file") -> ParFile:
    """Read the text of a ``.par`` file. Raises ParError with every fault, line by line."""
    return _Reader(text, name).read()


class _Reader:
    def __init__(self, text: str, name: str):
        self.name, self.text = name, text
        self.faults: list[tuple[int, str]] = []
        self.notes: list[ChainNote] = []
        self.symbols: set[str] = set()
        self.lists: dict[str, list[_Entry]] = {}
        self.lines: dict[str, int] = {}

    def fault(self, line: int, text: str) -> None:
        self.faults.append((line, f"line {line}: {text}" if line else text))

    def read(self) -> ParFile:
        self._statements()
        counts = self._counts()
        self._still_base()
        rows, variables = self._rows(counts["NL"], counts)
        absent, given = self._inertial(rows)
        gravity = self._gravity()
        if self.faults:
            raise ParError(self.name, [text for _, text in sorted(self.faults, key=lambda item: item[0])])
        found = re.search(r"\(\*[^*]*Robotname\s*=\s*'([^']*)'", self.text)
        table = SymbolicTable(tuple(rows), frozenset(variables))
        notes, symbols = tuple(self.notes), frozenset(self.symbols - variables)
        name = found.group(1).strip() if found else ""
        return ParFile(name, table, gravity, absent, "ia" in self.lists, given, symbols, notes)

    def _statements(self) -> None:
        """``key = {…}`` and ``key = value``, comments removed and lines counted."""
        text = re.sub(r"\(\*.*?\*\)", lambda m: re.sub(r"[^\n]", " ", m.group()), self.text, flags=re.DOTALL)
        if (start := text.find("(*")) >= 0:
            self.fault(text.count("\n", 0, start) + 1, "a comment (* that is never closed")
            text = text[:start]
        place = 0
        statement = re.compile(r"[\s;]*([A-Za-z_]\w*)[ \t]*=(?:\s*(\{[^{}=]*\})|[ \t]*([^{}=\n;\s][^{}=\n;]*))")
        while place < len(text) and text[place:].strip(" \t\r\n;\ufeff"):
            match = statement.match(text, place) or statement.match(text, place + (text[place] == "\ufeff"))
            if match is None:
                here = place + len(text[place:]) - len(text[place:].lstrip(" \t\r\n;"))
                words = text[here:].split("\n", 1)[0].strip()
                self.fault(
                    text.count("\n", 0, here) + 1,
                    f"'{words[:60]}' cannot be read: "
                    + ("its brace is never closed" if "{" in words else "'key = value' or 'key = {…}' expected"),
                )
                place = text.find("\n", here) + 1 or len(text)
                continue
            key, value = match.group(1).casefold(), match.group(2) or match.group(3)
            line = text.count("\n", 0, match.start(1)) + 1
            if key in self.lists:
                self.fault(line, f"{match.group(1)} is given twice, first in line {self.lines[key]}")
            inside = value.startswith("{")
            first = text.count("\n", 0, match.start(2) if inside else match.start(3)) + 1
            self.lines[key] = line
            self.lists[key] = _split(value[1:-1], first) if inside else [_Entry(value.strip(), first)]
            place = match.end()

    def _counts(self) -> dict[str, int]:
        out: dict[str, int] = {}
        for key in _COUNTS:
            entry = self._single(key)
            if entry is None:
                continue
            if not re.fullmatch(r"\d+", entry.text):
                self.fault(entry.line, f"{key} must be a whole number, found '{entry.text}'")
                continue
            out[key] = int(entry.text)
        listed = len(self.lists.get("ant", ()))
        if "NL" not in out:
            if "nl" not in self.lists:
                self.fault(0, "NL, the number of bodies, is missing")
            out["NL"] = out.get("NJ", listed)
        if listed and out["NL"] > listed:  # reported here, before lists of that length are made
            self.fault(self.lines["ant"], f"ant has {listed} entries, NL is {out['NL']}")
            out["NL"] = listed
        out.setdefault("NJ", out["NL"])
        out.setdefault("NF", 2 * out["NJ"] - out["NL"])
        if not 0 < out["NL"] <= out["NJ"] <= out["NF"] and not self.faults:
            self.fault(self.lines["nl"], f"0 < NL ≤ NJ ≤ NF expected, found {out['NL']}, {out['NJ']}, {out['NF']}")
        if out["NJ"] > out["NL"]:
            self.notes.append(LoopsCut(out["NL"], tuple(range(out["NL"] + 1, out["NJ"] + 1))))
        return out

    def _single(self, key: str) -> _Entry | None:
        entries = self.lists.get(key.casefold())
        if entries is None:
            return None
        if len(entries) != 1:
            self.fault(self.lines[key.casefold()], f"{key} must be one value")
            return None
        return entries[0]

    def _still_base(self) -> None:
        for key in _FLAGS:
            entry = self._single(key)
            if entry is not None and entry.text.casefold() not in ("0", "false"):
                self.fault(
                    entry.line,
                    f"{key} = {entry.text}: a moving base is not read; describe it by six joints before joint 1 "
                    "(three prismatic, three revolute, bodies 1 to 5 with all parameters 0)",
                )
        for key in _BASE_MOTION:
            for entry in self.lists.get(key.casefold(), []):
                expression = self._expression(entry, key)
                if expression is not None and (expression.symbols or expression.value({}) != 0.0):
                    self.fault(entry.line, f"{key}: the base must be at rest (all 0), found '{entry.text}'")
        loads = tuple(k for k in _LOADS if any(e.text != "0" for e in self.lists.get(k.casefold(), [])))
        if loads:
            self.notes.append(LoadsLeftOut(loads))

    def _list(self, key: str, counts: Mapping[str, int], required: bool = False) -> list[_Entry]:
        """The entries of the tree's rows."""
        n = counts["NL"]
        entries = self.lists.get(key.casefold())
        if entries is None:
            if required:
                self.fault(0, f"{key} is missing")
            return [_Entry("0", 0)] * n
        allowed = sorted(set(counts.values()))
        if len(entries) not in allowed:
            expected = " or ".join(str(k) for k in allowed)
            self.fault(self.lines[key.casefold()], f"{key} has {len(entries)} entries, {expected} expected")
        return (entries + [_Entry("0", 0)] * n)[:n]

    def _expression(self, entry: _Entry, field: str) -> Expression | None:
        try:
            out = Expression.parse(entry.text)
            self.symbols |= out.symbols
            if not out.symbols:
                out.value({})
            return out
        except ValueError as error:
            self.fault(entry.line, f"{field}: {error}")
            return None

    def _integers(self, key: str, counts: Mapping[str, int]) -> list[int]:
        out: list[int] = []
        for j, entry in enumerate(self._list(key, counts, required=True), start=1):
            if not re.fullmatch(r"\d+", entry.text):
                self.fault(entry.line, f"{key} of joint {j} must be a whole number, found '{entry.text}'")
            out.append(int(entry.text) if re.fullmatch(r"\d+", entry.text) else 0)
            top = j - 1 if key == "ant" else FIXED
            if out[-1] > top:
                self.fault(
                    entry.line,
                    f"{key} of joint {j} is {out[-1]}: "
                    + ("a joint comes after its antecedent" if key == "ant" else "0, 1 or 2 expected"),
                )
                out[-1] = 0
        return out

    def _rows(self, n: int, counts: Mapping[str, int]) -> tuple[list[Row], set[str]]:
        ants, sigmas = self._integers("ant", counts), self._integers("sigma", counts)
        columns = {key: self._list(key, counts) for key in GEOMETRY}
        if silent := tuple(key for key in GEOMETRY if key not in self.lists):
            self.notes.append(GeometryMissing(silent))
        entries: list[dict[str, Expression]] = []
        for j in range(1, n + 1):
            found = {key: self._expression(column[j - 1], f"{key} of joint {j}") for key, column in columns.items()}
            entries.append({key: e or Expression.of(0.0) for key, e in found.items()})
        moving = {0: "theta", 1: "r"}
        fixed_symbols = {
            s for row, sigma in zip(entries, sigmas, strict=True) for key, e in row.items()
            if key != moving.get(sigma) for s in e.symbols
        }  # fmt: skip
        variables: dict[str, int] = {}
        for j, (row, sigma) in enumerate(zip(entries, sigmas, strict=True), start=1):
            if sigma not in moving:
                continue
            key = moving[sigma]
            name = self._variable(row[key], key, j, columns[key][j - 1].line, fixed_symbols)
            if name in variables:
                self.fault(columns[key][j - 1].line, f"{name} is the position of joint {variables[name]} and of {j}")
            if name:
                variables[name] = j
        rows = [Row(j, ants[j - 1], sigmas[j - 1], entries[j - 1]) for j in range(1, n + 1)]
        return rows, set(variables)

    def _variable(self, entry: Expression, key: str, joint: int, line: int, elsewhere: set[str]) -> str:
        """The joint position in the entry of a `joint`, which may have a constant beside it."""
        names = entry.symbols - elsewhere
        if not entry.symbols:
            if entry.value({}) != 0.0:
                self.notes.append(ConstantPosition(key, joint, entry.text))
            return ""
        field = f"{key} of joint {joint}"
        if len(names) > 1:
            names = frozenset(s for s in names if _VARIABLE.fullmatch(s))
        if len(names) != 1:
            self.fault(line, f"{field}: one joint position expected in '{entry.text}', alone or with a constant added")
            return ""
        name = next(iter(names))
        others = dict.fromkeys(entry.symbols, 0.7)
        try:
            steps = [entry.value({**others, name: at + 1.0}) - entry.value({**others, name: at}) for at in (0.0, 0.37)]
        except ValueError:
            steps = [0.0]
        if any(abs(step - 1.0) > 1e-9 for step in steps):
            self.fault(line, f"{field}: '{entry.text}' is not the joint position {name} plus a constant")
        return name

    def _inertial(self, rows: list[Row]) -> tuple[frozenset[str], dict[str, Expression]]:
        n = len(rows)
        counts = {"NL": n, "NJ": n}
        counts |= {"NJ": int(e.text)} if (e := self._single("NJ")) and e.text.isdigit() else {}
        counts |= {"NF": int(e.text)} if (e := self._single("NF")) and e.text.isdigit() else {}
        absent: set[str] = set()
        given: dict[str, Expression] = {}
        if silent := tuple(kind for kind in PARAMETERS if kind.casefold() not in self.lists):
            self.notes.append(ParametersMissing(silent))
        for kind in (*PARAMETERS, *FRICTION):
            if kind.casefold() not in self.lists:
                continue
            for j, entry in enumerate(self._list(kind, counts), start=1):
                name = f"{kind}{j}"
                expression = self._expression(entry, f"{kind} of body {j}")
                if expression is None or entry.text == name:
                    continue
                if not expression.symbols and expression.value({}) == 0.0:
                    absent.add(name)
                else:
                    given[name] = expression
        return frozenset(absent), given

    def _gravity(self) -> tuple[Expression, ...] | None:
        entries = self.lists.get("g")
        if entries is None:
            return None
        if len(entries) != 3:
            self.fault(self.lines["g"], f"G has {len(entries)} entries, 3 expected")
        found = [self._expression(entry, "G") for entry in entries]
        return tuple(e or Expression.of(0.0) for e in found)


def _split(inside: str, line: int) -> list[_Entry]:
    """Entries between commas that stand in no bracket; each with the line it ends in."""
    out: list[_Entry] = []
    depth, start = 0, 0
    for place, sign in enumerate((*inside, ",")):
        depth += (sign == "(") - (sign == ")")
        if sign == "," and depth <= 0:
            out.append(_Entry(" ".join(inside[start:place].split()), line + inside.count("\n", 0, place)))
            start, depth = place + 1, 0
    if out and not out[-1].text and len(out) > 1:  # a comma after the last entry
        out.pop()
    return out
