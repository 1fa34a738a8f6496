"""Regrouping relations of base parameters as formulas: polynomials of the table's lengths and of sines of its angles.

The regrouping relations of Khalil and Dombre (2002, chapter 9) are polynomials of this kind. They are found here
without cases for kinds of joints: the relations are computed for several random tables of the same structure, and each
is fitted by few monomials of the right unit. The fit is accepted if it predicts further random tables and the chain's
own numbers; otherwise the relation stays a number.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Sequence
from fractions import Fraction
from functools import cache

import numpy as np

from lacet.daq.expressions.expression import Expression
from lacet.identify.multibody.base_parameters import BaseParameters, combine
from lacet.identify.multibody.scaled_chain import ScaledChain
from lacet.identify.multibody.symbolic_table import ANGLES, LENGTHS
from lacet.identify.multibody.vectors import Array

_MOST = 60
"""Largest number of monomials tried for one relation."""
_LONGEST = 120
"""Length of the longest formula [characters]; a longer one is no easier to read than the number."""
_REACH = (1, 2, 3, 99)
"""Numbers of table rows whose lengths are tried in a relation, in this order."""
_SPARE = 4
"""Number of tables in excess of the number of monomials, for validation."""
_SAME = 1e-8
_SQUARE = re.compile(r"^(.*\*)?cos\(([^()]*)\)\*\*2$")


def closed_forms(base: BaseParameters, scaled: ScaledChain) -> tuple[tuple[str, ...], ...]:
    """Formulas of `base.relations` as text; a number where there is no formula, empty where it is 0."""
    numbers = [[_number(float(x)) for x in row] for row in base.relations]
    if not base.relations.size:
        return tuple(tuple(row) for row in numbers)
    tables = _start(base, scaled)
    if tables is None:
        return tuple(tuple(row) for row in numbers)
    series = tables.series
    largest, spread = np.max(np.abs(series), axis=0), np.ptp(series, axis=0)
    out = [[""] * base.relations.shape[1] for _ in numbers]
    open_cells: list[tuple[int, int]] = []
    for i, k in np.argwhere(largest > _SAME):
        text = _recognised(float(series[0, i, k]), _angles(base, scaled, i, k)) if spread[i, k] <= _SAME else ""
        out[i][k] = text or numbers[i][k]
        if spread[i, k] > _SAME:
            open_cells.append((int(i), int(k)))
    for reach in _REACH:  # most relations hold the lengths next to the body grouped into
        trials = {cell: _monomials(base, scaled, *cell, reach) for cell in open_cells}
        most = max((len(m) for m in trials.values()), default=0)
        if not most or not tables.draw(most + _SPARE):
            break
        series = tables.series
        open_cells = []
        for (i, k), monomials in trials.items():
            text = _fitted(series[:, i, k], tables.columns(monomials), monomials, _angles(base, scaled, i, k))
            if text is None:
                open_cells.append((i, k))
            elif text and _holds(base, scaled, i, k, text):
                out[i][k] = text
    return tuple(tuple(row) for row in out)


class _Tables:
    """Random tables of a chain's structure, with the relations of their base parameters."""

    def __init__(self, base: BaseParameters, scaled: ScaledChain, shared: bool):
        self.base, self.scaled_chain, self.shared = base, scaled, shared
        self.rng = np.random.default_rng(5)
        self.values: list[dict[str, float]] = []
        self.found: list[Array] = []
        self._columns: dict[str, Array] = {}

    def columns(self, monomials: Sequence[str]) -> Array:
        """Values of monomials in each table, (tables, monomials)."""
        count = len(self.values)
        series = {name: np.array([v[name] for v in self.values]) for name in self.values[0]}
        for m in monomials:
            if self._columns.get(m, np.empty(0)).size != count:
                self._columns[m] = Expression.parse(m).series(series, count)
        return np.stack([self._columns[m] for m in monomials], axis=1) if monomials else np.empty((count, 0))

    @property
    def series(self) -> Array:
        """The relations in each table, (tables, b, d)."""
        return np.stack(self.found)

    def draw(self, count: int) -> bool:
        """Draw tables up to `count`; false when one has other base parameters."""
        while len(self.found) < count:
            numbers, values = self.scaled_chain.varied(self.rng, self.shared)
            W = self.scaled_chain.matrix(numbers)
            found, residual = combine(W, self.base.independent, self.base.dependent)
            if residual > 1e-7:
                return False
            self.values.append(values)
            self.found.append(found)
        return True


def _start(base: BaseParameters, scaled: ScaledChain) -> _Tables | None:
    """The first tables. Equal lengths are varied separately, unless the structure depends on their equality."""
    for shared in (False, True):
        tables = _Tables(base, scaled, shared)
        if tables.draw(3):
            return tables
    return None


def _holds(base: BaseParameters, scaled: ScaledChain, i: int, k: int, text: str) -> bool:
    """Whether a formula reproduces the chain's own relation."""
    number = float(base.relations[i, k])
    if math.isnan(number):
        return True
    value = Expression.parse(text).value({**scaled.chain.values, **scaled.actual_values})
    unit = scaled.size ** float(scaled.exponents[base.independent[i]] - scaled.exponents[base.dependent[k]])
    return abs(value - number) <= 1e-9 * max(unit, abs(value))


def join(terms: Sequence[tuple[str, str]]) -> str:
    """Sum of terms, coefficient × name, as one expression."""
    parts: list[str] = []
    for text, name in terms:
        sign, size = ("-", text[1:]) if text.startswith("-") and not _sum(text[1:]) else ("+", text)
        bracketed = f"({size})" if _sum(size) else size
        parts.append(f"{sign} {name if size == '1' else f'{bracketed}*{name}'}")
    joined = " ".join(parts)
    return joined[2:] if joined.startswith("+ ") else "-" + joined[2:]


def _sum(text: str) -> bool:
    """Whether an expression has a sum outside its brackets."""
    depth = 0
    for place, sign in enumerate(text):
        depth += (sign == "(") - (sign == ")")
        if depth == 0 and sign in "+-" and place and text[place - 1] not in "e*/(":
            return True
    return False


def _rows_between(base: BaseParameters, scaled: ScaledChain, i: int, k: int) -> list[int]:
    """Rows of the table between the body of a parameter and the one it is grouped into, the latter's side first."""
    table, columns, n = scaled.chain.table, scaled.columns, scaled.chain.n

    def body(place: int) -> int:
        column = int(columns[place])
        return (column // 10 if column < 10 * n else (column - 10 * n) // 3) + 1

    ours, theirs = table.path(body(int(base.independent[i]))), table.path(body(int(base.dependent[k])))
    return sorted(set(ours) ^ set(theirs)) or [theirs[0]]  # of one body: its own row


def _monomials(base: BaseParameters, scaled: ScaledChain, i: int, k: int, reach: int) -> list[str]:
    """Products of lengths of the first rows between, of the relation's unit, times sines and cosines of symbols."""
    table = scaled.chain.table
    lengths: list[str] = []
    angles: list[str] = []
    pure = True
    for j in _rows_between(base, scaled, i, k)[:reach]:
        row = table.rows[j - 1]
        for key in LENGTHS:
            entry = row.entries[key]
            if not entry.symbols and scaled.numbers[j - 1][key] != 0.0:
                lengths.append(f"{key}{j}")
            free = [s for s in sorted(entry.symbols) if s not in table.variables]
            lengths += [s for s in free if s not in table.angle_symbols]
            angles += [a.text for a in entry.angles]
            # A number added to a symbol (L1 + 0.1) is a length that the monomials' degree does not count.
            pure &= not free or _homogeneous(entry, table.angle_symbols)
        for key in ANGLES:
            entry = row.entries[key]
            if entry.symbols - table.variables:
                angles.append(entry.text if not entry.symbols & table.variables else "")
    lengths, angles = list(dict.fromkeys(lengths)), list(dict.fromkeys(a for a in angles if a))
    degree = int(scaled.exponents[base.independent[i]] - scaled.exponents[base.dependent[k]])
    degrees = [degree] if pure else list(range(0, max(degree, 0) + 1))
    turns = [f"{f}({a})" for a in angles for f in ("cos", "sin")]
    turning = [" ", *turns, *(_product(pair) for pair in itertools.combinations_with_replacement(turns, 2))]
    turning += [f"tan({a})" for a in angles]
    whole = [m for n in degrees for m in _of_degree(lengths, n)]
    out = [_product([m, t]) for m in whole for t in turning]
    if len(out) > _MOST:
        out = [_product([m, t]) for m in whole for t in [" ", *turns]]
    return list(dict.fromkeys(out)) if len(out) <= _MOST else []


def _homogeneous(entry: Expression, angle_symbols: frozenset[str]) -> bool:
    """Whether an entry is a length without constants added to its symbols."""
    values = dict.fromkeys(entry.symbols, 0.6)
    twice = {s: v if s in angle_symbols else 2.0 * v for s, v in values.items()}
    try:
        return abs(entry.value(twice) - 2.0 * entry.value(values)) < 1e-9
    except ValueError:
        return False


def _of_degree(lengths: Sequence[str], degree: int) -> list[str]:
    if degree == 0 and not lengths:
        return [" "]
    if degree >= 0:
        whole = [_product(c) for c in itertools.combinations_with_replacement(lengths, degree)]
        ratios = [f"{a}/{b}" for a, b in itertools.permutations(lengths, 2)] if degree == 0 and len(lengths) < 5 else []
        cubic = [f"{_product(c)}/{a}" for a in lengths for c in itertools.combinations_with_replacement(lengths, 2)
                 if a not in c] if degree == 1 and len(lengths) < 4 else []  # fmt: skip
        return [w or " " for w in (*whole, *ratios, *cubic)]
    return [f"1/{a}" if degree == -1 else f"1/{a}**{-degree}" for a in lengths]


def _product(factors: Sequence[str]) -> str:
    """Factors with powers, ``D3**2*cos(A)``; blanks are 1."""
    present = [f for f in factors if f.strip() not in ("", "1")]
    parts = [f"{f}**{n}" if (n := present.count(f)) > 1 else f for f in dict.fromkeys(present)]
    return "*".join(sorted(parts, key=lambda f: "(" in f)) or "1"


def _angles(base: BaseParameters, scaled: ScaledChain, i: int, k: int) -> list[float]:
    """Angles of the rows between that are given as numbers."""
    table = scaled.chain.table
    rows = _rows_between(base, scaled, i, k)
    found = (scaled.numbers[j - 1][key] for j in rows for key in ANGLES if not table.rows[j - 1].entries[key].symbols)
    return [a for a in dict.fromkeys(found) if abs(a) > 1e-12]


def _fitted(series: Array, A: Array, monomials: Sequence[str], angles: Sequence[float]) -> str | None:
    """A series of values as a sum of monomials; None where the fit fails, empty where no formula is recognised."""
    if not monomials:
        return None
    fit = len(monomials) + 1
    solution = _fewest(np.asarray(np.linalg.lstsq(A[:fit], series[:fit], rcond=None)[0], float), monomials)
    scale = float(np.max(np.abs(series)))
    kept = np.flatnonzero(np.abs(solution) > 1e-6 * np.max(np.abs(solution)))
    if not kept.size:
        return None
    solution = np.linalg.lstsq(A[:, kept], series, rcond=None)[0]  # fitted again without the negligible ones
    if np.max(np.abs(A[:, kept] @ solution - series)) > _SAME * max(scale, 1.0):
        return None
    recognised = [_recognised(float(c), angles) for c in solution]
    if not all(recognised):
        return ""
    values = np.array([Expression.parse(text).value({}) for text in recognised])
    if np.max(np.abs(A[:, kept] @ values - series)) > _SAME * max(scale, 1.0):
        return ""
    terms = [(text, monomials[int(m)]) for text, m in zip(recognised, kept, strict=True)]
    out = join([(text, m) if m != "1" else ("1", text) for text, m in terms]).replace("+ -", "- ")
    return out if len(out) <= _LONGEST else ""


def _fewest(coefficients: Array, monomials: Sequence[str]) -> Array:
    """Coefficients of the same sum with fewer terms, by m cos² + m sin² = m of each angle and monomial m.

    Least squares shares a coefficient between the three, which are dependent.
    """
    out, size = coefficients.copy(), float(np.max(np.abs(coefficients)))
    place = {m: i for i, m in enumerate(monomials)}
    identity = np.array([-1.0, 1.0, 1.0])
    for text in monomials:
        found = _SQUARE.match(text)
        if not found:
            continue
        whole, angle = found.group(1) or "", found.group(2)
        names = whole.rstrip("*") or "1", text, f"{whole}sin({angle})**2"
        if any(name not in place for name in names):
            continue
        three = [place[name] for name in names]
        now = out[three]
        others = [now, *(now - identity * (now[i] * identity[i]) for i in range(3))]
        out[three] = min(others, key=lambda c: int(np.count_nonzero(np.abs(c) > 1e-6 * size)))
    return out


def _recognised(c: float, angles: Sequence[float]) -> str:
    """A number as a fraction or a product of sines and cosines of the table's angles; empty when it is neither."""
    for below in (1, 2, 3, 4):
        if abs(c * below - round(c * below)) < 1e-8 and round(c * below):
            whole = round(c * below)
            return str(whole) if below == 1 else f"{whole}/{below}"
    values, texts = _turns(tuple(angles))
    for times in (1, -1, 2, -2):
        near = np.flatnonzero(np.abs(times * values - c) < 1e-8 * max(1.0, abs(c)))
        if near.size:
            text = texts[int(near[0])]
            return {1: text, -1: f"-{text}"}.get(times, f"{times}*{text}")
    return ""


@cache
def _turns(angles: tuple[float, ...]) -> tuple[Array, tuple[str, ...]]:
    """Products of sines and cosines, and tangents, of a few angles that are no quarter turns; simple ones first."""
    named = [(f(a), f"{f.__name__}({_angle(a)})") for a in angles for f in (math.cos, math.sin)]
    named = [(value, text) for value, text in named if 1e-9 < abs(value) < 1 - 1e-9]
    out: list[tuple[float, str]] = []
    for count in (1, 2, 3) if len(named) <= 8 else (1, 2):
        for chosen in itertools.combinations_with_replacement(named, count):
            product = math.prod(value for value, _ in chosen)
            out += [(product, _product([text for _, text in chosen]))]
        if count == 1:
            slopes = [(math.tan(a), f"tan({_angle(a)})") for a in angles if abs(math.cos(a)) > 1e-9]
            out += [one for t, text in slopes if t for one in ((t, text), (1.0 / t, f"1/{text}"))]
    return np.array([value for value, _ in out]), tuple(text for _, text in out)


def _angle(a: float) -> str:
    """An angle as a fraction of π where it is one."""
    part = Fraction(a / math.pi).limit_denominator(180)
    if abs(float(part) * math.pi - a) < 1e-12:
        whole, below = part.numerator, part.denominator
        times = {1: "pi", -1: "-pi"}.get(whole, f"{whole}*pi")
        return times if below == 1 else f"{times}/{below}"
    return repr(a)


def _number(c: float) -> str:
    return "" if c == 0.0 else repr(c) if not math.isnan(c) else "?"
