"""Effects of the catalogue, all or one family, and their records as plain data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from lacet.daq.errors import UsageError, nearest
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.base import Effect, is_sensor_fault
from lacet.identify.effects.catalogue import catalogue, effect_classes
from lacet.identify.effects.excluded import EXCLUDED, ExcludedEffect
from lacet.services.workspace.study import Study

_RUN = "RUN"
"""Stands for any run in effects that go by runs."""


@dataclass(frozen=True)
class EffectList:
    """Effects of the catalogue on a vehicle.

    Attributes
    ----------
    families : base model first, sensor faults last.
    variants : of these families, in the catalogue's order; a family may have none on this vehicle.
    measured : what cannot be missing because it is measured.
    """

    families: tuple[type[Effect], ...]
    variants: tuple[Effect, ...]
    measured: tuple[ExcludedEffect, ...]

    @property
    def records(self) -> list[dict[str, Any]]:
        """Every variant, and what is measured, as plain data (``docs/json.md``, ``info``, `effects`)."""
        return [_record(e) for e in self.variants] + [_excluded_record(one) for one in self.measured]


def list_effects(vehicle: Vehicle, reference: str, name: str = "") -> EffectList:
    """Every family of the catalogue, or the one that `name` is or belongs to, for wheel loads in `reference`.

    Raises UsageError when there is no such family or effect, with the nearest.
    """
    classes = effect_classes()
    found = list(catalogue(vehicle, reference, runs=(_RUN, "another")).values())
    found = [effect for effect in found if effect.where != "another"]
    measured = {one.name: one for one in EXCLUDED}
    if name and name not in classes and name not in measured:
        keys = {effect.key: effect.name for effect in found}
        family = keys.get(name) or next((f for f in classes if name.startswith(f"{f}.")), "")
        if not family or (name not in keys and not classes[family].is_of_run()):
            raise UsageError(f"there is no effect '{name}'{nearest(name, [*classes, *measured, *keys])}")
        name = family
    chosen = [family for key, family in classes.items() if name in ("", key)]
    chosen.sort(key=lambda family: (not family.base, is_sensor_fault(family)))
    variants = tuple(effect for effect in found if name in ("", effect.name))
    return EffectList(tuple(chosen), variants, tuple(one for one in EXCLUDED if name in ("", one.name)))


def effect_records(study: Study, reference: str) -> list[dict[str, Any]]:
    """The same records of every effect that a study knows, its own among them."""
    return [_record(effect) for effect in study.effects(reference).values()]


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
