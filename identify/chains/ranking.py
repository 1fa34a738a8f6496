"""Which law of a joint a fitted chain lacks: every law tried, tested against chance, the strongest added first.

A candidate's columns are reduced by the model's (Frisch, Waugh, Lovell). Its score S is the fall of the weighted
squares. Chance is a wild bootstrap of the scores by blocks (Kline and Santos 2012): each block's part of the score
keeps its size and gets a random sign, after the candidate is fitted to the residual. S ÷ its mean over these
draws is compared with the largest of all candidates' (max-score statistic, Westfall and Young 1993).

First moments that gravity acts on only where the base leans are unknown beside an inclination: their columns are those
of any torque that goes with the sine and cosine of an upright joint. They are fitted to the residual first, and an
inclination is judged by its own column beside theirs, which other joints show, too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from lacet.identify.chains.constants import Columns, half_of_constant, searched
from lacet.identify.chains.effects import ACROSS, EVERY, OF_BODIES, BaseInclination, JointEffect, JointOffset
from lacet.identify.chains.fit import ChainFit
from lacet.identify.chains.model import ChainModel
from lacet.identify.chains.rest import FoundLaw, rest_of
from lacet.identify.chains.samples import JointSamples
from lacet.identify.chains.scores import JointScore
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.uncertainty import SUB_BLOCK
from lacet.identify.selection.settings import SELECTION

_DRAWS = 999
"""Draws of the wild bootstrap."""
_FEW = 8
"""Fewest blocks of a record for which chance can be drawn: 2⁸ signs."""
_MOST = 0.5
"""Gain beyond which a law explains more of a joint's residual than all else together [share]: what inexact laws leave
has another law's shape by accident only."""
_INDEPENDENT = 1e-6
"""Part of a candidate's columns beside the model's below which it is the model's already [share]: numerical."""


class JointAnswer(Enum):
    """Answer to one candidate; the values are what reports print."""

    MISSING = "missing"
    STANDS_IN = "stands in"
    UNDECIDED = "undecided"
    """Significant, and it explains no more than what remains unlisted at its joints: it may be part of that cause."""
    SMALL = "smaller than laws are exact"
    IMPLAUSIBLE = "implausible size"
    NOT_NEEDED = "not needed"
    NOT_TESTABLE = "not testable"


_EXPLAINS = JointAnswer.MISSING, JointAnswer.SMALL
"""Answers of laws that explain something, for which a constant between the values of its grid is worth the time."""


@dataclass(frozen=True)
class JointCandidate:
    """A law that was tried.

    Attributes
    ----------
    effect : the law, with its constant where the score is largest.
    gain : fall of the weighted squares in blocked cross-validation, of those of the joint where it is largest [%].
    p : family-wise probability that chance gives as much.
    values : sizes, when the law is added alone [SI].
    answer : what follows.
    half : half of the 95 % interval of its constant [SI]; not a number where it has none, or one of its grid.
    """

    effect: JointEffect
    gain: float
    p: float
    values: tuple[float, ...]
    answer: JointAnswer
    half: float = float("nan")


@dataclass(frozen=True)
class ChainRanking:
    """Laws tried on a fitted chain: those missing in the order found, then the others by what they explain alone.

    Attributes
    ----------
    candidates : the laws.
    blocks : number of blocks of the record that chance was drawn over.
    unlisted : joint → error ÷ noise floor with the laws found missing in the model, where more remains than noise,
        inexact laws and the user's effect size.
    """

    candidates: tuple[JointCandidate, ...]
    blocks: int
    unlisted: Mapping[str, float] = field(default_factory=dict[str, float])

    @property
    def untested(self) -> bool:
        """Whether the record is too short for any law to be tested."""
        return self.blocks < _FEW

    @property
    def missing(self) -> tuple[JointEffect, ...]:
        """The laws found missing."""
        return tuple(one.effect for one in self.candidates if one.answer is JointAnswer.MISSING)


def candidates_of(model: ChainModel) -> tuple[JointEffect, ...]:
    """Laws that a model lacks: each at every free joint, of motors that turn with two neighbouring joints, and a base
    that leans about the two axes of the ground frame that are nearest to horizontal.
    """
    chain = model.chain
    have = {effect.key for effect in model.effects}
    pairs = [(j, chain.joints[j - 1].ant) for j in chain.coupling.free]
    ways = [{i: 1.0, j: sign} for j, i in pairs if i in chain.coupling.free for sign in (1.0, -1.0)]
    every = [law(j) for law in EVERY for j in chain.coupling.free]
    every += [law(way) for law in ACROSS for way in ways]
    vertical = int(np.argmax(np.abs(chain.gravity)))
    every += [BaseInclination(axis=axis) for axis in range(3) if axis != vertical and np.any(chain.gravity)]
    return tuple(effect for effect in every if effect.key not in have)


@dataclass(frozen=True)
class _Trial:
    """A candidate's weighted columns (r, k): `columns` reduced by those of the model, `whole` as they are."""

    effect: JointEffect
    columns: Array
    whole: Array

    def judged(self, residual: Array) -> tuple[Array, Array]:
        """(r, j) columns of the law's own parameters, and the residual (r,), less those of the unknowns beside it."""
        count = len(self.effect.letters)
        further = self.columns[:, count:]
        if not further.size:
            return self.columns, residual
        basis = _orthonormal(further)
        both = np.column_stack([self.columns[:, :count], residual])
        both = both - basis @ (basis.T @ both)
        return both[:, :count], both[:, count]


def rank_chain(
    fitted: ChainFit, samples: JointSamples, scores: Sequence[JointScore],
    candidates: Sequence[JointEffect] | None = None,
) -> ChainRanking:  # fmt: skip
    """Try laws on a fitted chain: `candidates`, by default every law that it lacks.

    `samples` : those it was fitted to; `scores` : its errors on them, joint by joint.
    """
    used = fitted.used
    scale = fitted.weights / fitted.sigma
    W = (fitted.W * scale[:, :, None])[used]
    joint = np.nonzero(used)[1]
    block = np.broadcast_to((fitted.t // SUB_BLOCK).astype(int)[:, None], used.shape)[used]
    _, block = np.unique(block, return_inverse=True)
    blocks = int(block.max()) + 1
    fold = block * SELECTION.folds // blocks
    residual = (fitted.residual * scale)[used]
    model = _orthonormal(W)
    inexact = SELECTION.law_inexactness**2 * _law_squares(fitted, scale)
    rows = _Rows(joint, block, fold, blocks, inexact, _noise_squares(scores, scale, used))
    effects = candidates_of(fitted.model) if candidates is None else tuple(candidates)
    trials = _trials(fitted, samples, effects, scale, model)
    tested = {trial.effect.key for trial in trials}
    instant = np.nonzero(used)[0]
    given = np.sqrt(np.count_nonzero(used, axis=0) / fitted.freedom)[joint]  # what the fit takes off the residual
    bases = [model]
    recorded = residual
    found: list[JointCandidate] = []
    laws: dict[str, FoundLaw] = {}
    alone: dict[str, JointCandidate] = {}
    while blocks >= _FEW and len(found) < SELECTION.most_selected:

        def whole(effect: JointEffect) -> Array:
            return _columns(fitted, samples, effect, scale)

        def beside(effect: JointEffect, bases: Sequence[Array] = tuple(bases)) -> Array | None:
            columns: Array | None = whole(effect)
            for basis in bases:
                columns = None if columns is None else _reduced(columns, basis)
            return columns

        tries = [
            _refined(one, whole, beside, residual, given, rows, instant)
            if one.effect.grid and one.answer in _EXPLAINS
            else one
            for one in _tested(trials, residual, rows)
        ]
        for one in tries:
            alone.setdefault(one.effect.key, one)
        passing = [one for one in tries if one.answer is JointAnswer.MISSING]
        if not passing:
            break
        best = max(passing, key=lambda one: one.gain)
        found.append(best)
        columns, own = beside(best.effect), beside(best.effect, [model])
        assert columns is not None
        assert own is not None
        laws[best.effect.key] = FoundLaw(own, whole(best.effect))
        basis = _orthonormal(columns)
        bases.append(basis)
        residual = residual - basis @ (basis.T @ residual)
        reduced = [(trial, _reduced(trial.columns, basis)) for trial in trials if trial.effect.key != best.effect.key]
        trials = [replace(trial, columns=columns) for trial, columns in reduced if columns is not None]
    small = SELECTION.effect_size**2 * _variation_squares(scores, scale, used)
    beside_laws = rest_of(laws, recorded, joint, rows.noise, rows.inexact, small)
    unlisted = {
        one.joint: float(ratio)
        for one, ratio, remains in zip(scores, beside_laws.ratios, beside_laws.unlisted, strict=True)
        if remains
    }
    named = [one for one in found if one.effect.key in beside_laws.standing]
    passed = {one.effect.key for one in found}
    rest: list[JointCandidate] = []
    for effect in effects:
        if effect.key in beside_laws.standing:
            continue
        one = alone.get(effect.key)
        if one is None or effect.key not in tested:
            rest.append(JointCandidate(effect, 0.0, float("nan"), (), JointAnswer.NOT_TESTABLE))
            continue
        answer = one.answer
        if effect.key in passed or (answer is JointAnswer.MISSING and not named):
            answer = JointAnswer.UNDECIDED
        elif answer is JointAnswer.MISSING:
            answer = JointAnswer.STANDS_IN
        rest.append(replace(one, answer=answer))
    rest.sort(key=lambda one: -one.gain)
    return ChainRanking((*named, *rest), blocks, unlisted)


def _trials(
    fitted: ChainFit, samples: JointSamples, effects: Sequence[JointEffect], scale: Array, model: Array
) -> list[_Trial]:
    """All candidates, at every value of their constants, reduced by the model's columns."""
    tried = [(effect.at(value) if effect.grid else effect) for effect in effects for value in effect.grid or (0.0,)]
    out: list[_Trial] = []
    for effect in tried:
        whole = _columns(fitted, samples, effect, scale)
        reduced = _reduced(whole, model)
        if reduced is not None:
            out.append(_Trial(effect, reduced, whole))
    return out


def _columns(fitted: ChainFit, samples: JointSamples, effect: JointEffect, scale: Array) -> Array:
    """(r, k) weighted columns of a law, of its parameters first: a model with it alone has the memory of a fit's."""
    chain = fitted.model.chain
    alone = ChainModel(chain, (*_known_offsets(fitted), effect))
    standard = np.zeros(len(alone.names))
    standard[: 10 * chain.n] = fitted.standard[: 10 * chain.n]
    for known in _known_offsets(fitted):
        standard[alone.place[known.key]] = fitted.standard[fitted.model.place[known.key]]
    columns = alone.law_equations(samples, standard, alone.place[effect.key])
    if isinstance(effect, BaseInclination):
        # First moments that gravity did not act on were not determined: they are unknowns beside the inclination.
        before = {*fitted.base.independent.tolist(), *range(10 * chain.n, len(alone.names))}
        further = [k for k in alone.base.independent.tolist() if k not in before]
        standard[alone.place[effect.key]] = 1.0
        columns = np.concatenate([columns, alone.equations(samples, standard)[0][:, :, further]], axis=2)
    return (columns * scale[:, :, None])[fitted.used]


def _known_offsets(fitted: ChainFit) -> tuple[JointEffect, ...]:
    return tuple(effect for effect in fitted.model.effects if isinstance(effect, OF_BODIES))


def _reduced(columns: Array, basis: Array) -> Array | None:
    """Columns less their projection on a basis; None where nothing remains."""
    rest = columns - basis @ (basis.T @ columns)
    rest -= basis @ (basis.T @ rest)
    whole = np.linalg.norm(columns, axis=0)
    if not np.all(whole > 0.0) or np.any(np.linalg.norm(rest, axis=0) < np.sqrt(_INDEPENDENT) * whole):
        return None
    return rest


def _orthonormal(columns: Array) -> Array:
    lengths = np.linalg.norm(columns, axis=0)
    kept = columns[:, lengths > 0.0] / lengths[lengths > 0.0]
    U, values = np.linalg.svd(kept, full_matrices=False)[:2]
    return U[:, values > 1e-10 * float(np.max(values, initial=0.0))]


@dataclass(frozen=True)
class _Rows:
    """The r equations that candidates are tested on.

    Attributes
    ----------
    joint, block, fold : (r,) joint of each, block of chance, fold of the cross-validation; `blocks` is their number.
    inexact : (f,) weighted squares of each joint that the laws in the model may leave, as no law is exact.
    noise : (f,) the same that its instruments' noise leaves; infinite where the joint's error is no more than that.
    """

    joint: NDArray[np.intp]
    block: NDArray[np.intp]
    fold: NDArray[np.intp]
    blocks: int
    inexact: Array
    noise: Array


def _law_squares(fitted: ChainFit, scale: Array) -> Array:
    """(f,) weighted squares of the torques of the laws in the model, joint by joint.

    Offsets are not among them: a constant has no shape that could be inexact.
    """
    laws = [effect for effect in fitted.model.effects if not isinstance(effect, (JointOffset, *OF_BODIES))]
    names = {name for effect in laws for name in effect.parameters}
    ours = [i for i, k in enumerate(fitted.base.independent) if fitted.base.names[int(k)] in names]
    torque = fitted.W[:, :, ours] @ fitted.x[ours]
    return np.sum(np.where(fitted.used, (torque * scale) ** 2, 0.0), axis=0)


def _noise_squares(scores: Sequence[JointScore], scale: Array, used: NDArray[np.bool_]) -> Array:
    """(f,) weighted squares of each joint that noise leaves; infinite where its error is no more than that."""
    floors = np.array([one.floor if one.fails else np.inf for one in scores])
    return np.sum(np.where(used, scale**2, 0.0), axis=0) * floors**2


def _variation_squares(scores: Sequence[JointScore], scale: Array, used: NDArray[np.bool_]) -> Array:
    """(f,) weighted squares of each joint's measured torque about its mean."""
    variations = np.nan_to_num(np.array([one.variation for one in scores]))
    return np.sum(np.where(used, scale**2, 0.0), axis=0) * variations**2


def _tested(trials: Sequence[_Trial], residual: Array, rows: _Rows) -> list[JointCandidate]:
    """Every candidate with its score, family-wise p and gain; of one with several constants the best."""
    rng = np.random.default_rng(17)
    signs = rng.choice([-1.0, 1.0], (_DRAWS, rows.blocks))
    best: dict[str, tuple[float, Array, _Trial, Array]] = {}
    for trial in trials:
        X, rest = trial.judged(residual)
        G = X.T @ X
        beta = np.asarray(np.linalg.solve(G, X.T @ rest), float)
        score = float(beta @ G @ beta)
        # The candidate is out of the residual: only chance remains in its parts.
        parts = np.zeros((rows.blocks, X.shape[1]))
        np.add.at(parts, rows.block, X * (rest - X @ beta)[:, None])
        drawn = signs @ parts * np.sqrt(rows.blocks / (rows.blocks - 1.0))
        null = np.sum(drawn * np.asarray(np.linalg.solve(G, drawn.T), float).T, axis=1)
        before = best.get(trial.effect.key)
        if before is not None:  # the search over its constants counts
            null = np.maximum(null, before[1])
        if before is None or score > before[0]:
            best[trial.effect.key] = score, null, trial, beta
        else:
            best[trial.effect.key] = before[0], null, before[2], before[3]
    if not best:
        return []
    means = {key: max(1e-300, float(np.mean(null))) for key, (_, null, _, _) in best.items()}
    most = np.max(np.stack([null / means[key] for key, (_, null, _, _) in best.items()]), axis=0)
    out: list[JointCandidate] = []
    for key, (score, _, trial, beta) in best.items():
        p = (1.0 + np.count_nonzero(most >= score / means[key])) / (1.0 + _DRAWS)
        out.append(_answered(trial, beta, p, residual, rows))
    return out


def _answered(trial: _Trial, beta: Array, p: float, residual: Array, rows: _Rows) -> JointCandidate:
    """The candidate with sizes `beta` and probability `p`, and what follows."""
    gain, enough = _gain(*trial.judged(residual), rows)
    answer = JointAnswer.NOT_NEEDED
    if p <= SELECTION.level(_DRAWS) and gain >= SELECTION.least_gain:
        large = enough or (gain > _MOST and _exceeds(trial.whole[:, : len(beta)] @ beta, rows))
        answer = JointAnswer.MISSING if large else JointAnswer.SMALL
        if (trial.effect.passive and np.any(beta < 0.0)) or np.any(np.abs(beta) > trial.effect.largest):
            answer = JointAnswer.IMPLAUSIBLE
    return JointCandidate(trial.effect, 100.0 * gain, p, tuple(float(x) for x in beta), answer)


def _refined(
    one: JointCandidate, whole: Callable[[JointEffect], Array], beside: Columns, residual: Array, given: Array,
    rows: _Rows, instant: NDArray[np.intp],
) -> JointCandidate:  # fmt: skip
    """A candidate with its constant searched between the values of its grid; p remains that of the grid.

    `given` : (r,) factor of the residual for the degrees of freedom that the fit has taken.
    """
    effect = searched(one.effect, beside, residual)
    X = beside(effect)
    if X is None or effect == one.effect:
        return one
    beta = np.asarray(np.linalg.solve(X.T @ X, X.T @ residual), float)
    half = half_of_constant(effect, beside, residual, given, instant)
    return replace(_answered(_Trial(effect, X, whole(effect)), beta, one.p, residual, rows), half=half)


def _exceeds(torque: Array, rows: _Rows) -> bool:
    """Whether a law's weighted torque (r,) varies by more, at any joint, than what the laws in the model may leave.

    Of the law itself, not of the residual: where other parameters take most of a missing law's place, and are wrong by
    that, little of it remains there.
    """
    count = np.maximum(1, np.bincount(rows.joint, minlength=rows.inexact.size))
    mean = np.bincount(rows.joint, torque, rows.inexact.size) / count
    squares = np.bincount(rows.joint, (torque - mean[rows.joint]) ** 2, rows.inexact.size)
    return bool(np.any(squares > rows.inexact))


def _gain(X: Array, residual: Array, rows: _Rows) -> tuple[float, bool]:
    """Largest fall, over the joints it acts on, of a joint's squares in blocked cross-validation [share].

    And whether, at any joint, it is more than what the laws in the model may leave, or leaves nothing but noise and
    what the law itself may be inexact by: a law that only resembles what another leaves, leaves more.
    """
    after = residual.copy()
    for number in range(int(rows.fold.max()) + 1):
        inside = rows.fold == number
        beta: Array = np.linalg.lstsq(X[~inside], residual[~inside], rcond=None)[0]
        after[inside] -= X[inside] @ beta
    before, remaining = np.bincount(rows.joint, residual**2), np.bincount(rows.joint, after**2)
    acts = np.bincount(rows.joint, np.sum(X**2, axis=1)) > _INDEPENDENT * np.sum(X**2)
    share = np.where(acts, 1.0 - remaining / np.maximum(before, 1e-300), 0.0)
    fall, failing = before - remaining, SELECTION.failing_ratio**2 * rows.noise
    allowed = np.maximum(failing, rows.noise + SELECTION.selected_inexactness**2 * fall)
    all_of_it = (before > failing) & (remaining <= allowed)
    return float(np.max(share)), bool(np.any(acts & ((fall > rows.inexact) | all_of_it)))
