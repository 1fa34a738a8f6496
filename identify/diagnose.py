"""Which physical effect is missing: every candidate tried on top of the fitted model, and ranked honestly.

Rows are weighted by the simulated noise floor, frozen for all candidates and versions. What the model, each run's
sensor zeros and the sensor sheet's tolerances can explain is partialled out of every candidate first. The rank is the
gain in blocked cross-validation; a candidate is proposed only when the largest drop over all candidates is larger than
what the same search finds in simulated runs that lack nothing, and the gain matters in newtons.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from identify.candidate import Candidate
from identify.column_noise import ColumnNoise
from identify.effect import Effect
from identify.excused import excused
from identify.fit import Fit
from identify.floor import NoiseFloor, floor_at
from identify.formulas import Formula, propose
from identify.lack_of_fit import LOUDEST, Left
from identify.late_or_missing import columns_as_read
from identify.news import Tell, silent
from identify.reading import STILL, Reading, read_again, sheet_sums
from identify.refine import refined
from identify.ties import with_ties
from identify.trials import TrialSpace
from identify.unlisted import best_set, left_by
from identify.verdicts import SIGNIFICANCE, implausible, judged
from identify.whiteness import whiteness

HALF = 0.5
"""Part of the excess of its rows that the best set of effects must explain, else the cause is not listed…"""
MAIN = 0.75
"""… and this part where what they leave is more than chance leaves."""
OWN = 0.3
"""Part of that excess that the one proposed must take away itself: of three alike each has a third."""
STAYS = 0.15
"""Part of all excess that may stay behind the best set; if more does and is no noise, it is not listed either."""
MOST = 0.5
"""Part of an excess that must stand above the noise's level to be no noise."""
QUIET = 0.25
"""Part of a spectrum's bands that is taken for noise alone."""
MARGINAL = 1.25
"""Residual ÷ floor up to which a row may fail by latencies of one tolerance, or a floor of parameters led astray."""
UNUSUAL = 3.0
"""Tolerances beyond which a user is told what the sensor sheet would have to be wrong by."""
LOUD = 1.3
"""Noise ÷ sheet above which a user is told that sensors are noisier than their sheet says."""


@dataclass(frozen=True)
class Diagnosis:
    """What is missing in a model.

    Attributes
    ----------
    verdict : ``missing``, ``nothing missing`` or ``unlisted cause``.
    says : the verdict in plain sentences.
    best : the candidate proposed, or None.
    candidates : all, best first; those that cannot be tested last.
    ratios : row → residual ÷ floor of the present model on the runs used.
    excess : weighted squares above the floor in the rows that fail and the best acts on; `explained` the part that the
        best set of up to three candidates takes away.
    draws : number of noise-floor simulations behind p.
    louder : row → noise ÷ sheet, where everything a candidate could explain was taken out; 1 where the sheet holds.
    failing : rows above their floor by more than chance.
    together : the best set of up to three candidates.
    noise : in the columns, for the next ranking.
    formulas : for an unlisted cause, laws that part of the residual follows, best first.
    """

    verdict: str
    says: str
    best: Candidate | None
    candidates: tuple[Candidate, ...]
    ratios: Mapping[str, float]
    excess: float
    explained: float
    draws: int
    louder: Mapping[str, float]
    failing: tuple[str, ...]
    together: tuple[str, ...]
    noise: ColumnNoise = field(repr=False)
    formulas: tuple[Formula, ...] = ()


def diagnose(
    fitted: Fit, floor: NoiseFloor, candidates: Sequence[Effect], seed: int = 0, noise: ColumnNoise | None = None,
    tell: Tell = silent,
) -> Diagnosis:  # fmt: skip
    """Rank `candidates` on top of a fitted model, on the runs it was fitted to.

    `floor` is the noise floor of this fit's runs; its σ are the weights. `noise` in the columns, as an earlier ranking
    of the same candidates found it, spares finding it again. `tell` is told what is done now.
    """
    tell("what the sensor sheet leaves open")
    recorded = Reading.of(fitted, floor)
    space = TrialSpace(columns_as_read(recorded, candidates, seed, tell), noise, tell)
    now = left_by(space, [])
    for closer in (_read_closely, _with_its_floor):
        if now.above and max(now.ratios[row] for row in now.above) < MARGINAL:
            reading = closer(space, tell)
            if reading is not space.reading:
                # What noise adds cancels in what the model explains at this fit's zeros only.
                same = space.noise if reading.fitted is space.fitted else None
                space = TrialSpace.of(reading, candidates, seed, same, tell)
                now = left_by(space, [])
    tell("how far each takes the error down")
    found = space.family_wise(space.try_all())
    effects = {effect.key: effect for effect in space.effects}
    # What chance does as well comes last.
    ranked = sorted((c for c in found if c.tested), key=lambda c: (c.p > SIGNIFICANCE, -_strength(c)))
    tell("which cannot be told apart")
    ranked = with_ties([judged(c, effects[c.key], floor.count) for c in ranked], space)
    plausible = [c.key for c in ranked if not implausible(c, effects[c.key].parameters)]
    tell("what the best explain together")
    failing = now.above
    together = best_set(space, plausible)
    best = next((c for c in ranked if c.answer == "missing"), None)
    # Rows that do not fail have no excess to explain; their scatter would hide that of a small effect.
    own = [row for row in failing if best and row in best.rows] or failing
    excess, explained, unlisted = now.excess(own), 0.0, False
    if failing:
        # A gap between two values of the grid would leave what looks like another cause.
        sharper: list[Candidate] = []
        for c in [c for c in ranked if c.key in together]:
            tell(f"the constants of {c.key}")
            sharper.append(refined(space, c))
        tell("what they leave")
        after = left_by(space, [replace(effects[c.key], shape=c.shape) for c in sharper])
        explained = (excess - after.excess(own)) / excess
        stays = after.family <= SIGNIFICANCE and after.excess(failing) > STAYS * now.excess(failing)
        little = explained < HALF or (explained < MAIN and after.chance(own) <= SIGNIFICANCE)
        lacking = best is None or little or _strength(best) < OWN * excess or (stays and structured(after))
        unlisted = lacking and structured(now)
    if unlisted:
        best = None
    elif best is not None:
        best = refined(space, best)
        best = replace(best, why=judged(best, effects[best.key], floor.count).why)
        ranked = [best if c.key == best.key else c for c in ranked]
    ranked = [_open(c, best) for c in ranked]
    formulas: list[Formula] = []
    if unlisted:
        tell("simple laws that the residual follows")
        formulas = propose(space.reading, failing, seed)
        verdict, says = "unlisted cause", _unlisted(now, failing, explained, together, formulas)
    elif best is not None:
        verdict, says = "missing", _missing(best)
    else:
        verdict, says = "nothing missing", _nothing(space, now, ranked)
    untestable = [c for c in found if not c.tested]
    return Diagnosis(
        verdict, says, best, (*ranked, *untestable), _ratios(fitted, floor), excess, explained, floor.count,
        space.columns.louder, failing, tuple(together), space.noise, tuple(formulas),
    )  # fmt: skip


def _read_closely(space: TrialSpace, tell: Tell) -> Reading:
    """Latencies taken out of the runs that a first-order column tells well, but not to a part of the noise."""
    return space.reading if space.reading.late else read_again(space.reading, tell, STILL)


def _with_its_floor(space: TrialSpace, tell: Tell) -> Reading:
    """The noise floor where the sensor sheet leads the parameters to: that of the fit may be another."""
    tell("the noise floor at the parameters that the sensor sheet leads to")
    floor = floor_at(space.fitted, space.led, space.floor.count)
    return replace(space.reading, floor=floor, sums=sheet_sums(space.fitted, floor))


def _ratios(fitted: Fit, floor: NoiseFloor) -> dict[str, float]:
    """Residual ÷ floor of each row over the runs used."""
    out: dict[str, float] = {}
    for row in fitted.rows:
        squares = np.concatenate([part[row] ** 2 for part in fitted.residual if row in part])
        out[row] = float(np.sqrt(np.mean(squares))) / floor.sigma[row]
    return out


def _strength(c: Candidate) -> float:
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


def _open(c: Candidate, best: Candidate | None) -> Candidate:
    """A candidate that passes is missing only if it is the one proposed, or tied with it; else it is judged later."""
    if c.answer != "missing" or (best and (c.key == best.key or c.key in dict(best.ties))):
        return c
    later = f"It is judged again once {best.key} is added." if best else "It does not explain what is left."
    return replace(c, answer="undecided", why=f"{c.why} {later}")


def _missing(best: Candidate) -> str:
    tied = f" It cannot be told apart from {', '.join(key for key, _ in best.ties)} on these runs." if best.ties else ""
    return f"{best.key} is missing. {best.why}{tied}"


def _unlisted(
    now: Left, failing: Sequence[str], explained: float, together: Sequence[str], formulas: Sequence[Formula]
) -> str:
    worst = max(failing, key=lambda row: now.ratios[row])
    says = (
        f"The model fails ({worst} at {now.ratios[worst]:.2f} times its floor) and the cause is not listed: the best "
        f"set of effects of the catalogue ({', '.join(together) or 'none'}) explains "
        f"{100 * max(0.0, explained):.0f} % of what is above the floor, and the rest is no noise."
    )
    if not formulas:
        return f"{says} No law of the measured states describes it: it may depend on something that is not measured."
    best = formulas[0]
    return (
        f"{says} What comes nearest of simple laws is '{best.text}', which takes {100 * best.gain:.0f} % off "
        f"{', '.join(best.rows)} in parts of the runs it was not fitted to: a description, not a cause."
    )


def _nothing(space: TrialSpace, now: Left, ranked: Sequence[Candidate]) -> str:
    worst = max(now.ratios, key=lambda row: now.ratios[row])
    least = min((c.p for c in ranked), default=1.0)
    says = (
        f"Nothing is missing that these runs can show: with the sensor sheet's tolerances taken out the row farthest "
        f"above its noise floor is {worst}, at {now.ratios[worst]:.2f}, and what the best of {len(ranked)} candidates "
        f"does, chance does with p = {least:.2g}."
    )
    loud = [f"{row} {ratio:.1f} times" for row, ratio in space.columns.louder.items() if ratio > LOUD]
    if loud:
        says += f" Sensors are noisier than their sheet says ({', '.join(loud)}): lacet check tells which."
    off = [f"{name} {size:+.1f}" for name, size in excused(space).items() if abs(size) > UNUSUAL]
    if off:
        says += (
            f" For that the sensor sheet would have to be off by more than {UNUSUAL:g} of its tolerances "
            f"({', '.join(off)}): look at these instruments (lacet check measures latencies)."
        )
    return says
