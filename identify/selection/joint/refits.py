"""Effects found to be missing, in a model that is fitted with them, and removed from it where they do not stand.

What a selection leaves is judged by a new fit with the selected effects in its model, and a noise floor of it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.candidate import Candidate
from lacet.identify.selection.columns.candidate_columns import solved
from lacet.identify.selection.columns.drawn_noise import DrawnNoise
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.joint.subset_search import inexactness_of
from lacet.identify.selection.rest import (
    AddedLaw,
    Rest,
    added_faults,
    added_laws,
    laws_on_rows,
)
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION


@dataclass(frozen=True)
class Joint:
    """The effects found in all, and the model with all of them.

    Attributes
    ----------
    first : score tests of all candidates beside the model as it was, and `alone` their results.
    space : score tests of all others beside the model with the effects found, fitted again, and `beside` their results.
    effects : the effects found, with their shape constants.
    laws : all laws beyond the base model in that fit.
    removed : those of the effects found that are no part of the fit: latencies at which the runs were read again.
    base : the fit to which the effects are added, and `added` those that are; None where runs cannot be fitted here.
    sizes : sensor faults of the base fit that were removed from its runs, with their sizes.
    dropped : keys of effects that were selected and did not stand in a fit.
    parts : keys of those that stood, and explain no more than remains unlisted in their rows.
    refused : sets of effects, by keys, that did not stand where they were fitted in place of those found, or that these
        took the place of: a search does not return to them.
    shown : keys of sensor faults that the instruments show by themselves, without any force on the car.
    assumed : keys of laws that stood, and that errors of assumed channels may stand for.
    """

    first: ScoreTests
    alone: tuple[Candidate, ...]
    space: ScoreTests
    beside: tuple[Candidate, ...]
    effects: tuple[Effect, ...]
    laws: tuple[AddedLaw, ...]
    removed: tuple[Effect, ...] = ()
    base: Fit | None = None
    added: tuple[Effect, ...] = ()
    sizes: Mapping[str, float] = field(default_factory=dict[str, float])
    dropped: frozenset[str] = frozenset()
    parts: frozenset[str] = frozenset()
    refused: frozenset[frozenset[str]] = frozenset()
    shown: frozenset[str] = frozenset()
    assumed: frozenset[str] = frozenset()

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys of the effects found."""
        return tuple(effect.key for effect in self.effects)

    def replaced_by(self, better: Joint) -> Joint:
        """Effects in place of these, to which a search does not return, or the same ones with other constants."""
        return replace(better, refused=self.refused | ({frozenset(self.keys)} - {frozenset(better.keys)}))

    @property
    def faults(self) -> tuple[AddedLaw, ...]:
        """Sensor faults found, in the form of laws, with what was removed from the runs before."""
        return added_faults(self.space, self.sizes)

    @property
    def drawn(self) -> tuple[DrawnNoise, ...]:
        """Noise in the columns drawn so far, the one of the present runs first."""
        return self.space.drawn, self.first.drawn

    @property
    def fit(self) -> Fit:
        """A new fit with all of them; only where runs can be fitted here."""
        assert self.base is not None
        return self.base.with_effects(self.added) if self.added else self.base

    def based_on(self, space: ScoreTests) -> Joint:
        """The same effects in the model of another fit, which further ones are added to."""
        old, base = self.space.fitted, space.linearisation.runs.refittable
        sizes = dict(self.sizes)
        for fault in old.model.faults:
            at = old.model.names.index(fault.parameters[0].name)
            sizes[fault.key] = sizes.get(fault.key, 0.0) + float(old.theta[at])
        return replace(self, base=base, added=(), sizes=sizes)


def fitted_together(joint: Joint, seed: int, progress: Progress) -> Joint:
    """The model fitted with all effects added, without those that do not stand in it; as it was where none is new."""
    base, wanted = joint.base, joint.added
    assert base is not None
    while True:
        progress(Step(Stage.FIT_WITH_EFFECTS, subject=", ".join(effect.key for effect in wanted)))
        fitted, kept = fitted_with(base, wanted, len(joint.first.effects), joint.first.draws)
        old = [effect for effect in kept if effect.key in joint.keys]
        if len(kept) == len(old):
            gone = {effect.key for effect in joint.added} - set(joint.keys)
            return replace(
                joint, added=tuple(e for e in joint.added if e.key in joint.keys), dropped=joint.dropped | gone
            )
        gone = {effect.key for effect in joint.added} - {effect.key for effect in kept}
        space = _tests_of(joint, fitted, gone, seed, progress)
        laws = added_laws(space)
        worst = _weakest([law for law in laws if law.key in {e.key for e in kept} and not _stands(law, laws, space)])
        if worst is None:
            break
        wanted = tuple(effect for effect in kept if effect.key != worst.key)
    there = {effect.key for effect in joint.added}
    # What is in the base fit stays, what was added is what is kept.
    effects = (*(effect for effect in joint.effects if effect.key not in there), *kept)
    return beside_of(replace(joint, effects=effects, added=tuple(kept), dropped=joint.dropped | gone), space, progress)


def _tests_of(joint: Joint, fitted: Fit, gone: Collection[str], seed: int, progress: Progress) -> ScoreTests:
    """Score tests of all other effects but those `gone`, beside a new fit, with the noise floor of it."""
    there = {effect.key for effect in fitted.model.effects}
    others = [e for key, e in joint.first.effects.items() if key not in there | set(gone) | joint.dropped]
    return _tests_of_some(joint, fitted, others, seed, progress)


def _tests_of_some(
    joint: Joint, fitted: Fit, others: Sequence[Effect], seed: int, progress: Progress
) -> ScoreTests:  # fmt: skip
    """Score tests of the effects `others`, beside a new fit, with the noise floor of it."""
    linearisation = joint.space.linearisation
    there = {effect.key for effect in fitted.model.effects if not effect.base}
    progress(Step(Stage.FLOOR_BESIDE_EFFECT, subject=", ".join(key for key in joint.first.effects if key in there)))
    floor = linearisation.floor.redrawn(fitted)
    closer = replace(Linearisation.of(fitted, floor), latencies=linearisation.latencies)
    tried = {effect.key for effect in others}
    removed = [joint.first.effects[effect.key] for effect in joint.removed if effect.key not in tried]
    space = ScoreTests.of(closer, (*others, *removed), seed, None, progress, joint.drawn)
    return beside_removed(joint, space, progress)


def beside_removed(joint: Joint, space: ScoreTests, progress: Progress) -> ScoreTests:
    """The score tests beside the latencies that were removed from the runs, if there are any."""
    return space.given(joint.removed, progress) if joint.removed else space


def only_standing(joint: Joint, seed: int, progress: Progress = silent) -> Joint:
    """The same without the effects found that do not stand in the model of its runs, which were changed since.

    Before latencies were removed from the runs, an effect may have explained what these leave in second order.
    """
    while True:
        laws = joint.laws
        found = [law for law in laws if law.key in joint.keys]
        worst = _weakest([law for law in found if not _stands(law, laws, joint.space)])
        if worst is None:
            return joint
        joint = without_effects(joint, [worst.key], seed, progress)


def only_plausible(joint: Joint, seed: int, progress: Progress = silent) -> Joint:
    """The same without the effects found that no car, or sensor, has at the size they have in the fit with all of them.

    It looks like something else, with which its size would be another. A fault that instruments show by themselves has
    the size it has.
    """
    while True:
        found = [one for one in (*joint.laws, *joint.faults) if one.key in set(joint.keys) - joint.shown]
        wrong = _weakest([one for one in found if one.implausible is not None])
        if wrong is None:
            return joint
        joint = without_effects(joint, [wrong.key], seed, progress)


def not_part_of_the_rest(joint: Joint, rest: Rest, seed: int, progress: Progress = silent) -> tuple[Joint, Rest]:
    """The same without effects found that may be a part of the same unknown cause as the rest, and what then remains.

    What explains less than half of what is unlisted in its rows may be. So may a law that also acts in rows in which
    the model holds and does not stand in these alone: what an unknown force on the body does to the masses is a
    residual in all rows. And an effect of one run: nothing shows that it is the same again. A fault that instruments
    show by themselves, without any force, is none.
    """
    before = joint
    while rest.unlisted:
        found = [one for one in (*joint.laws, *joint.faults) if one.key in set(joint.keys) - joint.shown]
        elsewhere = _not_standing_elsewhere(joint, rest, before.space)
        worst = _weakest([one for one in found if one.force <= rest.beside(one) or one.key in elsewhere])
        if worst is None:
            break
        joint = less_a_part(joint, worst.key, seed, progress)
        rest = Rest.of(joint.space, joint.laws, rest.doubted)
    return (joint, rest) if joint is before else with_all_tested(joint, seed, progress, rest.doubted)


def less_a_part(joint: Joint, key: str, seed: int, progress: Progress) -> Joint:
    """The same less an effect that may be a part of an unlisted cause; `with_all_tested` tests the others beside it."""
    joint = _dropping(replace(joint, parts=joint.parts | {key}), [key], progress)
    return beside_of(joint, _tests_of_some(joint, joint.fit, (), seed, progress), progress)


def with_all_tested(
    joint: Joint, seed: int, progress: Progress, doubted: frozenset[Row] = frozenset()
) -> tuple[Joint, Rest]:  # fmt: skip
    """The same with all other candidates tested beside its effects, and the rest; `doubted` as of `Rest`."""
    joint = beside_of(joint, _tests_of(joint, joint.fit, (), seed, progress), progress)
    return joint, Rest.of(joint.space, joint.laws, doubted)


def _not_standing_elsewhere(joint: Joint, rest: Rest, tried: ScoreTests) -> set[str]:
    """Keys of the laws found that do not stand in the rows without an unlisted rest, and are not of those rows alone;
    and of effects of one run that act in rows with one. `tried` : tests of all that the laws were selected from."""
    sound = rest.without_unlisted()
    laws = laws_on_rows(joint.space, sound) if sound else ()
    out = {law.key for law in laws if not law.rows.isdisjoint(sound) and not is_significant(law, tried)}
    of_runs = {effect.key for effect in joint.effects if effect.is_of_run()}
    return out | {law.key for law in joint.laws if law.key in of_runs and not law.rows <= set(sound)}


def without_effects(joint: Joint, keys: Collection[str], seed: int, progress: Progress = silent) -> Joint:
    """The same without some of the effects found, which are not tried again."""
    joint = _dropping(joint, keys, progress)
    return beside_of(joint, _tests_of(joint, joint.fit, (), seed, progress), progress)


def _dropping(joint: Joint, keys: Collection[str], progress: Progress) -> Joint:
    """The same less some of the effects found, which are not tried again, still with the tests beside them."""
    without = less(joint, keys)
    progress(Step(Stage.FIT_WITH_EFFECTS, subject=", ".join(without.keys)))
    return replace(without, dropped=without.dropped | set(keys))


def with_further(joint: Joint, effects: Sequence[Effect], seed: int, progress: Progress = silent) -> Joint:
    """The same with further effects, fitted together, and the score tests of all others beside them."""
    added = (*joint.added, *effects)
    progress(Step(Stage.FIT_WITH_EFFECTS, subject=", ".join(effect.key for effect in added)))
    joint = replace(joint, added=added, effects=(*joint.effects, *effects))
    return beside_of(joint, _tests_of(joint, joint.fit, (), seed, progress), progress)


def less(joint: Joint, keys: Collection[str]) -> Joint:
    """The same less some of the effects found, still with the tests beside them."""
    assert joint.base is not None
    return replace(
        joint, base=joint.base.without_effects(keys, joint.sizes),
        added=tuple(effect for effect in joint.added if effect.key not in keys),
        effects=tuple(effect for effect in joint.effects if effect.key not in keys),
        sizes={key: size for key, size in joint.sizes.items() if key not in keys},
    )  # fmt: skip


def _weakest(laws: Sequence[AddedLaw]) -> AddedLaw | None:
    return min(laws, key=lambda law: law.force, default=None)


def is_significant(law: AddedLaw, space: ScoreTests) -> bool:
    """Whether a law of the model is there beside the others."""
    return space.family_wise_of(law.force, law.null) <= SELECTION.level(space.draws)


def _stands(law: AddedLaw, laws: Sequence[AddedLaw], space: ScoreTests) -> bool:
    """Whether a law of the model is there beside the others, and is not what these leave as they are not exact."""
    if not is_significant(law, space):
        return False
    return law.force > inexactness_of(law.family, law.rows, [other for other in laws if other.force > law.force])


def beside_of(joint: Joint, space: ScoreTests, progress: Progress = silent) -> Joint:
    """The same effects, with the candidates beside them tested in `space`."""
    progress(Step(Stage.SCORE_TESTS))
    beside = tuple(space.family_wise(space.try_all()))
    return replace(joint, space=space, beside=beside, laws=added_laws(space))


def fitted_with(before: Fit, effects: Sequence[Effect], count: int, draws: int) -> tuple[Fit, list[Effect]]:
    """Fit with further effects, without those whose size is not significant in it (Wald tests, Bonferroni).

    A sensor's fault must stand beside all that the sheet allows. An effect of the car need not: the sheet's tolerances
    are estimated with it in the tests that follow (`_stands`), which are much narrower than the sheet where the runs
    show these tolerances.

    `count` : number of candidates that they were selected from; `draws` : number of simulated runs behind that.
    """
    kept = list(effects)
    while kept:
        fitted = before.with_effects(kept)
        covariance, theta = fitted.covariance.copy(), fitted.theta.copy()
        faults = [fitted.model.names.index(q.name) for e in kept if e.as_physics is None for q in e.parameters]
        covariance[np.ix_(faults, faults)] += fitted.covariance_sheet[np.ix_(faults, faults)]
        places = {e.key: [fitted.model.names.index(q.name) for q in e.parameters] for e in kept}
        standing = list(kept)
        while standing:
            wald = {
                e.key: (float(theta[at] @ solved(covariance[np.ix_(at, at)], theta[at][:, None])[:, 0]), len(at))
                for e in standing
                for at in [places[e.key]]
            }
            p = {key: count * float(scipy.special.chdtrc(size, squares)) for key, (squares, size) in wald.items()}
            worst = max(standing, key=lambda e: p[e.key])
            if p[worst.key] <= SELECTION.level(draws):
                break
            standing.remove(worst)
            # Without it the others are those of the fit, given that it is zero.
            at = places[worst.key]
            gain = solved(covariance[np.ix_(at, at)], covariance[at]).T
            theta, covariance = theta - gain @ theta[at], covariance - gain @ covariance[at]
        if len(standing) == len(kept):
            return fitted, kept
        kept = standing
    return before, kept
