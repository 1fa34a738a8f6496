"""Parser of one-line effects: ``bump = suspension: p * travel**2 * sign(rate)``.

::

    [NAME =] WHERE: LAW [; WHERE: LAW …] [, CONSTANT = VALUES UNIT …] [, PARAMETER in LOW..HIGH UNIT …] [# what it is]

The law is parsed, never executed (`daq.expressions`). It must be linear in its parameters, the names without any
other meaning; constants in which it is not linear are listed after it and searched. Units are checked, and those of
the parameters follow.
"""

from __future__ import annotations

import ast
import difflib
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from lacet.daq.channels import CORNERS
from lacet.daq.dimension import FORCE, LENGTH, TIME, Dimension
from lacet.daq.errors import UsageError, nearest
from lacet.daq.expressions.dimensions import Dimensions
from lacet.daq.expressions.expression import CONSTANTS, Expression, ExpressionFault
from lacet.daq.expressions.written import NUMBER_TEXT, read_expression
from lacet.daq.expressions.written_units import whole_unit
from lacet.identify.car.rows import CHASSIS_ROWS, Row
from lacet.identify.effects.base import AXLES
from lacet.identify.effects.language.linearity import FUNCTIONS, check_memory, has_memory, terms_of
from lacet.identify.effects.language.states import STATES, SUFFIXES, Use, all_names, use_of

LONGEST = 1000
"""Length of the longest line [characters]."""
MOST_SHAPES = 100
"""Largest number of combinations of shape constants."""
KINDS = ("suspension", "tyre", "spin")
PLACES = ("front", "rear", "all", *CORNERS)
_LIST = re.compile(rf"\s*([-+]?{NUMBER_TEXT})(?=[\s°%A-Za-z]|$)")
_BOUNDS = re.compile(rf"\s*([-+]?{NUMBER_TEXT})\s*\.\.\s*([-+]?{NUMBER_TEXT})")
_ALIKE = 0.85
_WORDS = "the form is NAME = WHERE: LAW, as in  bump = suspension: p * travel**2 * sign(rate)"


class LineFault(UsageError):
    """A fault in a one-line effect: the reason, with a mark under the place."""

    def __init__(self, text: str, says: str, start: int = 0, stop: int | None = None):
        stop = len(text) if stop is None else stop
        super().__init__(f"{says}\n  {text}\n  {' ' * start}{'^' * max(1, stop - start)}")
        self.text, self.says, self.start, self.stop = text, says, start, stop


@dataclass(frozen=True)
class RowLaw:
    """The law of a one-line effect in one row of the equations.

    Attributes
    ----------
    row : ``suspension``, ``tyre``, ``spin`` or a chassis row such as ``chassis.fx``.
    place : ``front``, ``rear``, ``all`` or a corner; empty where each variant has its own.
    text : the law as written.
    terms : parameter → its factor.
    uses : the states in it by name.
    """

    row: str
    place: str
    text: str
    terms: Mapping[str, Expression]
    uses: Mapping[str, Use]

    @property
    def named(self) -> str:
        """Row with place, ``suspension.front``."""
        return f"{self.row}.{self.place}" if self.place else self.row

    @property
    def first_row(self) -> Row:
        """The row of the equations it acts in; of the four of the wheels, which are alike, the first."""
        return Row.parse(f"{self.row}.{CORNERS[0]}" if self.row in KINDS else self.row)

    @property
    def dimension(self) -> Dimension:
        """Dimension of the row: of a force, or of a moment."""
        return FORCE * LENGTH if self.first_row.unit == "N·m" else FORCE

    def corners(self, where: str) -> tuple[str, ...]:
        """The corners it acts at in the variant `where`; one empty name in a chassis row."""
        if self.row not in KINDS:
            return ("",)
        place = self.place or where
        return CORNERS if place == "all" else AXLES.get(place, (place,))


@dataclass(frozen=True)
class Line:
    """A parsed one-line effect: name, laws by row, parameters, bounds and shape constants.

    Attributes
    ----------
    name : name of the effect, or empty; `text` : the line without its comment, `about` : the comment.
    rows : the law in each row.
    parameters : name → dimension, in the order written.
    bounds : plausible (low, high) [SI] of the parameters for which the line gives them.
    grids : constant → values tried [SI]; `constants` their dimensions.
    """

    name: str
    text: str
    about: str
    rows: tuple[RowLaw, ...]
    parameters: Mapping[str, Dimension]
    bounds: Mapping[str, tuple[float, float]]
    grids: Mapping[str, tuple[float, ...]]
    constants: Mapping[str, Dimension]

    @property
    def places(self) -> tuple[str, ...]:
        """Places of the variants: axles and corners, axles alone for a law between two wheels, or the whole car."""
        free = [law for law in self.rows if law.row in KINDS and not law.place]
        if free:
            across = any(use.wheel == "other" for law in free for use in law.uses.values())
            return tuple(AXLES) if across else (*AXLES, *CORNERS)
        fixed = {law.place for law in self.rows if law.place}
        return (fixed.pop(),) if len(fixed) == 1 else ("",)

    def unit(self, parameter: str) -> str:
        """SI unit of a parameter; kilograms where it multiplies an acceleration."""
        uses = [law.uses[n].state for law in self.rows if parameter in law.terms
                for n in law.terms[parameter].symbols if n in law.uses]  # fmt: skip
        inertial = any(state.dimension in (LENGTH / TIME**2, TIME**-2) for state in uses)
        dimension = self.parameters[parameter]
        return dimension.inertial_unit if inertial else dimension.unit

    @property
    def has_memory(self) -> bool:
        """Whether a law depends on the run until now and not on its instant alone."""
        return any(has_memory(term) for law in self.rows for term in law.terms.values())

    @property
    def states(self) -> dict[str, Use]:
        """Every state in its laws, by name."""
        return {name: use for law in self.rows for name, use in law.uses.items()}


def read_line(text: str) -> Line:
    """The effect that a line defines. Raises LineFault with the place and the remedy."""
    return _Reader(text).line()


def read_lines(text: str, source: str) -> list[Line]:
    """The effects that the lines of a file define; empty lines and comments are skipped.

    Raises UsageError with file and line number where one cannot be parsed, has no name or has another's.
    """
    out: list[Line] = []
    for number, written in enumerate(text.splitlines(), 1):
        if not written.split("#")[0].strip():
            continue
        try:
            line = read_line(written)
            if not line.name:
                raise LineFault(written, f"this effect has no name: {_WORDS}")
        except LineFault as fault:
            raise UsageError(f"{source}, line {number}: {fault}") from None
        if line.name in (other.name for other in out):
            raise UsageError(f"{source}, line {number}: there is another effect '{line.name}' above")
        out.append(line)
    return out


class _Reader:
    def __init__(self, text: str):
        self.text = text.rstrip().replace("\t", " ")
        if len(self.text) > LONGEST:
            raise UsageError(f"the line has {len(self.text)} characters, at most {LONGEST} are read")
        if "\n" in self.text or "\r" in self.text:
            raise UsageError("one line, please: several effects are several lines")
        body, _, comment = self.text.partition("#")
        self.end, self.about = len(body.rstrip()), comment.strip()

    def line(self) -> Line:
        clauses = list(self._split(0, self.end, ","))
        rows = list(self._split(*clauses[0], ";"))
        name, start = self._name(*rows[0])
        rows[0] = (start, rows[0][1])
        grids: dict[str, tuple[float, ...]] = {}
        constants: dict[str, Dimension] = {}
        bounds: dict[str, tuple[float, float, Dimension, int, int]] = {}
        for place in clauses[1:]:
            self._clause(*place, grids, constants, bounds)
        dimensions: dict[str, Dimension] = {}
        laws = tuple(self._row(*place, constants, dimensions) for place in rows)
        self._all_used(constants, laws, clauses[-1])
        for parameter, (_, _, dimension, start, stop) in bounds.items():
            if parameter not in dimensions:
                known = ", ".join(dimensions)
                raise LineFault(self.text, f"{parameter} is no parameter of this law (it has {known})", start, stop)
            if dimension != dimensions[parameter]:
                unit = dimensions[parameter].unit
                says = f"{parameter} is in {unit} by its law, and its bounds are in {dimension.unit}"
                raise LineFault(self.text, says, start, stop)
        if math.prod(len(values) for values in grids.values()) > MOST_SHAPES:
            raise LineFault(self.text, f"at most {MOST_SHAPES} combinations of constants are tried", *clauses[-1])
        held = {parameter: (low, high) for parameter, (low, high, *_) in bounds.items()}
        return Line(name, self.text[: self.end].strip(), self.about, laws, dimensions, held, grids, constants)

    def _split(self, start: int, stop: int, separator: str) -> Iterator[tuple[int, int]]:
        """Places of the parts between separators outside brackets."""
        depth = 0
        for at in range(start, stop):
            character = self.text[at]
            depth += (character == "(") - (character == ")")
            if character == separator and depth <= 0:
                yield start, at
                start = at + 1
        yield start, stop

    def _stripped(self, start: int, stop: int) -> tuple[int, int]:
        part = self.text[start:stop]
        first = start + len(part) - len(part.lstrip())
        return first, max(first, start + len(part.rstrip()))

    def _name(self, start: int, stop: int) -> tuple[str, int]:
        head = self.text[start:stop].split(":")[0]
        if "=" not in head:
            return "", start
        at = start + head.index("=")
        place = self._stripped(start, at)
        name = self.text[slice(*place)]
        if not re.fullmatch(r"[a-z][a-z0-9_]{0,39}", name):
            raise LineFault(self.text, "a name is made of small letters, digits and _, a letter first", *place)
        if name in (*KINDS, "chassis", *PLACES):
            raise LineFault(self.text, f"'{name}' says where an effect acts: give the effect another name", *place)
        return name, at + 1

    # -- clauses after the law ----------------------------------------------------------------------------------------

    def _clause(
        self, start: int, stop: int, grids: dict[str, tuple[float, ...]], constants: dict[str, Dimension],
        bounds: dict[str, tuple[float, float, Dimension, int, int]],
    ) -> None:  # fmt: skip
        start, stop = self._stripped(start, stop)
        part = self.text[start:stop]
        found = re.match(r"([A-Za-z_]\w*)\s*(=|\bin\b)", part)
        if found is None:
            says = "after the law stand constants, 'v0 = 0.01 0.02 m/s' (values separated by spaces), and bounds, "
            raise LineFault(self.text, says + "'p in -500..500 N'; rows come first, separated by ';'", start, stop)
        name = found[1]
        if name in grids or name in bounds or name in CONSTANTS or name in FUNCTIONS or use_of(name):
            what = "is given twice" if name in grids or name in bounds else "has a meaning already"
            raise LineFault(self.text, f"{name} {what}", start, start + len(name))
        rest = part[found.end() :]
        if found[2] == "in":
            pair = _BOUNDS.match(rest)
            if pair is None:
                raise LineFault(self.text, f"write {name} in LOW..HIGH UNIT, as in {name} in 0..500 N", start, stop)
            factor, dimension = self._unit(start + found.end() + pair.end(), stop)
            low, high = float(pair[1]) * factor, float(pair[2]) * factor
            if not low < high:
                raise LineFault(self.text, "the lower bound must be below the upper", start, stop)
            self._finite(low, high, start=start, stop=stop)
            bounds[name] = (low, high, dimension, start, stop)
            return
        values: list[float] = []
        at = 0
        while (number := _LIST.match(rest, at)) is not None:
            values.append(float(number[1]))
            at = number.end()
        if not values:
            says = f"write {name} = VALUES UNIT, values separated by spaces, as in {name} = 0.01 0.02 m/s"
            raise LineFault(self.text, says, start, stop)
        factor, constants[name] = self._unit(start + found.end() + at, stop)
        grids[name] = tuple(value * factor for value in values)
        self._finite(*grids[name], start=start, stop=stop)

    def _finite(self, *values: float, start: int, stop: int) -> None:
        if not all(math.isfinite(value) for value in values):
            raise LineFault(self.text, "these numbers are too large", start, stop)

    def _unit(self, start: int, stop: int) -> tuple[float, Dimension]:
        try:
            return whole_unit(self.text[start:stop])
        except ValueError as wrong:
            says = f"'{wrong}' is no unit that is known here; m mm s ms N kN kg rad deg Hz and the like, as in N·s/m"
            raise LineFault(self.text, says, *self._stripped(start, stop)) from None

    # -- the law in one row -------------------------------------------------------------------------------------------

    def _row(self, start: int, stop: int, constants: Mapping[str, Dimension], out: dict[str, Dimension]) -> RowLaw:
        row, place, begin = self._where(start, stop)
        begin, stop = self._stripped(begin, stop)
        try:
            expression, units = read_expression(self.text[begin:stop], FUNCTIONS)
            uses = self._uses(expression, row, constants)
            check_memory(expression, uses.keys())
            parameters = expression.symbols - uses.keys() - constants.keys()
            if not parameters:
                says = "there is no parameter in this law: multiply by one, as in p * travel**2 (any name that is free)"
                raise expression.fault(expression.tree, says)
            terms = terms_of(expression, parameters)
            known = {**{name: use.state.dimension for name, use in uses.items()}, **constants}
            law = RowLaw(row, place, self.text[begin:stop], terms, uses)
            for name, term in terms.items():
                dimension = law.dimension / Dimensions(term, known, units, constants.keys()).of()
                if out.setdefault(name, dimension) != dimension:
                    says = f"{name} is in {out[name].unit} by the row before, and would be in {dimension.unit} here"
                    raise expression.fault(expression.tree, f"{says}: multiply by a length or use another parameter")
        except ExpressionFault as fault:
            raise LineFault(self.text, fault.says, begin + fault.start, begin + fault.stop) from None
        return law

    def _where(self, start: int, stop: int) -> tuple[str, str, int]:
        found = re.match(r"\s*([\w.]+)\s*:", self.text[start:stop])
        if found is None:
            raise LineFault(self.text, f"where does it act? {_WORDS}", *self._stripped(start, stop))
        where = found[1]
        if where in CHASSIS_ROWS:
            return where, "", start + found.end()
        kind, _, place = where.partition(".")
        if kind in KINDS and (place in PLACES or where == kind):
            return kind, place, start + found.end()
        known = [*CHASSIS_ROWS, *KINDS, *(f"{k}.{p}" for k in KINDS for p in PLACES)]
        says = (
            f"there is no row '{where}'{nearest(where, known)} (suspension, tyre or spin, with .front .rear .all or a "
        )
        says += "corner such as .fl where wanted; chassis.fx … chassis.mz)"
        raise LineFault(self.text, says, start + found.start(1), start + found.end(1))

    def _uses(self, expression: Expression, row: str, constants: Iterable[str]) -> dict[str, Use]:
        uses: dict[str, Use] = {}
        names = [node for node in ast.walk(expression.tree) if isinstance(node, ast.Name)]
        for node in sorted(names, key=lambda node: node.col_offset):
            if node.id in (*CONSTANTS, *FUNCTIONS, *constants):
                continue
            use = use_of(node.id)
            if use is None:
                self._no_misspelt_state(expression, node)
            elif row not in KINDS and use.wheel in ("own", "other"):
                stem = use.state.name
                says = f"{node.id} belongs to a wheel, and a chassis row has none: write {stem}_fl, {stem}_fr, …"
                raise expression.fault(node, says)
            else:
                uses[node.id] = use
        return uses

    def _no_misspelt_state(self, expression: Expression, node: ast.Name) -> None:
        """Check that a parameter's name is not nearly that of a state, and so a misspelt state."""
        name = node.id
        stem = next((s for s in STATES if len(s) > 3 and name.startswith(f"{s}_")), "")
        if stem and STATES[stem].wheel:
            after = ", ".join(f"_{suffix}" for suffix in SUFFIXES)
            raise expression.fault(node, f"there is no state '{name}': after {stem} may stand {after}")
        close = _nearest_state(name)
        if close:
            says = f"there is no state '{name}'; did you mean '{close}'? (For a parameter, take a name less like it.)"
            raise expression.fault(node, says)

    def _all_used(self, constants: Mapping[str, Any], laws: Iterable[RowLaw], place: tuple[int, int]) -> None:
        used = {name for law in laws for term in law.terms.values() for name in term.symbols}
        for name in constants:
            if name not in used:
                raise LineFault(self.text, f"the constant {name} is not in the law", *self._stripped(*place))


def _nearest_state(name: str) -> str:
    if name.lower() in STATES:
        return name.lower()
    close = difflib.get_close_matches(name.lower(), all_names(), n=1, cutoff=_ALIKE) if len(name) > 3 else []
    return close[0] if close else ""
