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

from lacet.identify.effects.base import Effect
from lacet.identify.progress import Tell, silent
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.chow_test import Constancy, constancy
from lacet.identify.selection.cross_products import Reading, sheet_sums
from lacet.identify.selection.forward_selection import best_set, refined, with_ties
from lacet.identify.selection.lack_of_fit import SIGNIFICANCE, Left, structured
from lacet.identify.selection.regressor_noise import ColumnNoise, noise_through
from lacet.identify.selection.relinearisation import STILL, columns_as_read, read_again, without_fault
from lacet.identify.selection.score_tests import (
    LEAST_GAIN,
    Candidate,
    TrialSpace,
    implausible,
    judged,
    stands_out,
    unit_of,
)
from lacet.identify.selection.symbolic_laws import Formula, propose
from lacet.identify.selection.tolerance_tests import Excused
from lacet.identify.validation.noise_floor import NoiseFloor, floor_at

MAIN = 0.75
"""Part of the excess of its rows that the best set of effects must explain, else the cause is not listed…"""
RARE = 0.01
"""… where no more of simulated runs leave as much: one in twenty leaves half the excess of a small effect."""
OWN = 0.3
"""Part of that excess that the one proposed must take away itself: of three alike each has a third."""
STAYS = 0.15
"""Part of all excess that may stay behind the best set; if more does and is no noise, it is not listed either."""


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
    now, draws = space.left_by([]), space.floor.count
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
        after = space.left_by([replace(effects[c.key], shape=c.shape) for c in sharper])
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
    sheet = space.excused(best.key if best else "")
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
    effect = space.tried[best.key].trial.effect.as_physics
    if effect is None:
        return True
    tell(f"what noise does through {best.key}")
    c = refined(space, best)
    through = noise_through(
        space.fitted, space.floor.sigma, space.louder, replace(effect, shape=c.shape), np.array(c.values)
    )
    return left - sum(max(0.0, through[row]) for row in now.above) > most


def strength(c: Candidate) -> float:
    """Weighted squares it takes off; a latency's gain is told beside the rig's clocks, which tolerances may move."""
    return min(c.total_gain, c.drop)


MARGINAL = 1.25
"""Residual ÷ floor up to which a row may fail by latencies of one tolerance, or a floor of parameters led astray."""
BENT = 0.25
"""Part of what a candidate takes off that may be what first-order columns do not tell of latencies."""
UNUSUAL = 3.0
"""Tolerances beyond which a user is told what the sensor sheet would have to be wrong by."""
MOST_TOLD = 4
"""No more of its entries are told, and no more candidates."""
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
    noise : in the columns at the first look, for that of the next ranking.
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
    found, seen = _looked(Reading.of(fitted, floor), candidates, seed, noise, tell)
    if may_leave_more(seen) and seen.best is not None:
        _, beside = _looked(without_fault(seen.space, seen.best.key, tell), candidates, seed, None, tell)
        seen = explained_by(seen, beside)
    best, ranked, failing = (None if seen.unlisted else seen.best), list(seen.ranked), seen.now.above
    if best is not None:
        best = refined(seen.space, best)
        best = replace(best, why=judged(best, seen.effects[best.key], floor.count).why)
        ranked = [best if c.key == best.key else c for c in ranked]
    ranked = [_open(c, best) for c in ranked]
    ratios, formulas = _ratios(fitted, floor), list[Formula]()
    if seen.unlisted:
        tell("simple laws that the residual follows")
        hidden = seen.strained or not failing
        formulas = propose(seen.space.reading, _worst(ratios) if hidden else failing, seed)
        verdict, says = "unlisted cause", _unlisted(seen, formulas)
    elif best is not None:
        verdict, says = "missing", _missing(best)
    else:
        verdict, says = "nothing missing", _nothing(seen, ranked)
    return Diagnosis(
        verdict, says, best, (*ranked, *seen.untestable), ratios, seen.excess, seen.explained,
        floor.count, seen.space.louder, failing, seen.together, found, tuple(formulas),
    )  # fmt: skip


def _looked(
    reading: Reading, candidates: Sequence[Effect], seed: int, noise: ColumnNoise | None, tell: Tell
) -> tuple[ColumnNoise, Look]:
    """Noise in the columns of the first look at runs, and what was seen at last, more closely where that may matter."""
    columns = columns_as_read(reading, candidates, seed, tell)
    seen = look(TrialSpace(columns, noise, tell), tell)
    found = seen.space.noise
    for closer in (_read_closely, _with_its_floor):
        if _in_doubt(seen):
            space = seen.space
            closest = closer(space, tell)
            if closest is not space.reading:
                # What noise adds cancels in what the model explains at this fit's zeros only.
                same = space.noise if closest.fitted is space.fitted else None
                seen = look(TrialSpace.of(closest, candidates, seed, same, tell), tell)
    return found, seen


def _in_doubt(seen: Look) -> bool:
    """Whether a closer look may change the answer, where rows fail by little or not at all.

    For an unlisted cause latencies and floor may be to blame. What is proposed was compared with simulated runs as loud
    as this one, so that a floor somewhat low has not made it; latencies may have.
    """
    now = seen.now
    # Sensors louder than their sheet lift all rows; a cause has a colour.
    louder = seen.space.louder if now.above and not structured(now) else dict[str, float]()
    if any(now.ratios[row] >= MARGINAL * louder.get(row, 1.0) for row in now.above):
        return False
    # Latencies may also make a candidate where no row fails.
    unsure = seen.unlisted and bool(now.above)
    return unsure or (seen.best is not None and _bent(seen.space) > BENT * strength(seen.best))


def _bent(space: TrialSpace) -> float:
    """Weighted squares that latencies may leave beside their first-order columns: about (ω τ / 2)² of what those do."""
    layout, omega = space.layout, space.reading.omega
    found = dict(zip(space.partialled.taken.tolist(), space.partialled.gain[:, layout.right].tolist(), strict=True))
    places = [layout.model + layout.sheet.index(entry) for entry in space.reading.clocks]
    late = np.array([found.get(place, 0.0) for place in places])
    reach = omega * np.max(np.abs(late * list(space.reading.clocks.values())), initial=0.0)
    return float((reach / 2.0) ** 2 * late @ space.sums.total[np.ix_(places, places)] @ late)


def _read_closely(space: TrialSpace, tell: Tell) -> Reading:
    """Latencies taken out of the runs that a first-order column tells well, but not to a part of the noise."""
    return space.reading if space.reading.late else read_again(space.reading, tell, STILL)


def _with_its_floor(space: TrialSpace, tell: Tell) -> Reading:
    """The noise floor where the sensor sheet leads the parameters to: that of the fit may be another."""
    tell("the noise floor at the parameters that the sensor sheet leads to")
    floor = floor_at(space.fitted, space.led, space.floor.count)
    return replace(space.reading, floor=floor, sums=sheet_sums(space.fitted, floor))


def may_leave_more(seen: Look) -> bool:
    """Whether rows fail for a cause that is not listed, and the best that stands out is a sensor fault."""
    rows_fail = seen.unlisted and not seen.strained and seen.changing is None
    return rows_fail and seen.best is not None and seen.effects[seen.best.key].as_fault is not None


def explained_by(seen: Look, beside: Look) -> Look:
    """`seen` as it is to be judged, once the best was taken out of the runs and `beside` is what was seen then.

    The fault alone, or with the best set beside it, must explain as much as is asked of any set.
    """
    assert seen.best is not None
    before = seen.space.left_unexcused(seen.best.key)
    whole, alone = before.excess(before.above), beside.now.excess(beside.now.above)
    left = alone if beside.unlisted else beside.excess * (1.0 - beside.explained)
    if left > (STAYS if beside.unlisted else 1.0 - MAIN) * whole:
        return seen
    together = (seen.best.key,) if beside.unlisted else (seen.best.key, *beside.together)
    best = _as_fitted(seen.best, beside.space.fitted)
    return replace(seen, best=best, unlisted=False, excess=whole, explained=1.0 - left / whole, together=together)


def _as_fitted(fault: Candidate, fitted: Fit) -> Candidate:
    """With the size at which it was taken out."""
    (at,) = (i for i, name in enumerate(fitted.model.names) if name.startswith(f"{fault.key}."))
    wide = np.sqrt(fitted.covariance[at, at] + fitted.covariance_sheet[at, at])
    return replace(fault, values=(float(fitted.theta[at]),), interval=(1.96 * float(wide),))


def _ratios(fitted: Fit, floor: NoiseFloor) -> dict[str, float]:
    """Residual ÷ floor of each row over the runs used."""
    out: dict[str, float] = {}
    for row in fitted.rows:
        squares = np.concatenate([part[row] ** 2 for part in fitted.residual if row in part])
        out[row] = float(np.sqrt(np.mean(squares))) / floor.sigma[row]
    return out


def _open(c: Candidate, best: Candidate | None) -> Candidate:
    """A candidate that passes is missing only if it is the one proposed, or tied with it; else it is judged later."""
    tied = c.key in dict(best.ties) if best else False
    if c.answer == "missing" and not tied and not (best and c.key == best.key):
        more = f"It is judged again once {best.key} is added." if best else "It does not explain what is left."
    elif c.answer == "not needed" and best and tied:
        more = f"But it cannot be told apart from {best.key}."
    else:
        return c
    return replace(c, answer="undecided", why=f"{c.why} {more}")


def _missing(best: Candidate) -> str:
    tied = f" It cannot be told apart from {', '.join(key for key, _ in best.ties)} on these runs." if best.ties else ""
    return f"{best.key} is missing. {best.why}{tied}"


def _unlisted(seen: Look, formulas: Sequence[Formula]) -> str:
    if seen.strained:
        return _strained(seen, formulas)
    if seen.changing and seen.best:
        return _changing(seen.changing, seen.best, seen.effects[seen.best.key], formulas)
    now = seen.now
    worst = max(now.above, key=lambda row: now.ratios[row])
    own = [row for row in now.above if seen.best and row in seen.best.rows] or now.above
    where = f" in {', '.join(own)}" if len(own) < len(now.above) else ""
    says = (
        f"The model fails ({worst} at {now.ratios[worst]:.2f} times its floor) and the cause is not listed: the best "
        f"set of effects of the catalogue ({', '.join(seen.together) or 'none'}) explains "
        f"{100 * max(0.0, seen.explained):.0f} % of what is above the floor{where}, and the rest is no noise."
    )
    if seen.best and where and seen.explained >= MAIN:
        says += f" Of these rows {seen.best.key} may be the cause: add it, and see what the others still lack."
    if not formulas:
        return f"{says} No law of the measured states describes it: it may depend on something that is not measured."
    return f"{says} {_described(formulas[0])}"


def _strained(seen: Look, formulas: Sequence[Formula]) -> str:
    """Why a sensor sheet that would have to be so wrong is a cause that is not listed."""
    sheet = seen.sheet
    beside = f"Beside {seen.best.key}, the best of the catalogue, the" if seen.best else "The"
    says = (
        f"{beside} model fits these runs only if the sensor sheet is wrong (in tolerances: {_off(sheet)}). The squares "
        f"of all but latencies sum to {sheet.squares:.0f}, in simulated runs that lack nothing to "
        f"{np.mean(sheet.null):.0f} and never above {np.max(sheet.null):.0f}. Either several instruments are off "
        f"(calibrate them, or write their true tolerances into the rig file), or the cause is not listed."
    )
    return f"{says} {_described(formulas[0])}" if formulas else says


def _changing(runs: Constancy, best: Candidate, effect: Effect, formulas: Sequence[Formula]) -> str:
    """Why a law that would have to be another in each run is none."""
    k, *two = runs.apart
    q = effect.parameters[k]
    told = " and ".join(f"{runs.values[r][k]:.3g} ± {1.96 * runs.spread[r][k]:.2g} {q.unit} in {r}" for r in two)
    says = (
        f"The model lacks something, and the cause is not listed: {best.key} explains most, but it would have to be "
        f"another law in each run ({q.name} is {told}; simulated runs differ as much with p = {runs.p:.2g})."
    )
    return f"{says} {_described(formulas[0])}" if formulas else says


def _described(best: Formula) -> str:
    return (
        f"What comes nearest of simple laws is '{best.text}', which takes {100 * best.gain:.0f} % off "
        f"{', '.join(best.rows)} in parts of the runs it was not fitted to: a description, not a cause."
    )


def _worst(ratios: Mapping[str, float]) -> list[str]:
    """Rows at least half as far above their floor as the worst, before any tolerance is taken out."""
    half = 0.5 * (max(ratios.values()) ** 2 - 1.0)
    return [row for row, ratio in ratios.items() if ratio > 1.0 and ratio**2 - 1.0 >= half]


def _off(sheet: Excused, least: float = 0.0) -> str:
    """Entries of the sensor sheet that are farthest off, in tolerances."""
    most = sorted(sheet.sizes.items(), key=lambda one: -abs(one[1]))[:MOST_TOLD]
    return ", ".join(f"{name} {size:+.1f}" for name, size in most if abs(size) > least)


def _nothing(seen: Look, ranked: Sequence[Candidate]) -> str:
    now = seen.now
    worst = max(now.ratios, key=lambda row: now.ratios[row])
    least = min((c.p for c in ranked), default=1.0)
    says = (
        f"Nothing is missing that these runs can show: with the sensor sheet's tolerances taken out the row farthest "
        f"above its noise floor is {worst}, at {now.ratios[worst]:.2f}, and what the best of {len(ranked)} candidates "
        f"does, chance does with p = {least:.2g}."
    )
    if small := [c for c in ranked if stands_out(c, seen.effects[c.key])]:
        told = ", ".join(f"{c.key} {c.gain_rms:.3g} {unit_of(c)} RMS, p = {c.p:.2g}" for c in small[:MOST_TOLD])
        says += (
            f" Chance does not explain all: {told}. That is less than {100 * LEAST_GAIN:g} % of any row; add it if so "
            f"little matters to you."
        )
    loud = [f"{row} {ratio:.1f} times" for row, ratio in seen.space.louder.items() if ratio > LOUD]
    if loud:
        says += f" Sensors are noisier than their sheet says ({', '.join(loud)}): lacet check tells which."
    if off := _off(seen.sheet, UNUSUAL):
        says += (
            f" For that the sensor sheet would have to be off by more than {UNUSUAL:g} of its tolerances "
            f"({off}): look at these instruments (lacet check measures latencies)."
        )
    return says
