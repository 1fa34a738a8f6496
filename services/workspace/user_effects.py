"""One-line effects of a study: the file that holds them, and its changes."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from lacet.daq.errors import UsageError, nearest
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.catalogue import effect_classes
from lacet.identify.effects.excluded import EXCLUDED_NAMES
from lacet.identify.effects.language.compiled import OneLine, effect_class
from lacet.identify.effects.language.parser import read_line
from lacet.identify.effects.user_files import is_own
from lacet.services.workspace.effect_files import LINES, line_effects
from lacet.services.workspace.effect_files import own_classes as classes_in
from lacet.services.workspace.study import Study

_HEAD = """\
# The study's own effects, one a line: NAME = WHERE: LAW, constants and bounds
# lacet effect --states lists what a law may use; lacet effect --help explains
"""


def own_folder(study: Study) -> Path:
    """Folder of a study's own effects."""
    return study.folder / "effects"


def own_lines(study: Study) -> list[type[OneLine]]:
    """The one-line effects of a study. Raises UsageError with the line at fault."""
    return line_effects(own_folder(study))


def own_classes(study: Study) -> dict[str, list[str]]:
    """Names of a study's effects that are Python files, by file."""
    out: dict[str, list[str]] = {}
    for name, cls in effect_classes(classes_in(own_folder(study))).items():
        if is_own(cls):
            out.setdefault(cls.__module__.rpartition(".")[2] + ".py", []).append(name)
    return out


def with_name(text: str, study: Study | None = None) -> tuple[type[OneLine], str]:
    """The effect of a line, and the line as it is stored: one without a name gets the first free ``own1``, ``own2`` ….

    Raises LineFault where it cannot be read.
    """
    line = read_line(text)
    if line.name:
        return effect_class(line), text.strip()
    taken = {cls.name for cls in own_lines(study)} | _in_versions(study) if study else set[str]()
    name = next(f"own{k}" for k in range(1, len(taken) + 2) if f"own{k}" not in taken)
    return with_name(f"{name} = {text.strip()}")


def line_result(cls: type[OneLine], vehicle: Vehicle, reference: str) -> dict[str, Any]:
    """The interpretation of a line as plain data (``docs/json.md``, ``effect``)."""
    line, effects = cls.line, cls.variants(vehicle, reference)
    return {
        "effect": cls.name,
        "about": cls.about,
        "rows": [{"row": law.named, "unit": law.dimension.unit, "law": law.text} for law in line.rows],
        "variants": [e.key for e in effects],
        "parameters": [
            {"name": p.name.rpartition(".")[2], "unit": p.unit, "low": p.low, "high": p.high}
            for p in effects[0].parameters
        ],
        "constants": [{"name": n, "unit": line.constants[n].unit, "values": v} for n, v in line.grids.items()],
        "states": [{"name": n, "unit": use.state.unit} for n, use in line.states.items()],
    }


def may_have(study: Study, cls: type[OneLine]) -> bool:
    """Whether the study has an effect of this name, a line that can be replaced.

    Raises UsageError when another effect has the name, or a version of the study has the effect with another law: a
    version must not change afterwards.
    """
    own = {one.name: one for one in own_lines(study)}
    if cls.name not in own:
        if cls.name in effect_classes(classes_in(own_folder(study))) or cls.name in EXCLUDED_NAMES:
            raise UsageError(f"there is another effect '{cls.name}' already: give this one another name")
        return False
    if _same(own[cls.name].line.text) != _same(cls.line.text) and cls.name in _in_versions(study):
        raise UsageError(
            f"'{cls.name}' with its present law is in a version of the study, which must stay what it is: give the new "
            "law another name"
        )
    return True


def put(study: Study, cls: type[OneLine], text: str) -> bool:
    """Store a line in the study; True when it replaces one of the same name. Raises as `may_have`."""
    there = may_have(study, cls)
    _write(study, [*(line for line in _stored(study) if _name_of(line) != cls.name), text])
    return there


def take_out(study: Study, name: str) -> None:
    """Remove a line. Raises UsageError when there is none of that name, or a version of the study has the effect."""
    names = [cls.name for cls in own_lines(study)]
    if name not in names:
        files = own_classes(study)
        where = next(
            (f" (it is in {own_folder(study) / f}: remove it there)" for f, n in files.items() if name in n), ""
        )
        raise UsageError(f"the study has no one-line effect '{name}'{where or nearest(name, names)}")
    if name in _in_versions(study):
        raise UsageError(f"'{name}' is in a version of the study, which could then not be opened: it stays")
    _write(study, [line for line in _stored(study) if _name_of(line) != name])


def _same(text: str) -> str:
    """A line without its spaces."""
    return " ".join(text.split())


def _in_versions(study: Study) -> set[str]:
    return {key.partition(".")[0] for version in study.versions() for key in version.effects}


def _stored(study: Study) -> list[str]:
    file = own_folder(study) / LINES
    text = file.read_text(encoding="utf-8") if file.is_file() else _HEAD
    return text.splitlines()


def _name_of(line: str) -> str:
    found = re.match(r"\s*(\w+)\s*=", line)
    return found[1] if found else ""


def _write(study: Study, lines: list[str]) -> None:
    file = own_folder(study) / LINES
    file.parent.mkdir(exist_ok=True)
    beside = file.with_suffix(".tmp")
    beside.write_text("\n".join(lines) + "\n", encoding="utf-8")
    beside.replace(file)  # complete or not at all
