"""Which physical effect is missing: every candidate tried on top of the fitted model, and ranked honestly.

Rows are weighted by the simulated noise floor, frozen for all candidates and versions. What the model, each run's
sensor zeros and the sensor sheet's tolerances can explain is partialled out of every candidate first. The rank is the
gain in blocked cross-validation; a candidate is proposed only when the largest drop over all candidates is larger than
what the same search finds in simulated runs that lack nothing, and the gain matters in newtons.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from identify.effect import Effect
from identify.fit import Fit
from identify.floor import NoiseFloor
from identify.trials import Candidate, TrialSpace

SIGNIFICANCE = 0.05
"""Family-wise error of a proposal."""
LEAST_GAIN = 0.01
"""A proposal must take away at least this part of the weighted residual of the rows it acts on."""
EXCESS = 1.1
"""Residual ÷ floor above which a row is said to fail."""


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
    excess : weighted squares above the floor; `explained` the part the best set of up to three candidates takes away.
    draws : number of noise-floor simulations behind p.
    """

    verdict: str
    says: str
    best: Candidate | None
    candidates: tuple[Candidate, ...]
    ratios: Mapping[str, float]
    excess: float
    explained: float
    draws: int


def diagnose(fitted: Fit, floor: NoiseFloor, candidates: Sequence[Effect], seed: int = 0) -> Diagnosis:
    """Rank `candidates` on top of a fitted model, on the runs it was fitted to.

    `floor` is the noise floor of this fit's runs; its σ are the weights.
    """
    space = TrialSpace(fitted, floor, candidates, seed)
    tried = [space.try_candidate(effect) for effect in candidates if effect.key not in fitted.model]
    tried = space.family_wise(tried)
    ranked = sorted((c for c in tried if c.answer != "not testable"), key=lambda c: -c.total_gain)
    untestable = [c for c in tried if c.answer == "not testable"]
    excess, explained = space.explained(ranked)
    ranked = [_judged(c, space) for c in ranked]
    ranked = space.with_ties(ranked)
    missing = [c for c in ranked if c.answer == "missing"]
    ratios = space.ratios
    failing = [row for row, ratio in ratios.items() if ratio > EXCESS]
    best = missing[0] if missing else None
    if best is not None:
        alike = {best.key, *(key for key, _ in best.ties)}
        later = f" It is judged again once {best.key} is added."
        ranked = [
            replace(c, answer="undecided", why=c.why + later) if c.answer == "missing" and c.key not in alike else c
            for c in ranked
        ]
    if best is not None and explained >= 0.5:
        verdict = "missing"
        says = f"{best.key} is missing. {best.why}"
        if best.ties:
            says += f" It cannot be told apart from {', '.join(k for k, _ in best.ties)} on these runs."
    elif failing and excess > 0 and explained < 0.5:
        verdict = "unlisted cause"
        best = None
        ranked = [replace(c, answer="undecided") if c.answer == "missing" else c for c in ranked]
        worst = max(failing, key=lambda row: ratios[row])
        says = (
            f"The model fails ({worst} at {ratios[worst]:.2f} times its floor), but the best set of three effects of "
            f"the catalogue explains only {100 * max(0.0, explained):.0f} % of what is left: the cause is not listed."
        )
    else:
        verdict = "nothing missing"
        best = None
        worst = max(ratios, key=lambda row: ratios[row])
        says = (
            f"Nothing is missing that these runs can show: no row is far above its noise floor (most: {worst}, "
            f"{ratios[worst]:.2f}) and no candidate beats what noise alone does."
        )
    return Diagnosis(verdict, says, best, (*ranked, *untestable), ratios, excess, explained, floor.count)


def _judged(c: Candidate, space: TrialSpace) -> Candidate:
    unit = space.unit_of(c.key)
    evidence = (
        f"It takes away {100 * c.gain:.1f} % of the weighted residual of its rows ({c.gain_rms:.3g} {unit} RMS) in "
        f"cross-validation; chance alone does as well with p = {c.p:.3g}."
    )
    if c.p <= SIGNIFICANCE and c.gain >= LEAST_GAIN:
        return replace(c, answer="missing", why=evidence)
    lacking = f"p = {c.p:.2g} is above {SIGNIFICANCE:g}" if c.p > SIGNIFICANCE else f"less than {100 * LEAST_GAIN:g} %"
    return replace(c, answer="not needed", why=f"{evidence} Not needed: {lacking}.")
