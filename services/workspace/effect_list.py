"""The catalogue of effects as text and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from lacet.daq.errors import UsageError, nearest
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.base import Effect, Parameter, is_sensor_fault
from lacet.identify.effects.catalogue import catalogue, effect_classes
from lacet.identify.effects.excluded import EXCLUDED, ExcludedEffect
from lacet.services.workspace.study import Study

_MEASURED = "Already measured: cannot be missing here"
"""Heading of what the measurements hold."""
_RUN = "RUN"
"""Stands for any run in effects that go by runs."""


def list_effects(vehicle: Vehicle, reference: str, name: str = "") -> list[dict[str, Any]]:
    """Print every family of the catalogue, or the one that `name` is or belongs to; give them as JSON-able records.

    Raises UsageError when there is no such family or effect, with the nearest.
    """
    classes = effect_classes()
    found = list(catalogue(vehicle, reference, runs=(_RUN, "another")).values())
    found = [effect for effect in found if effect.where != "another"]
    measured = {one.name: one for one in EXCLUDED}
    if name and name not in classes and name not in measured:
        keys = {effect.key: effect.name for effect in found}
        family = keys.get(name) or next((f for f in classes if name.startswith(f"{f}.")), "")
        if not family or (name not in keys and not classes[family].for_runs(["a", "b"])):
            raise UsageError(f"there is no effect '{name}'{nearest(name, [*classes, *measured, *keys])}")
        name = family
    chosen = [family for family in classes if name in ("", family)]
    chosen.sort(key=lambda family: (not classes[family].base, is_sensor_fault(classes[family])))
    held = [one for one in EXCLUDED if name in ("", one.name)]
    heading = ""
    for family in chosen:
        title = _title(classes[family])
        if title != heading and not name:
            print(f"{title}\n{'-' * len(title)}")
            heading = title
        _print_family(classes[family], [e for e in found if e.name == family], reference)
    if held and not name:
        print(f"{_MEASURED}\n{'-' * len(_MEASURED)}")
    for one in held:
        print(f"{one.name}: {one.about}\n    why not: {one.measured_by}\n    source: {one.source}\n")
    return [_record(e) for e in found if e.name in chosen] + [_excluded_record(one) for one in held]


def effect_records(study: Study, reference: str) -> list[dict[str, Any]]:
    """The same records of every effect that a study knows, its own among them; nothing is printed."""
    return [_record(effect) for effect in study.effects(reference).values()]


def _title(family: type[Effect]) -> str:
    if family.base:
        return "Base model"
    return "Faults of the instruments" if is_sensor_fault(family) else "Effects that may be missing"


def _print_family(family: type[Effect], variants: Sequence[Effect], reference: str) -> None:
    print(f"{family.name}: {family.about}")
    if not variants:
        print(f"    where: nowhere with {reference} loads\n    source: {family.source}\n")
        return
    print(f"    where: {_places(variants) or 'the whole car'}")
    rows = family.rows or ("those its channels enter",)
    print(f"    rows: {', '.join(rows)}")
    for parameter in _parameters(variants):
        print(f"    parameter: {parameter}")
    for shape, values in family.grids.items():
        print(f"    tried: {shape} {', '.join(f'{value:g}' for value in values)} (SI)")
    if family.needs:
        print(f"    needs: {', '.join(family.needs)}")
    print(f"    seen as: {family.signature}\n    shown by: {family.shown_by}")
    if family.looks_like:
        print(f"    looks like: {', '.join(family.looks_like)}")
    print(f"    source: {family.source}\n")


def _places(variants: Sequence[Effect]) -> str:
    """Places with what they have in common said once: ``wheel.fl.force.x y z``."""
    groups: dict[str, list[str]] = {}
    for effect in variants:
        head, _, last = effect.where.rpartition(".")
        groups.setdefault(head, []).append(last)
    parts = [
        f"{head}.{{{', '.join(last)}}}" if head and len(last) > 1 else _joined(head, last)
        for head, last in groups.items()
    ]
    return ", ".join(part for part in parts if part)


def _joined(head: str, last: Sequence[str]) -> str:
    return ", ".join(f"{head}.{one}" if head else one for one in last)


def _parameters(variants: Sequence[Effect]) -> list[str]:
    """Each parameter once, with unit, plausible range and sign; those of bodies are listed by `lacet info --model`."""
    if variants[0].name == "body":
        return ["XX … M of every body (lacet info --model)"]
    out: dict[str, None] = {}
    for effect in variants:
        for parameter in effect.parameters:
            out[_parameter(effect, parameter)] = None
    return list(out)


def _parameter(effect: Effect, parameter: Parameter) -> str:
    sign = "" if parameter.expect == "any" else f", usually {parameter.expect}"
    short = parameter.name.removeprefix(f"{effect.key}.")
    return f"{short} [{parameter.unit}], {parameter.low:g} to {parameter.high:g}{sign}"


def _record(effect: Effect) -> dict[str, Any]:
    return {
        "effect": effect.key, "family": effect.name, "base": effect.base, "about": effect.about,
        "signature": effect.signature, "shown_by": effect.shown_by, "source": effect.source, "rows": effect.rows,
        "needs": effect.needs, "looks_like": effect.looks_like, "measured_by": "",
        "shape": {name: list(values) for name, values in effect.grids.items()},
        "parameters": [
            {"name": p.name, "unit": p.unit, "low": p.low, "high": p.high, "expect": p.expect}
            for p in effect.parameters
        ],
    }  # fmt: skip


def _excluded_record(one: ExcludedEffect) -> dict[str, Any]:
    return {
        "effect": one.name, "family": one.name, "base": False, "about": one.about, "signature": one.signature,
        "shown_by": one.shown_by, "source": one.source, "rows": (), "needs": (), "looks_like": (),
        "measured_by": one.measured_by, "shape": {}, "parameters": [],
    }  # fmt: skip
