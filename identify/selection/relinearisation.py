"""Re-linearisation: latencies removed from the runs, where first-order columns are too inexact.

A latency's column is the rate of the signal: valid as long as ω τ is small up to the fit's cut-off. Beyond, the second
order of a late instrument (half of ω² τ² of every signal) resembles another effect. So latencies that the runs show
within the sensor tolerances are removed from the runs, and the columns stand for the remaining ones. The means of
their priors are still the rig file's latencies.

Where a model lacks an effect of many floors, latencies move by many tolerances to make up for some of it. Runs are
linearised again only where one stays far off with all effects in the model that a first search selects.

A fault's column is of first order, too; a fault that is found is removed from the runs by the fit with it
(`joint.subset_search`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lacet.identify.effects.base import Effect
from lacet.identify.multibody.vectors import Array
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.regression.tolerances import SheetEntry
from lacet.identify.selection.columns.candidate_columns import solved
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.joint.subset_search import search
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION


def remaining_latencies(linearisation: Linearisation, latencies: Array) -> Array:
    """(l,) latencies that remain in runs from which `latencies` (l,) were removed, both in tolerances.

    The means of the priors are the rig file's latencies.
    """
    sums, layout = linearisation.sums, linearisation.sums.layout
    ours = [layout.model + layout.sheet.index(entry) for entry in linearisation.latency_tolerances]
    prior_side = np.zeros(layout.right)
    prior_side[ours] = -latencies
    nuisance, prior, prior_side = linearisation.nuisance_prior(prior_side)
    out = np.zeros(layout.right)
    right = sums.total[nuisance, layout.right] + prior_side
    out[nuisance] = solved(sums.total[np.ix_(nuisance, nuisance)] + prior, right[:, None])[:, 0]
    return out[ours]


def relinearise(
    present: Linearisation, progress: Progress = silent, largest_phase: float = SELECTION.first_order_phase,
    beside: Sequence[Effect] = (),
) -> Linearisation:  # fmt: skip
    """The runs linearised at their latencies, iterated until steps are small.

    It is the present one where no latency is further than `largest_phase` [rad], ω τ at the fit's cut-off, from that at
    which it is linearised, or the fit cannot be made again here. `beside` : effects in the model while latencies are
    estimated; the fit returned is without them.
    """
    first = present.runs.refittable
    if not present.latency_tolerances or first is None:
        return present
    with_effects = first.with_effects(beside) if beside else first
    begin = now = Linearisation.of(with_effects, present.floor.without_draws()) if beside else present
    # An effect may depend on channels that no row without it does.
    entries, tolerances = list(begin.latency_tolerances), np.array(list(begin.latency_tolerances.values()))
    begun = np.array([present.latencies.get(entry, 0.0) for entry in entries])

    def step_at(steps_made: int, latencies: Array) -> Array:
        """Latencies that remain in the runs with these removed [s]."""
        nonlocal now
        if steps_made:
            further = dict(zip(entries, (latencies - begun).tolist(), strict=True))
            progress(Step(Stage.RELINEARISATION, steps_made, values=_by_channel(entries, latencies)))
            now = Linearisation.of(with_effects.without_latencies(further), present.floor.without_draws())
            assert list(now.latency_tolerances) == entries
        return remaining_latencies(now, latencies / tolerances) * tolerances

    screening_rule = first.latency_rule(
        SELECTION.most_relinearisations, SELECTION.most_phase_of_step, SELECTION.settled_phase, largest_phase
    )
    latencies = screening_rule.relinearised(step_at, begun).values
    if now is begin:
        return present
    refittable = now.runs.refittable
    assert refittable is not None
    fitted = first.refitted_to(refittable)
    progress(Step(Stage.FLOOR_AT_LATENCIES, values=_by_channel(entries, latencies)))
    removed = dict(zip(entries, latencies.tolist(), strict=True))
    return replace(Linearisation.of(fitted, present.floor.redrawn(fitted)), latencies=removed)


def _by_channel(entries: Sequence[SheetEntry], latencies: Array) -> dict[str, float]:
    return {channel: seconds for (_, channel, _), seconds in zip(entries, latencies.tolist(), strict=True)}


def relinearised_tests(
    first: ScoreTests, candidates: Sequence[Effect], seed: int, progress: Progress = silent
) -> ScoreTests:
    """Score tests of `candidates` on the runs as recorded, or on the runs re-linearised where instruments are late.

    Late are those of which one latency stays far off with all effects in the model that are selected beside it.
    """
    recorded = first.linearisation
    tolerances = np.array(list(recorded.latency_tolerances.values()))

    def far(latencies: Array) -> bool:
        return bool(np.any(np.abs(recorded.omega * latencies * tolerances) >= SELECTION.first_order_phase))

    if recorded.runs.refittable is None or not far(remaining_latencies(recorded, np.zeros(len(tolerances)))):
        return first
    progress(Step(Stage.SCORE_TESTS))
    found = search(first, first.family_wise(first.try_all()), progress=progress)
    late = [effect.key for effect in found.effects if effect.sheet_kind == "latency"]
    if not far(latencies_beside(found.space.releasing(late))):
        return first
    laws = [effect for effect in found.effects if effect.as_physics is not None]
    closer = relinearise(recorded, progress, SELECTION.first_order_phase, laws)
    return first if closer is recorded else ScoreTests.of(closer, candidates, seed, progress=progress)


def latencies_beside(space: ScoreTests) -> Array:
    """(l,) latencies in tolerances, estimated beside the effects that are in the model of score tests."""
    layout, known = space.layout, space.regression
    found = dict(zip(known.nuisance.tolist(), known.gain[:, layout.right].tolist(), strict=True))
    entries = space.linearisation.latency_tolerances
    return np.array([found.get(layout.model + layout.sheet.index(entry), 0.0) for entry in entries])
