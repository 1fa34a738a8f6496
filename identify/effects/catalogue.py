"""The catalogue of effects: those of the families' folders, and those of any folder that a user names."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Iterable, Sequence
from pathlib import Path

from lacet.daq.errors import UsageError, nearest
from lacet.daq.vehicle import Vehicle
from lacet.identify import effects
from lacet.identify.effects.base import Effect
from lacet.identify.effects.language.compiled import OneLine, effect_class
from lacet.identify.effects.language.parser import LineFault, read_lines
from lacet.identify.effects.user_files import load_own, own_variants, vetted

LINES = "lines.txt"
"""The file of one-line effects in a user's folder."""


def effect_classes(folders: Iterable[Path] = ()) -> dict[str, type[Effect]]:
    """Every effect class by family name, in the order of files and of definitions in them; one-line effects last.

    Raises UsageError when a user's file cannot be loaded or used, or two effects share a name.
    """
    folders = list(folders)
    modules = [importlib.import_module(name) for name in sorted(_files(), key=lambda name: name.rpartition(".")[2])]
    modules += [load_own(file) for folder in folders for file in sorted(folder.glob("*.py"))]
    out: dict[str, type[Effect]] = {}
    for module in modules:
        for cls in vars(module).values():
            if not (inspect.isclass(cls) and issubclass(cls, Effect) and cls.__module__ == module.__name__):
                continue
            vetted(cls)
            if inspect.isabstract(cls) or not hasattr(cls, "name"):
                continue
            if cls.name in out and out[cls.name] is not cls:
                raise UsageError(
                    f"two effects are called '{cls.name}': {out[cls.name].__module__} and {cls.__module__}"
                )
            out[cls.name] = cls
    for folder in folders:
        for cls in line_effects(folder):
            if cls.name in out:
                raise UsageError(f"{folder / LINES}: there is another effect '{cls.name}': give this one another name")
            out[cls.name] = cls
    return out


def _files() -> list[str]:
    """Modules of the effects that ship with lacet, one folder a family of them."""
    families = (one.name for one in pkgutil.iter_modules(effects.__path__) if one.ispkg and one.name != "language")
    packages = [importlib.import_module(f"{effects.__name__}.{family}") for family in families]
    return [f"{package.__name__}.{m.name}" for package in packages for m in pkgutil.iter_modules(package.__path__)]


def line_effects(folder: Path) -> list[type[OneLine]]:
    """The one-line effects of a user's folder. Raises UsageError with the line at fault."""
    file = folder / LINES
    if not file.is_file():
        return []
    try:
        return [effect_class(line) for line in read_lines(file.read_text(encoding="utf-8"), str(file))]
    except (LineFault, UnicodeDecodeError, OSError) as cause:
        raise UsageError(f"{file}: {cause}") from None


def catalogue(
    vehicle: Vehicle, reference: str, folders: Iterable[Path] = (), runs: Sequence[str] = ()
) -> dict[str, Effect]:
    """Every effect that can act on this vehicle, by key (``family.where``), base model first.

    `runs` : names of the runs at hand, for what can change from one to the next (`Effect.for_runs`).
    """
    classes = effect_classes(folders).values()
    found = [one for cls in classes for one in own_variants(cls, vehicle, reference, runs)]
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
