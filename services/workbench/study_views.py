"""Views of the study for the page, as plain data and arrays: versions, series, the residual map, the car."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from lacet.daq.channels import CHANNELS, CORNERS
from lacet.daq.formats.result import plain
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.rows import ROWS, Row
from lacet.identify.effects.catalogue import effect_classes
from lacet.identify.validation.residual_map import BIN, residual_map
from lacet.identify.validation.score import FAILS, Comparison, pooled_ratio
from lacet.services.render.effect_text import effect_label
from lacet.services.render.implausible_values import implausible_text
from lacet.services.render.known_scale import weak_scale
from lacet.services.render.little_shown import little_shown_lines
from lacet.services.render.row_sources import sources_tables
from lacet.services.render.rows import ERROR_MEANINGS, error_summary, row_label, said_of_runs, with_verdict
from lacet.services.render.units import unit_text
from lacet.services.render.value_names import parameter_name, summed
from lacet.services.render.verdict_card import manoeuvre, verdict_card
from lacet.services.workbench.packed_arrays import packed
from lacet.services.workbench.refusals import NotThere
from lacet.services.workbench.session_cache import Compared, SessionCache
from lacet.services.workbench.value_views import beside
from lacet.services.workspace.study import Study, Version

MOST_CELLS = 1200
"""Largest number of cells of the residual map along one run."""


def study_payload(cache: SessionCache, busy: dict[str, Any] | None) -> dict[str, Any]:
    """The study, its versions and the present one's diagnosis; a few entries while there is no study yet."""
    folder = cache.folder
    head = {
        "folder": str(folder.resolve()), "name": folder.resolve().name, "exists": cache.exists, "busy": busy,
        "other_writer": (folder / ".writing").exists() and (busy is None),
    }  # fmt: skip
    vehicle, rig = folder / "vehicle.toml", folder / "rig.toml"
    head |= {"fails_above": FAILS, "row_labels": {row: row_label(row) for row in ROWS}, "meanings": ERROR_MEANINGS}
    head["vehicle"] = Vehicle.load(vehicle).name if vehicle.is_file() else None
    sensors = Rig.load(rig, kept=True) if rig.is_file() else None
    head |= {"rig": sensors.name if sensors else None, "reference": sensors.wheel_reference if sensors else None}
    if not cache.exists:
        none: dict[str, Any] = {"used": [], "held": [], "current": 0, "draws": None, "versions": [], "diagnosis": None,
                                "card": None}  # fmt: skip
        return {**head, **none, "warnings": []}
    study = cache.study
    versions = study.versions()
    present = next((v for v in versions if v.number == study.current), None)
    return plain(
        {
            **head,
            "used": study.used,
            "held": study.held,
            "current": study.current,
            "draws": study.draws,
            "reference": present.result["wheel_reference"] if present else head["reference"],
            "versions": [version_payload(study, v) for v in versions],
            **ranking_payload(study),
            "warnings": said_of_runs(present.result) if present else [],
        }
    )


def ranking_payload(study: Study) -> dict[str, Any]:
    """The present version's `diagnosis` and verdict `card`; both None before it is ranked.

    Each candidate also has its `label` in words, the `unit` of its gain and the manoeuvre that it is `shown_by`.
    """
    found = study.diagnosis()
    if found is None:
        return {"diagnosis": None, "card": None}
    effects = study.effects(str(study.version().result["wheel_reference"]))
    candidates = [
        {
            **c,
            "label": effect_label(c["effect"]),
            "unit": Row.parse(c["rows"][0]).unit if c["rows"] else "",
            "shown_by": manoeuvre(effects[c["effect"]]) if c["effect"] in effects else "",
        }
        for c in found["candidates"]
    ]
    return {"diagnosis": {**found, "candidates": candidates}, "card": verdict_card(found, effects)}


def colour_places(study: Study) -> dict[str, int]:
    """Family of effects → its place among the colours of a chart, the same in every version and after every start.

    Those of the base model come first, then the others in the order in which they were first added.
    """
    families = [name for name, cls in effect_classes().items() if cls.base]
    families += [key.split(".")[0] for version in study.versions() for key in version.effects]
    return {family: place for place, family in enumerate(dict.fromkeys(families))}


def version_payload(study: Study, version: Version) -> dict[str, Any]:
    """A version with its errors; `runs_differ` : whether they are of other runs than the study's present ones."""
    rows = version.result["rows"]
    shown = {
        kind: {run: {row: with_verdict(score) for row, score in part.items()} for run, part in runs.items()}
        for kind, runs in rows.items()
    }
    used, held = study.runs_of(version)
    return {
        "version": version.number, "parent": version.parent, "note": version.note, "effects": version.effects,
        "used_error": pooled_ratio(rows["used"]), "held_error": pooled_ratio(rows["held"]), "rows": shown,
        "errors": error_summary(rows["used"], rows["held"]), "used": used,
        "held": held, "runs_differ": (set(used), set(held)) != (set(study.used), set(study.held)),
        "not_judged": version.result.get("not_judged", []),
        "doubts": [
            *little_shown_lines(version.result),
            *filter(None, (implausible_text(version.result), weak_scale(version.result))),
        ],
        "row_sources": sources_tables(version.result.get("row_sources", [])),
    }  # fmt: skip


def measured_row(part: Comparison, text: str) -> Row:
    """A row of a compared run by its text. Raises NotThere where the run has no such row."""
    if text not in part.measured:
        raise NotThere(f"run {part.name} has no row {text}: {', '.join(part.measured)}")
    return Row.parse(text)


def series_body(found: Compared, run: str, text: str, colours: Mapping[str, int]) -> bytes:
    """Measured and modelled row, named by its `text`, and each effect's contribution; `colours` as `colour_places`."""
    part, shares = found.part(run)
    row = measured_row(part, text)
    score = part.scores[row]
    arrays = {"t": part.t[row], "measured": part.measured[row], "modelled": part.modelled[row]}
    arrays |= {f"effect:{key}": series for key, series in shares.effects[row].items()}
    arrays["zeros"] = shares.zeros[row]
    return packed(
        arrays, version=found.version.number, run=run, row=row, unit=score.unit, floor=score.floor, used=part.used,
        rms=score.rms, ratio=score.ratio, labels={key: effect_label(key) for key in shares.effects[row]},
        colours={key: colours.get(key.split(".")[0], len(colours)) for key in shares.effects[row]},
    )  # fmt: skip


def map_payload(found: Compared) -> dict[str, Any]:
    """Residual RMS ÷ floor, row × time, of every run; null where a row has no sample."""
    longest = max(float(t[-1] - t[0]) for part in found.parts for t in part.t.values())
    cell = BIN * max(1, math.ceil(longest / (BIN * MOST_CELLS)))
    runs: list[dict[str, Any]] = []
    for part, phases in zip(found.parts, found.phases, strict=True):
        one = residual_map(part, cell)
        runs.append(
            {
                "name": part.name, "used": part.used, "t0": float(one.edges[0]), "cells": one.edges.size - 1,
                "rows": {row: [None if not np.isfinite(x) else round(float(x), 4) for x in line]
                         for row, line in zip(one.rows, one.ratio, strict=True)},
                "phases": [{"phase": i.phase, "start": i.start, "stop": i.stop} for i in phases.intervals],
            }
        )  # fmt: skip
    rows = [row for row in ROWS if any(row in run["rows"] for run in runs)]
    return plain({"version": found.version.number, "cell": cell, "rows": rows, "runs": runs})


def car_payload(vehicle: Vehicle, rig: Rig) -> dict[str, Any]:
    """The car in plan view: corners, sensors and the place of each row of the equations; body axes [m]."""
    corners = vehicle.corners
    front, rear = ("fl", "fr"), ("rl", "rr")
    x = {name: corner.position[0] for name, corner in corners.items()}
    y = {name: corner.position[1] for name, corner in corners.items()}
    sensors: list[dict[str, Any]] = []
    for sensor in rig.sensors:
        for channel in sensor.channels:
            about = CHANNELS[channel]
            place = next((part for part in channel.split(".") if part in CORNERS), "")
            at = sensor.position.get(place) or sensor.position.get("")
            if at is None and place:
                own = corners[place].position
                offset = sensor.from_wheel_centre or (0.0, 0.0, 0.0)
                at = tuple(a + b for a, b in zip(own, offset, strict=True))
            where = {axis: float(value) for axis, value in zip("xyz", at or (), strict=False)}
            sensors.append(
                {"channel": channel, "sensor": sensor.name, "corner": place or None, "unit": about.unit,
                 "about": about.about, "latency": sensor.latency, "placed": bool(at),
                 **{axis: where.get(axis, 0.0) for axis in "xyz"}}
            )  # fmt: skip
    return plain(
        {
            "wheelbase": float(np.mean([x[f] - x[r] for f, r in zip(front, rear, strict=True)])),
            "track": {"front": y["fl"] - y["fr"], "rear": y["rl"] - y["rr"]},
            "corners": {
                name: {"x": x[name], "y": y[name], "radius": corner.tyre_radius, "driven": corner.driven}
                for name, corner in corners.items()
            },
            "sensors": sensors,
            "rows": [{"row": row, "unit": row.unit, "place": row.corner or "chassis"} for row in ROWS],
        }
    )


def parameters_payload(study: Study, number: int | None) -> dict[str, Any]:
    """A version's parameters with their a-priori values and those of earlier versions."""
    version = study.version(number)
    apriori = study.vehicle.apriori
    earlier = [(v.number, {p["name"]: p for p in v.result["parameters"]}) for v in ancestors(study, version)[:-1]]
    return plain(
        {
            "version": version.number,
            "parameters": [
                {
                    **p,
                    "label": parameter_name(p["name"], p["effect"])[0],
                    "sum": summed(p, version.effects),
                    "unit": unit_text(p["unit"]),
                    "apriori": apriori[p["name"]].value if p["name"] in apriori else None,
                    "apriori_source": apriori[p["name"]].source if p["name"] in apriori else None,
                    "before": [{"version": number, **beside(p, there.get(p["name"]))} for number, there in earlier],
                }
                for p in version.result["parameters"]
            ],
            "not_identifiable": version.result["not_identifiable"],
            "derived": version.result.get("derived", []),
            "whole_vehicle": version.result.get("whole_vehicle"),
            "damper_curves": version.result.get("damper_curves", {}),
        }
    )


def ancestors(study: Study, version: Version) -> list[Version]:
    """The versions that a version was made from, in order, itself last."""
    by_number = {v.number: v for v in study.versions()}
    out = [version]
    while (parent := by_number.get(out[0].parent)) is not None and parent.number < out[0].number:
        out.insert(0, parent)
    return out
