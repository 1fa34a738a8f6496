"""Results of a campaign as plain data (``docs/json.md``, ``campaign``)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from lacet.daq.formats.result import plain
from lacet.identify.properties.whole_vehicle import whole_vehicle
from lacet.identify.validation.parameter_estimates import estimates
from lacet.identify.validation.score import pooled_ratio, row_ratios
from lacet.services.campaign.cluster import Cluster
from lacet.services.campaign.fitting import CampaignFit
from lacet.services.campaign.ranking import DiagnosedFit
from lacet.services.workspace.results import diagnosis_result, parameter_results


def campaign_result(found: CampaignFit, cluster: Cluster, steps: Sequence[DiagnosedFit] = ()) -> dict[str, Any]:
    """A campaign's fit as plain data: what `lacet identify` says of the car, and of each run its scores.

    `steps` : what was found missing, fit by fit; `found` is the last of them.
    """
    campaign, fitted = found.campaign, found.fitted
    return plain(
        {
            "vehicle": campaign.vehicle.name,
            "rig": campaign.runs[0].rig_name,
            "wheel_reference": campaign.settings.wheel_reference,
            "seconds": campaign.seconds,
            **parameter_results(fitted, estimates(fitted), whole_vehicle(fitted, campaign.vehicle)),
            "base_rank": fitted.base.rank,
            "singular_gap": fitted.base.gap,
            "sigma": dict(fitted.sigma),
            "samples": dict(found.counts),
            "rows": {"used": found.scores},
            "row_ratios": row_ratios(found.scores),
            "overall": pooled_ratio(found.scores),
            "runs": [
                {"run": run.reference.name, "place": run.reference.place, "digest": run.reference.digest,
                 "seconds": run.seconds, "overall": pooled_ratio({"": found.scores[run.reference.name]})}
                for run in campaign.runs
            ],
            "doubtful": [run.reference.name for run in campaign.runs if not run.sound],
            "broken": dict(campaign.broken),
            "passes": cluster.passes,
            "passes_over_sums": cluster.sums,
            "workers_lost": cluster.deaths,
            "warnings": list(campaign.warnings),
            "diagnose": _diagnose_result(steps) if steps else None,
            "added": _added(steps),
        }
    )  # fmt: skip


def _diagnose_result(steps: Sequence[DiagnosedFit]) -> dict[str, Any]:
    """The last diagnosis, with all of them in `steps`."""
    each = [diagnosis_result(step.diagnosis) for step in steps]
    return {**each[-1], "steps": each}


def _added(steps: Sequence[DiagnosedFit]) -> list[str]:
    """Keys of the effects added on the way."""
    return [step.diagnosis.best.key for step in steps[:-1] if step.diagnosis.best is not None]
