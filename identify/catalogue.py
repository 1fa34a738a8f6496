"""Every effect there is, found by walking ``identify/effects`` and any folder a user names."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import pkgutil
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import ModuleType

from daq.errors import UsageError, nearest
from daq.vehicle import Vehicle
from identify import effects
from identify.effect import Effect


def effect_classes(folders: Iterable[Path] = ()) -> dict[str, type[Effect]]:
    """Every effect class by family name, in the order of files and of definitions in them.

    Raises UsageError when a user's file cannot be loaded or two effects share a name.
    """
    modules = [importlib.import_module(f"identify.effects.{m.name}") for m in pkgutil.iter_modules(effects.__path__)]
    modules += [_load(file) for folder in folders for file in sorted(folder.glob("*.py"))]
    out: dict[str, type[Effect]] = {}
    for module in modules:
        for cls in vars(module).values():
            if not (inspect.isclass(cls) and issubclass(cls, Effect) and cls.__module__ == module.__name__):
                continue
            if inspect.isabstract(cls) or not hasattr(cls, "name"):
                continue
            if cls.name in out and out[cls.name] is not cls:
                raise UsageError(
                    f"two effects are called '{cls.name}': {out[cls.name].__module__} and {cls.__module__}"
                )
            out[cls.name] = cls
    return out


def catalogue(
    vehicle: Vehicle, reference: str, folders: Iterable[Path] = (), runs: Sequence[str] = ()
) -> dict[str, Effect]:
    """Every effect that can act on this vehicle, by key (``family.where``), base model first.

    `runs` : names of the runs at hand, for what can change from one to the next (`Effect.for_runs`).
    """
    classes = effect_classes(folders).values()
    found = [one for cls in classes for one in (*cls.variants(vehicle, reference), *cls.for_runs(runs))]
    found.sort(key=lambda effect: (not effect.base, effect.name != "body"))
    return {effect.key: effect for effect in found}


def base_model(vehicle: Vehicle, reference: str) -> list[Effect]:
    """The model of the paper's table 2: rigid bodies, springs, dampers, offsets, tyre stiffness."""
    return [effect for effect in catalogue(vehicle, reference).values() if effect.base]


def find_effect(key: str, known: dict[str, Effect]) -> Effect:
    """An effect by its key. Raises UsageError with the nearest match."""
    if key not in known:
        raise UsageError(f"there is no effect '{key}'{nearest(key, known)} (lacet info --effects lists them)")
    return known[key]


def _load(file: Path) -> ModuleType:
    name = f"lacet_user_effects.{file.stem}"
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as cause:  # whatever a user's file raises is theirs to see, with its place
        raise UsageError(f"{file}: cannot be loaded: {type(cause).__name__}: {cause}") from cause
    return module
