"""Laws found at one place of the car that are the same law at other places on these runs: one class, and their sum.

Where the runs hardly move the places of a law apart, an effect found has the size of all of them together, and nothing
shows how that is split: without wheel loads and without a road that twists the car, either anti-roll bar explains what
both do. Such effects are fitted together, named together, and their sum is what is known.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

from lacet.identify.effects.base import Effect
from lacet.identify.progress import Progress, silent
from lacet.identify.properties.sums_of_places import SumOfPlaces, same_law_elsewhere, sums_of_places
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.joint.refits import Joint, with_further
from lacet.identify.validation.parameter_estimates import WIDE
from lacet.identify.validation.prediction_uncertainty import Knowledge


def with_inseparable(
    joint: Joint, found: Collection[str], seed: int, progress: Progress = silent
) -> tuple[Joint, Mapping[str, SumOfPlaces]]:
    """The model with the same law at places that the runs do not distinguish from those found as well, fitted again.

    `found` : keys of the effects found. Returned, too, are the sums, by the key of each effect in one.
    """
    fitted = joint.space.linearisation.runs.refittable
    if fitted is None or not found:
        return joint, {}
    sums = _sums(fitted, found)
    further: list[Effect] = []
    for effect in joint.effects:
        if effect.key in sums or effect.key not in found:
            continue
        others = _others(joint, effect)
        if others and (more := _sums(fitted.with_effects(others), (effect.key,))):
            further += [one for one in others if one.key in more]
            sums |= more
    return (with_further(joint, further, seed, progress) if further else joint), sums


def _others(joint: Joint, effect: Effect) -> list[Effect]:
    """The same law elsewhere, not in the model, as far as its size may move that of `effect`, for all these runs show.

    It is fitted only where its own interval beside `effect` is wide, or the runs cannot test it there.
    """
    if effect.as_physics is None or len(effect.parameters) != 1 or effect in joint.removed:
        return []
    value = abs(joint.space.fitted.value(effect.parameters[0].name))
    beside = {c.key: c for c in joint.beside}
    others = (
        replace(one, shape=effect.shape)
        for key, one in joint.first.effects.items()
        if key in beside and (not beside[key].tested or any(half > WIDE * value for half in beside[key].interval))
    )
    return [one for one in others if same_law_elsewhere(effect, one)]


def _sums(fitted: Fit, found: Collection[str]) -> dict[str, SumOfPlaces]:
    """Sums over places that the runs do not distinguish, with an effect found among them, by the keys in them."""
    sums = [one for one in sums_of_places(fitted, Knowledge.of(fitted)) if one.inseparable]
    return {key: one for one in sums if not set(one.keys).isdisjoint(found) for key in one.keys}
