"""One look at all candidates beside a fit: their ranks, what the best explain together, and whether that is enough."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from lacet.identify.effects.base import Effect, SensorFault
from lacet.identify.progress import Tell
from lacet.identify.selection.candidate import Candidate
from lacet.identify.selection.constancy import Constancy, constancy
from lacet.identify.selection.excused import Excused, excused
from lacet.identify.selection.lack_of_fit import LOUDEST, Left
from lacet.identify.selection.noisy_law import noise_through
from lacet.identify.selection.refine import refined
from lacet.identify.selection.ties import with_ties
from lacet.identify.selection.trials import TrialSpace
from lacet.identify.selection.unlisted import best_set, left_by
from lacet.identify.selection.verdicts import SIGNIFICANCE, implausible, judged, stands_out
from lacet.identify.validation.whiteness import whiteness

MAIN = 0.75
"""Part of the excess of its rows that the best set of effects must explain, else the cause is not listed…"""
RARE = 0.01
"""… where no more of simulated runs leave as much: one in twenty leaves half the excess of a small effect."""
OWN = 0.3
"""Part of that excess that the one proposed must take away itself: of three alike each has a third."""
STAYS = 0.15
"""Part of all excess that may stay behind the best set; if more does and is no noise, it is not listed either."""
MOST = 0.5
"""Part of an excess that must stand above the noise's level to be no noise."""
QUIET = 0.25
"""Part of a spectrum's bands that is taken for noise alone."""


@dataclass(frozen=True)
class Look:
    """What one look at the candidates tells.

    Attributes
    ----------
    space : the candidates beside the fit.
    now : what the model leaves, with the sensor sheet's tolerances taken out.
    ranked : those that can be tested, best first; `untestable` the others.
    best : the first that passes every bar, or None.
    together : the best set of up to three.
    excess : weighted squares above the floor in the rows that fail and the best acts on; `explained` the part that the
        best set takes away.
    sheet : what the sensor sheet takes up beside the best, or beside none.
    strained : whether the sheet would have to be wrong for that, the best takes away less, and nothing else calls the
        cause unlisted already.
    changing : the best run by run, if it would have to be another law in each and the rows do not already call the
        cause unlisted; else None.
    unlisted : whether what is above the floor, strains the sheet or changes from run to run has a cause that no
        candidate stands for.
    """

    space: TrialSpace
    now: Left
    ranked: tuple[Candidate, ...]
    untestable: tuple[Candidate, ...]
    best: Candidate | None
    together: tuple[str, ...]
    excess: float
    explained: float
    sheet: Excused
    strained: bool
    changing: Constancy | None
    unlisted: bool

    @property
    def effects(self) -> Mapping[str, Effect]:
        """Candidates by key."""
        return {effect.key: effect for effect in self.space.effects}


def look(space: TrialSpace, tell: Tell) -> Look:
    """Try all candidates of a space."""
    now, draws = left_by(space, []), space.floor.count
    tell("how far each takes the error down")
    all_tried = space.family_wise(space.try_all())
    effects = {effect.key: effect for effect in space.effects}
    # What chance does as well comes last.
    ranked = sorted((c for c in all_tried if c.tested), key=lambda c: (c.p > SIGNIFICANCE, -strength(c)))
    tell("which cannot be told apart")
    standing_out = {c.key for c in ranked if stands_out(c, effects[c.key])}
    ranked = with_ties([judged(c, effects[c.key], draws) for c in ranked], space, standing_out)
    plausible = [c.key for c in ranked if not implausible(c, effects[c.key].parameters)]
    tell("what the best explain together")
    together = best_set(space, plausible)
    best = next((c for c in ranked if c.answer == "missing"), None)
    # Rows that do not fail have no excess to explain; their scatter would hide that of a small effect.
    own = [row for row in now.above if best and row in best.rows] or now.above
    excess, explained, unlisted = now.excess(own), 0.0, False
    if now.above:
        # A gap between two values of the grid would leave what looks like another cause.
        sharper: list[Candidate] = []
        for c in [c for c in ranked if c.key in together]:
            tell(f"the constants of {c.key}")
            sharper.append(refined(space, c))
        tell("what they leave")
        after = left_by(space, [replace(effects[c.key], shape=c.shape) for c in sharper])
        explained = (excess - after.excess(own)) / excess
        little = explained < MAIN and after.chance(own) <= max(RARE, 1.0 / (1.0 + draws))
        unlisted = structured(now) and (
            best is None or little or strength(best) < OWN * excess or _stays(space, now, after, best, tell)
        )
    untestable = tuple(c for c in all_tried if not c.tested)
    changing = None
    if best is not None and not unlisted:
        tell(f"whether {best.key} is the same in all runs")
        found = constancy(space, best, [c for c in ranked if c.key in together and c.key != best.key])
        changing = found if found is not None and found.broken else None
    # Where the sheet's tolerances take the whole cause up no row fails, and some fault is larger than any tolerance.
    sheet = excused(space, best.key if best else "")
    strained = not (unlisted or changing) and sheet.strained and (best is None or strength(best) < sheet.excess)
    return Look(
        space, now, tuple(ranked), untestable, best, tuple(together), excess, explained,
        sheet, strained, changing, unlisted or strained or changing is not None,
    )  # fmt: skip


def _stays(space: TrialSpace, now: Left, after: Left, best: Candidate, tell: Tell) -> bool:
    """Whether the best set leaves too much of the excess, and that is no noise, the noise through the best included."""
    left, most = after.excess(now.above), STAYS * now.excess(now.above)
    if after.family > SIGNIFICANCE or left <= most or not structured(after):
        return False
    effect = space.tried[best.key].trial.effect
    if isinstance(effect, SensorFault):
        return True
    tell(f"what noise does through {best.key}")
    c = refined(space, best)
    through = noise_through(space, replace(effect, shape=c.shape), np.array(c.values))
    return left - sum(max(0.0, through[row]) for row in now.above) > most


def strength(c: Candidate) -> float:
    """Weighted squares it takes off; a latency's gain is told beside the rig's clocks, which tolerances may move."""
    return min(c.total_gain, c.drop)


def structured(left: Left) -> bool:
    """Whether what is above the floor has another colour than the noise; sensors louder than their sheet leave it.

    The noise's level is read from the quietest bands of each row's spectrum: most of the excess must stand above it.
    """
    smallest, count, excess, coloured = 1.0, 0, 0.0, 0.0
    for key, residual in left.residual.items():
        found = whiteness(residual, left.draws[key], np.arange(residual.size), 1.0) if key[1] in left.above else None
        if found is not None and found.frequency.size > 1:
            smallest, count = min(smallest, found.ljung_box), count + 1
            width = np.gradient(found.frequency)
            level = min(LOUDEST**2, float(np.quantile(found.spectrum / found.floor, QUIET)))
            excess += float(np.sum(width * (found.spectrum - found.floor)))
            coloured += float(np.sum(width * np.maximum(0.0, found.spectrum - max(1.0, level) * found.floor)))
    return smallest * count <= SIGNIFICANCE and coloured > MOST * excess > 0.0
