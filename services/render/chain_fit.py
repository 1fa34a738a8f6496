"""A fitted chain in words and tables: parameters with intervals, errors joint by joint, laws that are missing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lacet.identify.chains.cutoffs import FewEquations
from lacet.identify.chains.doubts import Doubts
from lacet.identify.chains.effects import StribeckFriction
from lacet.identify.chains.fit import ChainEstimate, ChainFit
from lacet.identify.chains.ranking import ChainRanking, JointAnswer, JointCandidate
from lacet.identify.chains.scores import JointScore
from lacet.identify.chains.verdicts import ChainVerdict, failing_joints, verdict_of
from lacet.identify.multibody.rigid_body import PARAMETERS, UNITS
from lacet.identify.selection.settings import SELECTION
from lacet.services.render.chain_gaps import gaps_text
from lacet.services.render.intervals import half_width, to_interval, with_interval

_UNITS = {
    "IA": ("kg·m²", "kg"), "FV": ("N·m·s/rad", "N·s/m"), "FVA": ("N·m·s/rad", "N·s/m"), "FS": ("N·m", "N"),
    "FSP": ("N·m", "N"), "FSN": ("N·m", "N"), "FB": ("N·m", "N"), "FL": ("", ""), "OFF": ("N·m", "N"),
    "K": ("N·m/rad", "N/m"), "QO": ("rad", "m"), "GM": ("", ""), "G": ("m/s²", "m/s²"),
}  # fmt: skip
PARAMETER_HEAD = ("parameter", "value", "± 95 %", "unit", "grouping")
SCORE_HEAD = ("joint", "error ÷ floor", "RMS", "explained %", "held out: error ÷ floor", "RMS")
RANKING_HEAD = ("law", "answer", "gain %", "p", "size alone")


def unit_of(fitted: ChainFit, name: str) -> str:
    """Unit of a parameter of a fitted chain."""
    for effect in fitted.model.effects:
        if name in effect.parameters:
            letters = effect.letters[effect.parameters.index(name)]
            joint = next(iter(effect.directions), None)
            return _UNITS[letters][joint is not None and fitted.model.chain.joints[joint - 1].sigma == 1]
    return UNITS[PARAMETERS.index(name.rstrip("0123456789"))]


def parameter_rows(fitted: ChainFit) -> list[list[str]]:
    """Base parameters: name, value, half of the 95 % interval, unit, and what they are grouped with."""
    return [
        [one.name, to_interval(one.value, one.half), half_width(one.half), unit_of(fitted, one.name),
         one.group if one.group != one.name else ""]
        for one in fitted.estimates
    ]  # fmt: skip


def score_rows(scores: Sequence[JointScore], held_out: Sequence[JointScore]) -> list[list[str]]:
    """Errors joint by joint, on what was fitted to and on what was not."""
    return [
        [
            one.joint,
            _known(one.ratio, ".2f"),
            _known(one.rms, ".3g"),
            _known(one.explained, ".2f"),
            _known(other.ratio, ".2f"),
            _known(other.rms, ".3g"),
        ]
        for one, other in zip(scores, held_out, strict=True)
    ]


def _known(number: float, how: str) -> str:
    """A number, or a dash where there is none: the other parts of a short record do not determine the parameters."""
    return f"{number:{how}}" if np.isfinite(number) else "–"


def ranking_rows(ranking: ChainRanking, verdict: str) -> list[list[str]]:
    """Laws tried, with their answers; that a law is missing is in doubt where the fit is unsound."""
    unsound = verdict == ChainVerdict.UNSOUND
    return [
        [law_text(one), "in doubt" if unsound and one.answer is JointAnswer.MISSING
         else one.answer.value, f"{one.gain:.1f}", f"{one.p:.3f}",
         ", ".join(f"{value:.3g}" for value in one.values)]
        for one in ranking.candidates
    ]  # fmt: skip


def law_text(one: JointCandidate) -> str:
    """A law's key, with its constant in brackets where it has one, ± half of the 95 % interval if it was searched."""
    if not isinstance(one.effect, StribeckFriction):
        return one.effect.key
    searched = np.isfinite(one.half)
    speed = (
        f"{to_interval(one.effect.speed, one.half)} ± {half_width(one.half)}" if searched else f"{one.effect.speed:g}"
    )
    return f"{one.effect.key} (speed {speed} rad/s)"


def _missing(ranking: ChainRanking) -> str:
    """The laws found missing, in the order found, and what remains beside them."""
    said = [f"missing: {_laws(ranking, JointAnswer.MISSING)}"]
    if ranking.unlisted:
        rest = ", ".join(_ratio(joint, ratio) for joint, ratio in ranking.unlisted.items())
        said += [_sentences([one]) for one in (f"beside them something not listed remains at {rest}", *_parts(ranking))]
    return ". ".join(said)


def _parts(ranking: ChainRanking) -> list[str]:
    """Laws that explain no more than what remains unlisted, in a sentence."""
    laws = _laws(ranking, JointAnswer.UNDECIDED)
    return [f"{laws} explain less than what remains, and may be parts of the same cause: not named"] if laws else []


def _laws(ranking: ChainRanking, answer: JointAnswer) -> str:
    return ", ".join(law_text(one) for one in ranking.candidates if one.answer is answer)


def fit_head(fitted: ChainFit, cutoff: float, doubts: Doubts) -> str:
    """What was fitted to what, and what makes it unsound, in a sentence each."""
    chain = fitted.model.chain
    said = (
        f"{len(chain.coupling.free)} joints, {int(fitted.used.sum())} equations up to {cutoff:.3g} Hz: "
        f"{len(fitted.estimates)} base parameters of {len(fitted.model.names)} parameters"
    )
    if fitted.unseen:
        said += f"; this motion does not determine {', '.join(fitted.unseen)}"
    few = FewEquations(fitted.seconds, int(fitted.used.sum()), fitted.cutoff, len(fitted.estimates))
    return _sentences([said, *([str(few)] if doubts.few else []), *_doubts(doubts), *gaps_text(fitted, doubts)])


def _sentences(parts: Sequence[str]) -> str:
    """Sentences one after another."""
    return ". ".join(part[0].upper() + part[1:] for part in parts)


def _doubts(doubts: Doubts) -> list[str]:
    """What makes a fit unsound, and what to do, in a sentence each."""
    out = [
        f"the torque of {one.joint} fits with the opposite sign (error at {one.seen_at} {one.turned:.3g} in place of "
        f"{one.sigma:.3g}): "
        "turn its sign, or that of its position"
        for one in doubts.turned
    ]
    if doubts.exchanged is not None:
        one = doubts.exchanged
        columns = ", or in ".join(one.columns)
        errors = [" and ".join(f"{x:.3g}" for x in sigma) for sigma in (one.exchanged, one.sigma)]
        out.append(
            f"the columns of {one.joints[0]} and {one.joints[1]} fit exchanged in {columns} (errors {errors[0]} in "
            f"place of {errors[1]}): exchange them"
        )
    out += [
        f"the torque of {one.joint} stops at {one.limit:.4g} (in {100.0 * one.share:.2g} % of the samples), and the "
        "model asks for more there: it is clipped. Move more slowly, or give the other samples with their times (t=…)"
        for one in doubts.clipped
    ]
    if doubts.in_milliseconds:
        out.insert(0, "the times of the samples are milliseconds, as each joint fits: give seconds (or a rate in Hz)")
    if doubts.in_degrees:
        joints = ", ".join(doubts.in_degrees)
        out.insert(0, f"the positions of {joints} are degrees, by their size and as each joint fits: give radians")
    if doubts.late is not None:
        delay, half = 1e3 * abs(doubts.late.delay), 1e3 * doubts.late.half
        when = "later" if doubts.late.delay > 0.0 else "earlier"
        out.append(f"the torques are {with_interval(delay, half)} ms {when} than the positions: shift them by that")
    if doubts.biased:
        out.append(
            f"the noise of the positions moves {_names(doubts.biased)} by more than "
            f"{100.0 * SELECTION.confounded_interval:g} % of the interval: fit to a lower cut-off (cutoff=…), or "
            "measure positions with less noise"
        )
    if doubts.wrong_signs:
        names = ", ".join(one.name for one in doubts.wrong_signs)
        verb = "is" if len(doubts.wrong_signs) == 1 else "are"
        first = "if that remains with less noise, " if doubts.biased else ""
        out.append(
            f"{names} {verb} negative beyond the interval, which no mass, inertia or friction can be: {first}"
            "check the signs and units of torques and positions, joint by joint; where they are right, the model lacks "
            "something"
        )
    return out


def _names(estimates: Sequence[ChainEstimate]) -> str:
    """The first of their names, and how many more there are."""
    names, most = [one.name for one in estimates], SELECTION.most_reported
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def ranking_head(ranking: ChainRanking, scores: Sequence[JointScore], doubts: Doubts) -> str:
    """What was found missing, in sentences; where nothing was, at which joints the model fails nevertheless."""
    verdict = verdict_of(ranking, scores, doubts)
    if verdict is ChainVerdict.UNSOUND:
        reasons = _doubts(doubts) or ["the equations are too few (a longer record, or a higher cut-off, has more)"]
        laws = _laws(ranking, JointAnswer.MISSING)
        then = [f"then rank again: {laws} may only stand in for that"] if laws else []
        return "no law is named, as the fit is unsound. " + _sentences([*reasons, *then])
    if verdict is ChainVerdict.MISSING:
        return _missing(ranking)
    if verdict is ChainVerdict.UNTESTED:
        return f"nothing was tested: {ranking.blocks} blocks of motion are too few"
    count, failing = len(ranking.candidates), failing_joints(scores)
    if verdict is ChainVerdict.UNLISTED:
        large = [one for one in failing if not one.small]
        said = (
            f"the model fails at {_ratios(large)}, and the cause is not among the {count} laws tried: not listed. Plot "
            "what remains there (fitted.residual) over position, rate and time: it may be friction of another shape, a "
            "torque that changes with position, a load that was changed on the way, or an instrument. Or it is what is "
            "given: the direction of gravity, units and signs of positions and torques, the gears' ratios"
        )
        return ". ".join([said, *(_sentences([one]) for one in [*_parts(ranking), *_alike(ranking), *_doubts(doubts)])])
    if verdict is ChainVerdict.SMALL:
        share = f"{100.0 * SELECTION.effect_size:g} %"
        said = (
            f"none of the {count} laws tried is named. A small rest of unknown cause remains at {_ratios(failing)}: "
            f"less than {share} of the torque's variation. Friction that is sampled where a joint turns back may leave "
            "as much, and so may friction that changes as the robot warms (plot fitted.residual over time); values of "
            "such a joint may be off by more than their intervals"
        )
        return ". ".join([said, *(_sentences([one]) for one in _alike(ranking))])
    worst = max(scores, key=lambda one: one.ratio)
    return (
        f"nothing missing that these data show; {count} laws were tried. The largest error is {worst.joint}'s, "
        f"{worst.ratio:.2g} times its noise floor (1: noise alone; no more than chance)"
    )


def _alike(ranking: ChainRanking) -> list[str]:
    """Laws that explain a part of what remains beyond chance, and are not named, in a sentence."""
    laws = [one for one in ranking.candidates if one.answer is JointAnswer.SMALL][: SELECTION.most_reported]
    if not laws:
        return []
    parts = ", ".join(f"{law_text(one)} ({one.gain:.0f} % of a joint's rest)" for one in laws)
    return [
        f"what remains resembles {parts} beyond chance, but by less than the laws in the model are exact to, and not "
        "wholly: try the model with it (with_effects), and see whether the rest is gone"
    ]


def _ratios(scores: Sequence[JointScore]) -> str:
    """Joints and their errors in noise floors."""
    return ", ".join(_ratio(one.joint, one.ratio) for one in scores)


def _ratio(joint: str, ratio: float) -> str:
    return f"{joint} (error {ratio:.2g} times its noise floor)"
