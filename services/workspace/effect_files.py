"""Folder of a user's own effects: its Python files, and the file of its one-line effects."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from lacet.daq.errors import UsageError
from lacet.identify.effects.base import Effect
from lacet.identify.effects.catalogue import classes_of, effect_classes
from lacet.identify.effects.language.compiled import OneLine, effect_class
from lacet.identify.effects.language.parser import LineFault, read_lines
from lacet.identify.effects.user_files import OWN_MODULES, check_imports

LINES = "lines.txt"
"""Name of the file of one-line effects in a user's folder."""


def own_classes(folder: Path) -> list[type[Effect]]:
    """The effect classes of a folder: those of its Python files by file name, one-line effects last.

    Raises UsageError when a file cannot be loaded or used, or two effects share a name, those of lacet included.
    """
    modules = [load_file(file) for file in sorted(folder.glob("*.py"))]
    out = [cls for module in modules for cls in classes_of(module)]
    names = set(effect_classes(out))
    for cls in line_effects(folder):
        if cls.name in names:
            raise UsageError(f"{folder / LINES}: there is another effect '{cls.name}': give this one another name")
        names.add(cls.name)
        out.append(cls)
    return out


def line_effects(folder: Path) -> list[type[OneLine]]:
    """The one-line effects of a folder. Raises UsageError with the line at fault."""
    file = folder / LINES
    if not file.is_file():
        return []
    try:
        return [effect_class(line) for line in read_lines(file.read_text(encoding="utf-8"), str(file))]
    except (LineFault, UnicodeDecodeError, OSError) as cause:
        raise UsageError(f"{file}: {cause}") from None


def load_file(file: Path) -> ModuleType:
    """A user's file as a module. Raises UsageError when it cannot be loaded."""
    try:
        text = file.read_text(encoding="utf-8")
        check_imports(text, str(file))
    except (UnicodeDecodeError, OSError) as cause:
        raise UsageError(f"{file}: {cause}") from None
    name = f"{OWN_MODULES}{file.stem}"
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # data classes find their module there
    try:
        # The text itself: bytecode kept from before would hide an edit within the same second that keeps the size.
        exec(compile(text, str(file), "exec"), module.__dict__)
    except Exception as cause:  # every exception of a user's file is reported with its place
        del sys.modules[name]
        raise UsageError(f"{file}: cannot be loaded: {type(cause).__name__}: {cause}") from cause
    return module
