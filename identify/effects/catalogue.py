"""Catalogue of effects: the classes of lacet's own modules, and users' classes."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Iterable, Sequence
from types import ModuleType

from lacet.daq.errors import UsageError, nearest
from lacet.daq.vehicle import Vehicle
from lacet.identify import effects
from lacet.identify.effects import excluded
from lacet.identify.effects.base import Effect
from lacet.identify.effects.excluded import EXCLUDED_NAMES
from lacet.identify.effects.user_files import own_variants, vetted


def effect_classes(own: Iterable[type[Effect]] = ()) -> dict[str, type[Effect]]:
    """Every effect class by family name, in the order of files and of definitions in them; the user's `own` last.

    Raises UsageError when two effects share a name.
    """
    modules = [importlib.import_module(name) for name in sorted(_files(), key=lambda name: name.rpartition(".")[2])]
    out: dict[str, type[Effect]] = {}
    for cls in [*(cls for module in modules for cls in classes_of(module)), *own]:
        others = {name: one.__module__ for name, one in out.items() if one is not cls}
        if other := ({**dict.fromkeys(EXCLUDED_NAMES, excluded.__name__), **others}).get(cls.name):
            raise UsageError(f"two effects are called '{cls.name}': {other} and {cls.__module__}")
        out[cls.name] = cls
    return out


def classes_of(module: ModuleType) -> list[type[Effect]]:
    """The effect classes that a module defines, in order. Raises UsageError where a user's class is incomplete."""
    out: list[type[Effect]] = []
    for cls in vars(module).values():
        if inspect.isclass(cls) and issubclass(cls, Effect) and cls.__module__ == module.__name__:
            vetted(cls)
            if not inspect.isabstract(cls) and hasattr(cls, "name"):
                out.append(cls)
    return out


def _files() -> list[str]:
    """Modules of lacet's own effects, in one folder a family."""
    families = (one.name for one in pkgutil.iter_modules(effects.__path__) if one.ispkg and one.name != "language")
    packages = [importlib.import_module(f"{effects.__name__}.{family}") for family in families]
    return [f"{package.__name__}.{m.name}" for package in packages for m in pkgutil.iter_modules(package.__path__)]


def catalogue(
    vehicle: Vehicle, reference: str, own: Iterable[type[Effect]] = (), runs: Sequence[str] = ()
) -> dict[str, Effect]:
    """Every effect that can act on a vehicle, by key (``family.where``), base model first.

    `own` : a user's effect classes. `runs` : names of the runs, for effects that differ from run to run
    (`Effect.for_runs`).
    """
    classes = effect_classes(own).values()
    found = [one for cls in classes for one in own_variants(cls, vehicle, reference, runs)]
    found.sort(key=lambda effect: (not effect.base, effect.name != "body"))
    return {effect.key: effect for effect in found}


def base_model(vehicle: Vehicle, reference: str) -> list[Effect]:
    """Effects of the base model, the paper's table 2: rigid bodies, springs, dampers, offsets, tyre stiffness."""
    return [effect for effect in catalogue(vehicle, reference).values() if effect.base]


def find_effect(key: str, known: dict[str, Effect]) -> Effect:
    """An effect by its key. Raises UsageError with the nearest match."""
    if key not in known:
        raise UsageError(f"there is no effect '{key}'{nearest(key, known)} (lacet info --effects lists them)")
    return known[key]
