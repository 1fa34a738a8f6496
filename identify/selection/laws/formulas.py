"""Formulae for a cause that is not in the catalogue: one-line laws of the measured states that the residual follows.

They are tested exactly as candidates are: nuisance parameters removed, gains cross-validated, p from the same simulated
runs. Such a law describes the residual and does not explain it; the engineer writes the effect. A law that is one of
the catalogue on these runs has its name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np

from lacet.daq.channels import CORNERS
from lacet.identify.car.rows import SUSPENSION_ROWS, TYRE_ROWS, Row
from lacet.identify.effects.base import AXLES, Effect
from lacet.identify.effects.language.compiled import OneLine, effect_class
from lacet.identify.effects.language.parser import read_line
from lacet.identify.selection.columns.candidate_columns import CandidateColumns
from lacet.identify.selection.laws.grammar import AXLE_ONLY, Written, pool
from lacet.identify.selection.laws.held_out import squares_in_held_blocks
from lacet.identify.selection.laws.names import catalogue_names, key_of
from lacet.identify.selection.laws.search import Found, LawSearch, chosen, simplest, without_noise
from lacet.identify.selection.laws.settings import LAWS
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION


@dataclass(frozen=True)
class Law:
    """A law of the measured states, as text for `lacet effect`.

    Attributes
    ----------
    text : the law.
    terms, constants : number of its terms, and of the constants in which it is not linear.
    explained : part of the excess above the floor, in the rows it acts on, that it takes away in blocked
        cross-validation.
    listed : effects of the catalogue that a term of it is, on these runs.
    """

    text: str
    terms: int
    constants: int
    explained: float
    listed: tuple[str, ...] = ()


@dataclass(frozen=True)
class Formula:
    """Law of the measured states that part of the residual follows: the simplest as good as any.

    Attributes
    ----------
    text : the law as text for `lacet effect`.
    place : place of the variant that fits best.
    rows : rows it acts on.
    gain, gain_rms, p : as of a `Candidate`; p over all laws tried.
    law : it, with what it explains, and its names in the catalogue.
    front : laws of ever more terms and constants that explain ever more (Pareto front), it among them.
    """

    text: str
    place: str
    rows: tuple[Row, ...]
    gain: float
    gain_rms: float
    p: float
    law: Law
    front: tuple[Law, ...]

    @property
    def of_one_term(self) -> Law:
        """The law of the front that explains most with the fewest terms."""
        fewest = min(law.terms for law in self.front)
        return max((law for law in self.front if law.terms == fewest), key=lambda law: law.explained)


def propose(space: ScoreTests, failing: Sequence[Row]) -> list[Formula]:
    """Laws that the residual of the `failing` rows follows, largest gain first, one for each set of rows.

    `space` : score tests of the candidates of the catalogue.
    """
    fronts: list[tuple[Found, list[Found]]] = []
    search, rows = LawSearch(without_noise(space)), list(failing)
    for _ in range(SELECTION.most_laws):
        places = [place for place in _places(rows) if not _overlaps(place, [best for best, _ in fronts])]
        first = search.extended([()], [law for kind, where in places for law in laws_at(space, kind, where)])
        if not first:
            break
        found = _at_best_place(search, first)
        if not found:
            break
        front = simplest(found)
        fronts.append((chosen(front), front))
        search = replace(search, elsewhere=(*search.elsewhere, *fronts[-1][0].terms))
        # What else fails only as this law was missing needs none of its own.
        rows = [row for row in search.space.residual_beside(search.elsewhere).above if row in rows]
    return _tested(space, fronts)


def described_by(law: Law, space: ScoreTests) -> Effect:
    """The effect of a law, as one that describes a force and is not exact."""
    one = _named(law.text, space)
    return type(f"Described{type(one).__name__}", (type(one),), {"describes": True})(one.where, one.shape)


def laws_at(space: ScoreTests, kind: str, where: str) -> list[OneLine]:
    """All laws of the grammar at a place, at each combination of their constants' coarse grids."""
    plain = [one(where) for one in pool(kind) if where not in CORNERS or AXLE_ONLY not in one.line.text]
    absent = space.linearisation.runs.unmeasured(plain)
    return [shaped for one in plain if one.key not in absent for shaped in one.shapes()]


def _places(rows: Sequence[Row]) -> list[tuple[str, str]]:
    """Kind and place of the laws that may act in some rows: axles for rows of wheels, suspensions for the body's."""
    axles = {corner: axle for axle, corners in AXLES.items() for corner in corners}
    out: list[tuple[str, str]] = []
    for row in rows:
        if row.kind == "corner":
            out += [(kind, axles[row.place]) for kind in (SUSPENSION_ROWS[0].kind, TYRE_ROWS[0].kind)]
        elif row.kind == "body":
            out += [(SUSPENSION_ROWS[0].kind, axle) for axle in AXLES]
        else:
            out.append((str(row), "") if row.kind == "chassis" else (row.kind, axles[row.place]))
    return list(dict.fromkeys(out))


def _place(law: OneLine) -> tuple[str, str]:
    return law.line.rows[0].row, law.where


def _overlaps(place: tuple[str, str], found: Sequence[Found]) -> bool:
    """Whether a law was found at a place, or at one of its wheels."""
    taken = [_place(one.terms[0]) for one in found]
    return any(place[0] == kind and where in (place[1], *AXLES.get(place[1], ())) for kind, where in taken)


def _at_best_place(search: LawSearch, first: Sequence[Found]) -> list[Found]:
    """Laws of one and more terms at the place of the best law of one: an axle, one of its wheels, or the whole car."""
    best = max(first, key=lambda one: one.fall)
    kind, where = _place(best.terms[0])
    here = [one for one in first if _place(one.terms[0]) == (kind, where)]
    corners: list[Found] = []
    if where in AXLES:
        most = sorted(here, key=lambda one: -one.fall)[: LAWS.at_corners]
        laws = [one.terms[0] for one in most if AXLE_ONLY not in one.terms[0].line.text]
        corners = search.extended([()], [type(law)(c, law.shape) for c in AXLES[where] for law in laws])
    alone = max(corners, key=lambda one: one.fall, default=None)
    if alone is not None and alone.fall > best.fall:
        where = alone.terms[0].where
        here = search.extended([()], laws_at(search.space, kind, where))
    return search.laws(laws_at(search.space, kind, where), here)


def _tested(space: ScoreTests, fronts: Sequence[tuple[Found, Sequence[Found]]]) -> list[Formula]:
    """Formulae of the laws found at each place, tested as candidates are; largest gain first."""
    written = [[Written.of(one.terms) for one in front] for _, front in fronts]
    names = catalogue_names(space, [term for _, front in fronts for one in front for term in one.terms])
    # Columns on a run are stored by key: another law needs another name.
    effects = {text.text: _named(text.text, space) for texts in written for text in texts}
    if not effects:
        return []
    selected = [trial.effect for trial in space.columns.selected]
    stiffening = space.sums.weighting.prior_stiffening
    columns = CandidateColumns.of(
        space.linearisation, [*effects.values(), *selected], space.columns.seed, stiffening, selected=selected
    )
    scores = ScoreTests(columns, noise_ratio=space.noise_ratio)
    tests = {c.key: c for c in scores.try_all() if c.tested}
    explained = _explained(scores)
    out: list[Formula] = []
    for (best, front), texts in zip(fronts, written, strict=True):
        found = {id(one): c for one, text in zip(front, texts, strict=True) if (c := tests.get(effects[text.text].key))}
        # What makes the error larger where it was not fitted to describes nothing.
        parts = {id(one): explained[effects[text.text].key] for one, text in zip(front, texts, strict=True)}
        laws = {id(one): _law(text, one, parts[id(one)], names) for one, text in zip(front, texts, strict=True)
                if id(one) in found and parts[id(one)] >= SELECTION.least_gain}  # fmt: skip
        if not laws:
            continue
        one = id(best) if id(best) in laws else list(laws)[-1]
        c, law = found[one], laws[one]
        if c.gain >= SELECTION.least_gain:
            out.append(
                Formula(
                    law.text, effects[law.text].where, c.rows, c.gain, c.gain_rms, best.p, law, tuple(laws.values())
                )
            )
    return sorted(out, key=lambda formula: -formula.gain_rms)


def _named(law: str, space: ScoreTests) -> OneLine:
    """The effect of a law's text, under a name of its own."""
    runs = space.linearisation.runs
    (one,) = effect_class(read_line(f"law_{crc32(law.encode()):08x} = {law}")).variants(
        runs.vehicle, runs.wheel_reference
    )
    return one


def _law(text: Written, one: Found, explained: float, names: Mapping[str, tuple[str, ...]]) -> Law:
    listed = dict.fromkeys(name for term in one.terms for name in names[key_of(term)])
    return Law(text.text, text.terms, text.constants, explained, tuple(listed))


def _explained(scores: ScoreTests) -> dict[str, float]:
    """Key → part of the excess above the floor of the rows an effect acts on that it takes away in held-out blocks."""
    trials = [trial for trial in scores.layout.trials if trial.effect.key not in scores.selected]
    squares, now = squares_in_held_blocks(scores.regression, trials), scores.residual_beside([])
    floor = {row: float(np.sum(now.remainder.sums.over_runs.rows[row].squares_of(now.remainder.measured))) - above
             for row, above in now.squares.items()}  # fmt: skip
    out: dict[str, float] = {}
    for i, trial in enumerate(trials, start=1):
        rows = [row for row, acting in scores.sums.over_runs.acting.items() if np.any(acting[trial.place])]
        excess = sum(float(squares[row][0]) - floor[row] for row in rows)
        taken = sum(float(squares[row][0] - squares[row][i]) for row in rows)
        out[trial.effect.key] = min(1.0, taken / excess) if excess > 0.0 else 0.0
    return out
