"""Results as plain data, as commands write them in JSON and the workbench sends them (``docs/json.md``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from lacet.daq.formats.result import plain
from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect
from lacet.identify.multibody.vectors import Array
from lacet.identify.properties.consistent_fit import Consistency, ConsistentFit
from lacet.identify.properties.derived import damper_curves, derived_values, ranges
from lacet.identify.properties.known_scale import known_scale
from lacet.identify.properties.sums_of_places import SumOfPlaces
from lacet.identify.properties.whole_vehicle import NAMES, UNITS, WholeVehicle, whole_vehicle
from lacet.identify.regression.sums.linear_fit import FittedModel
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.candidate import Candidate
from lacet.identify.selection.diagnosis import Diagnosis
from lacet.identify.validation.implausible_values import implausible_values
from lacet.identify.validation.little_shown import little_shown
from lacet.identify.validation.parameter_estimates import Estimate, estimates
from lacet.identify.validation.prediction_uncertainty import Knowledge
from lacet.identify.validation.row_sources import row_sources
from lacet.identify.validation.score import Comparison, RowScore, pooled_ratio, row_ratios
from lacet.identify.validation.tyre_differences import tyre_difference
from lacet.services.render.candidate_reasons import open_because, short_reason, why
from lacet.services.render.consistency_report import body_fault_words, consistency_words
from lacet.services.render.identifiability import not_derived, open_parameters, rows_not_judged, unidentified
from lacet.services.render.implausible_values import implausible_result
from lacet.services.render.known_scale import scale_result
from lacet.services.render.little_shown import little_shown_result
from lacet.services.render.row_sources import sources_result
from lacet.services.render.rows import colour_words, row_absence
from lacet.services.render.tyre_differences import difference_result
from lacet.services.render.verdicts import says
from lacet.services.workspace.loading import Loaded
from lacet.services.workspace.study import Study

HELPS = 0.02
"""Part by which the error ÷ floor of a row must fall for an effect to help it [share]. A parameter that stands for
nothing takes off about one of the 30 stretches of two seconds of a minute: a sixtieth of the RMS."""


def fit_result(
    fitted: Fit, loaded: Loaded, used: Sequence[Comparison], held: Sequence[Comparison] = (),
    knowledge: Knowledge | None = None, drawn: Array | None = None,
) -> dict[str, Any]:  # fmt: skip
    """A fit as plain data (``docs/json.md``, ``identify``); `drawn` as `Fit.bootstrap` gives it."""
    knowledge = knowledge or Knowledge.of(fitted)
    found = estimates(fitted, drawn, fitted.runs)
    whole = whole_vehicle(fitted, loaded.vehicle, fitted.runs)
    left_out: dict[str, str] = {}
    for run in fitted.runs:
        left_out |= {f"{run.name}: {row}": row_absence(why) for row, why in run.measured_rows.left_out.items()}
    return plain(
        {
            "vehicle": loaded.vehicle.name,
            "rig": loaded.rig.name,
            "wheel_reference": loaded.reference,
            **parameter_results(fitted, found, whole),
            "derived": [
                {
                    "name": d.name,
                    "value": d.value,
                    "unit": d.unit,
                    "half95": d.half,
                    "half95_sheet": d.half_sheet,
                    "identifiable": d.determined,
                    "why": not_derived(d.why),
                    "effects": list(d.effects),
                }
                for d in derived_values(fitted, loaded.vehicle, knowledge)
            ],
            "damper_curves": {
                corner: {
                    "travel": c.travel,
                    "rate": c.rate,
                    "force": c.force,
                    "half95": c.half,
                    "effects": list(c.effects),
                }
                for corner, c in damper_curves(fitted, knowledge).items()
            },
            "ranges": {r.name: {"low": r.low, "high": r.high, "unit": r.unit} for r in ranges(fitted)},
            "rows": {"used": scores(used), "held": scores(held)},
            "not_judged": [line for part in held for line in rows_not_judged(part)],
            "rows_left_out": left_out,
            "row_sources": sources_result(row_sources(fitted)),
            "known_scale": scale_result(known_scale(fitted, found)),
            "implausible": implausible_result(implausible_values(fitted, found)),
            "tyre_difference": difference_result(tyre_difference(fitted, used)),
            **little_shown_result(little_shown(fitted.runs, used)),
            "bad_seconds": [asdict(bad) for bad in fitted.bad_seconds()],
            "base_rank": fitted.base.rank,
            "singular_gap": fitted.base.gap,
            "warnings": list(loaded.warnings),
            "notes": list(loaded.notes),
        }
    )


def parameter_results(fitted: FittedModel, found: Sequence[Estimate], whole: WholeVehicle | None) -> dict[str, Any]:
    """The effects of a fitted model, its parameters and the whole vehicle's values as plain data."""
    return {
        "effects": [effect.key for effect in fitted.model.effects],
        "parameters": [
            {
                "name": e.name,
                "effect": e.effect,
                "value": e.value,
                "unit": e.unit,
                "interval95": [e.value - e.half, e.value + e.half],
                "half95": e.half,
                "half95_sheet": e.half_sheet,
                "half95_bootstrap": e.half_bootstrap,
                "sxr_percent": e.sxr,
                "group": e.group,
            }
            for e in found
            if e.identifiable
        ],
        "not_identifiable": [
            {"name": e.name, "effect": e.effect, "why": unidentified(e.why)} for e in found if not e.identifiable
        ],
        "whole_vehicle": None
        if whole is None
        else [
            {"name": n, "value": v, "unit": u, "half95": h, "half95_sheet": s, "identifiable": d}
            for n, v, u, h, s, d in zip(
                NAMES, whole.values, UNITS, whole.interval, whole.interval_sheet, whole.determined, strict=True
            )
        ],
    }


def open_sizes(before: Mapping[str, Any], diagnosis: Mapping[str, Any] | None) -> dict[str, Sequence[str]]:
    """Effect → axles that leave its size open, for versions made from one with result `before` and this diagnosis.

    What was open in that version stays so while its diagnosis, if there is one, names something unlisted.
    """
    found = diagnosis or {}
    out = dict(before.get("open_sizes", {})) if found.get("unlisted", True) else {}
    return out | {c["effect"]: c["open_at"] for c in found.get("candidates", ()) if c.get("open_at")}


def without_open_sizes(result: Mapping[str, Any], open_at: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    """A fit's result in which parameters of effects whose size is open are not identified, nor what follows from them.

    `open_at` : `open_sizes`, which the result keeps.
    """
    still = [p for p in result["parameters"] if p["effect"] not in open_at]
    unknown = [
        {"name": p["name"], "effect": p["effect"], "why": f"its size is {open_because(open_at[p['effect']])}"}
        for p in result["parameters"]
        if p["effect"] in open_at
    ]
    curves = {
        corner: curve
        for corner, curve in result["damper_curves"].items()
        if not any(key in open_at for key in curve["effects"])
    }
    return {
        **result, "parameters": still, "not_identifiable": [*result["not_identifiable"], *unknown],
        "derived": [_without_open_size(d, open_at) for d in result["derived"]], "damper_curves": curves,
        "open_sizes": {key: list(axles) for key, axles in open_at.items()},
    }  # fmt: skip


def _without_open_size(derived: Mapping[str, Any], open_at: Mapping[str, Sequence[str]]) -> Mapping[str, Any]:
    """A derived value, not determined where it depends on an effect whose size is open."""
    key = next((key for key in derived["effects"] if key in open_at), None)
    if key is None:
        return derived
    return {**derived, "identifiable": False, "why": f"the size of {key} is {open_because(open_at[key])}"}


def scores(comparisons: Sequence[Comparison]) -> dict[str, dict[str, Any]]:
    """Scores by run and row."""
    return {c.name: {row: score_result(score) for row, score in c.scores.items()} for c in comparisons}


def score_result(score: RowScore) -> dict[str, Any]:
    """A row's score as plain data."""
    return {**asdict(score), "colour": colour_words(score), "why": open_parameters(score.why)}


def candidate_result(d: Diagnosis, c: Candidate) -> dict[str, Any]:
    """A candidate of a diagnosis as plain data."""
    return {
        "effect": c.key,
        "answer": c.answer.value,
        "why": why(d, c),
        "short": short_reason(c),
        "gain": c.gain,
        "gain_rms": c.gain_rms,
        "p": c.p,
        "coverage": c.coverage,
        "size": c.size,
        "shape": dict(c.shape),
        "values": list(c.values),
        "half95": list(c.interval),
        "rows": list(c.rows),
        "drop": c.drop,
        "absorbed": [{"by": name, "share": share} for name, share in c.absorbed],
        "ties": [{"effect": key, "correlation": r} for key, r in c.ties],
        "confounded": [
            {"effect": one.key, "low": one.low, "high": one.high, "share": one.share} for one in c.confounded
        ],
        "open_at": list(c.open_at),
        "sum": None if c.total is None else sum_result(c.total),
        "stands_for": c.stands_for,
        "margin": c.margin,
        "rival": c.rival,
    }


def sum_result(total: SumOfPlaces) -> dict[str, Any]:
    """The sum of a law's sizes over places as plain data."""
    return {
        "effects": list(total.keys), "parameter": total.parameter, "unit": total.unit, "value": total.value,
        "half95_sheet": total.half,
    }  # fmt: skip


def diagnosis_result(d: Diagnosis) -> dict[str, Any]:
    """A diagnosis as plain data (``docs/json.md``, ``diagnose``)."""
    return plain(
        {
            "verdict": d.verdict.value,
            "says": says(d),
            "best": d.best.key if d.best else None,
            "found": [c.key for c in d.found],
            "unlisted": d.unlisted,
            "unlisted_rows": list(d.unlisted_rows),
            "small_rows": list(d.small_rows),
            "maybe": list(d.maybe),
            "candidates": [candidate_result(d, c) for c in d.candidates],
            "rows": dict(d.ratios),
            "tolerated": dict(d.grounds.ratios),
            "excess": d.excess,
            "explained": d.explained,
            "draws": d.draws,
            "louder": dict(d.noise_ratio),
            "failing": list(d.failing),
            "formulas": [asdict(formula) for formula in d.formulas],
            "described": list(d.described),
            "without_tables": list(d.without_tables.axles),
            "tables_unsure": list(d.without_tables.unsure),
            "tables_instead": list(d.instead_of_tables),
        }
    )


def change_result(
    key: str, effect: Effect | None, before: Mapping[str, Any], after: Mapping[str, Any]
) -> dict[str, Any]:
    """Error ÷ floor before and after an effect was added or removed, on the runs used and held out.

    `effect` : None where the study no longer has it. `row` : of the rows that it acts on the one that changed most,
    None without any; `helps` : whether the error of any row falls by `HELPS`.
    """
    was, now = row_ratios(before["used"]), row_ratios(after["used"])
    both = [row for row in was if row in now]
    helps = any(now[row] <= (1.0 - HELPS) * was[row] for row in both)
    own = [row for row in both if effect is None or effect.acts_on(Row.parse(row))]
    changed = max(own, key=lambda row: (was[row] ** 2 - now[row] ** 2) * (1 if helps else -1), default=None)
    row = None if changed is None else {"row": changed, "before": was[changed], "after": now[changed]}
    return {
        "effect": key,
        "row": row,
        "helps": helps,
        "used": {"before": pooled_ratio(before["used"]), "after": pooled_ratio(after["used"])},
        "held": {"before": pooled_ratio(before["held"]), "after": pooled_ratio(after["held"])},
        "rows": {"before": before, "after": after},
    }


def consistency_result(found: Consistency, mended: ConsistentFit) -> dict[str, Any]:
    """Physical consistency of a fit, and of the nearest consistent one, as plain data."""
    price = mended.price
    return plain(
        {
            "consistent": found.consistent,
            "says": consistency_words(found),
            "distance_sigma": found.distance,
            "p": found.p,
            "bodies": [
                {
                    "name": body.name,
                    "separable": body.separable,
                    "shared": list(body.shared),
                    "possible": body.possible if body.separable else None,
                    "fault": body_fault_words(body.fault) if body.separable else "",
                }
                for body in found.bodies
            ],
            "alone_sigma": dict(found.alone),
            "wrong_sign_sigma": dict(found.wrong_sign),
            "price": {
                "quadratic": price.quadratic,
                "residual_percent": price.percent,
                "rows_percent": dict(price.rows),
                "largest_change": {"name": price.largest[0], "sigma": price.largest[1]},
            },
        }
    )


def study_result(study: Study) -> dict[str, object]:
    """A study as plain data."""
    return {
        "folder": study.folder,
        "used": study.used,
        "held": study.held,
        "current": study.current,
        "versions": [
            {"version": v.number, "parent": v.parent, "note": v.note, "effects": v.effects, "rows": v.result["rows"]}
            for v in study.versions()
        ],
    }
