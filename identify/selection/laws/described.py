"""Listed effects found beside laws that describe a force of unknown cause.

While an unlisted force is in the residual, it hides listed effects that act in the same rows. Laws of the measured
states that describe it (`formulas.propose`) therefore join the model, as laws that are not exact, and the effects are
searched again beside them. What is then found must stand beside further laws, too (`encompassing`).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

from lacet.identify.progress import Progress, Stage, Step
from lacet.identify.selection.joint.refits import (
    Joint,
    not_part_of_the_rest,
    only_plausible,
    only_standing,
    with_all_tested,
)
from lacet.identify.selection.joint.rounds import continued
from lacet.identify.selection.laws.encompassing import only_encompassing, standing_beside_rest
from lacet.identify.selection.laws.formulas import Formula, described_by, propose
from lacet.identify.selection.rest import Rest


@dataclass(frozen=True)
class Described:
    """The effects found where an unlisted force is described.

    Attributes
    ----------
    joint, rest : the effects found, in a fit without the laws that describe it, and what it leaves.
    beside, beside_rest : the same effects in a fit with these laws, and what that leaves.
    formulas : laws that the rest follows, that explaining most first.
    laws : those in the fit of `beside`.
    """

    joint: Joint
    rest: Rest
    beside: Joint
    beside_rest: Rest
    formulas: tuple[Formula, ...]
    laws: tuple[str, ...] = ()


def described(joint: Joint, rest: Rest, seed: int, progress: Progress) -> Described:
    """The effects found and those that stand beside laws that describe what is unlisted in `rest`."""
    progress(Step(Stage.SYMBOLIC_LAWS))
    formulas = propose(joint.space, rest.unlisted)
    # Longer laws would describe a part of listed effects, too.
    laws = [law for one in formulas if not (law := one.of_one_term).listed]
    before = Described(joint, rest, joint, rest, tuple(formulas))
    if joint.base is None:
        return before
    if not laws:
        return _undescribed(before, seed, progress)
    base = joint.base.with_effects([described_by(law, joint.space) for law in laws])
    # Of an effect of one run nothing shows that it is the same again: it may be a part of what is not described.
    of_runs = {key for key, effect in joint.first.effects.items() if effect.is_of_run() and key not in joint.keys}
    again = replace(joint, base=base, dropped=frozenset(of_runs), parts=frozenset(), refused=frozenset())
    known, remaining = with_all_tested(again, seed, progress)
    hides = remaining.lack.excess(rest.unlisted)
    if rest.excess - hides <= hides:  # the laws describe no more than remains
        return _undescribed(before, seed, progress)
    found = _searched_again(known, joint.parts, seed, progress)
    out = replace(
        before, beside=found, beside_rest=Rest.of(found.space, found.laws), laws=tuple(law.text for law in laws)
    )
    if set(found.keys) == set(joint.keys):
        return out
    without, rest = with_all_tested(on_base_of(joint, found), seed, progress)
    return replace(out, joint=without, rest=rest)


def _undescribed(found: Described, seed: int, progress: Progress) -> Described:
    """The same effects where no law describes the rest: each is compared with all of it."""
    joint, rest = standing_beside_rest(found.joint, found.rest, seed, progress)
    return replace(found, joint=joint, rest=rest, beside=joint, beside_rest=rest)


def on_base_of(joint: Joint, found: Joint) -> Joint:
    """What is `found` in a fit with laws that describe a rest, on the base fit of `joint`, which has none of them.

    That base may hold effects of its own: those that are no longer found leave it, and those that are found anew.
    """
    assert joint.base is not None
    anew = {effect.key for effect in found.added}
    gone = [key for key in joint.keys if key in anew or key not in found.keys]
    base = joint.base.without_effects(gone, joint.sizes)
    held = {effect.key for effect in (*found.removed, *base.model.effects)}
    added = tuple(effect for effect in found.effects if effect.key not in held)
    sizes = {key: size for key, size in joint.sizes.items() if key not in gone}
    return replace(found, base=base, added=added, sizes=sizes)


def _searched_again(known: Joint, parts: Collection[str], seed: int, progress: Progress) -> Joint:
    """What is found in a fit that has laws that describe a rest; `parts` : keys of what did not stand without them."""
    found = only_plausible(continued(only_standing(known, seed, progress), seed, progress), seed, progress)
    found, _ = not_part_of_the_rest(found, Rest.of(found.space, found.laws), seed, progress)
    found = only_encompassing(found, seed, progress)
    found, _ = standing_beside_rest(found, Rest.of(found.space, found.laws), seed, progress)
    return replace(found, parts=(found.parts | {*parts}) - set(found.keys))
