"""Drivers of the user's own: files in ``drivers/`` beside a rig file, run only after that folder was trusted.

They are looked for only beside a rig file that is named on the command line, never beside an upload, in a log or on the
bus. Which folders are trusted, with the digest of each file, is kept in the user's configuration folder.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType

from lacet.daq.errors import FileFault, LacetError, UsageError
from lacet.daq.rig import Rig
from lacet.drivers import driver_class, driver_names

FOLDER = "drivers"
FORMAT = "lacet-trust 1"
OPTION = "--trust"


@dataclass(frozen=True)
class OwnDrivers:
    """Drivers of the user's own that a rig names: classes by name, and the texts of their files, for the record."""

    classes: Mapping[str, type] = field(default_factory=dict)
    documents: Mapping[str, str] = field(default_factory=dict)


def own_drivers(rig: Rig, trust: bool = False) -> OwnDrivers:
    """The user's drivers that a rig file names, from the folder beside it; none where it names lacet's only.

    Parameters
    ----------
    trust : trust the folder as it is now, and remember that.

    Raises
    ------
    UsageError : the folder is not trusted, or has changed since; or a file defines no driver.
    """
    shipped = driver_names()
    folder = None if rig.folder is None else (rig.folder / FOLDER).resolve()
    named = sorted({sensor.driver for sensor in rig.sensors if sensor.driver is not None})
    if folder is None or not folder.is_dir():
        return OwnDrivers()
    if both := [name for name in named if name in shipped and (folder / f"{name}.py").is_file()]:
        raise UsageError(f"{folder / both[0]}.py: '{both[0]}' is a driver of lacet's; give yours another name")
    needed = [name for name in named if name not in shipped]
    if not needed:
        return OwnDrivers()
    # Read once: what is trusted is what is run.
    texts = {file.name: file.read_bytes() for file in sorted(folder.glob("*.py"))}
    digests = {name: hashlib.sha256(text).hexdigest() for name, text in texts.items()}
    if trust:
        _remember(folder, digests)
    else:
        _check(folder, digests)
    classes, documents = {}, {}
    for name in needed:
        if (text := texts.get(f"{name}.py")) is not None:  # else it is refused where drivers are opened
            classes[name] = _loaded(name, folder / f"{name}.py", text)
            documents[f"{FOLDER}/{name}.py"] = text.decode("utf-8", "replace")
    return OwnDrivers(classes, documents)


def trust_file() -> Path:
    """The file in which trusted folders are kept."""
    home = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(home) / "lacet" / "trusted-drivers.json"


def _trusted() -> dict[str, dict[str, str]]:
    file = trust_file()
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        if content["format"] != FORMAT:
            raise ValueError(f"its format is {content['format']!r}, not {FORMAT!r}")
        return {str(folder): dict(files) for folder, files in content["folders"].items()}
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, TypeError, LookupError, AttributeError) as error:
        raise FileFault(file, [f"no list of trusted folders as lacet writes it ({error}); remove it"]) from None


def _check(folder: Path, digests: Mapping[str, str]) -> None:
    before = _trusted().get(str(folder))
    if before == digests:
        return
    what = ", ".join(digests) or "no file"
    why = f"{folder} holds programs ({what}) that were not trusted yet"
    if before is not None:
        changed = [name for name in digests if name in before and before[name] != digests[name]]
        parts = [f"changed: {', '.join(changed)}"] if changed else []
        parts += [f"new: {', '.join(new)}"] if (new := [name for name in digests if name not in before]) else []
        parts += [f"gone: {', '.join(gone)}"] if (gone := [name for name in before if name not in digests]) else []
        why = f"{folder} is not as it was trusted ({'; '.join(parts)})"
    raise UsageError(
        f"{why}. A driver may do all that you may: read it, then give the same command with {OPTION}, once"
    )


def _remember(folder: Path, digests: Mapping[str, str]) -> None:
    file = trust_file()
    folders = {**_trusted(), str(folder): dict(digests)}
    file.parent.mkdir(parents=True, exist_ok=True)
    draft = file.with_name(f"{file.name}.{os.getpid()}")
    try:
        draft.write_text(json.dumps({"format": FORMAT, "folders": folders}, indent=2) + "\n", encoding="utf-8")
        os.replace(draft, file)
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)


def _loaded(name: str, file: Path, text: bytes) -> type:
    module = ModuleType(f"own_driver_{name}")
    module.__file__ = str(file)
    try:
        exec(compile(text, str(file), "exec", dont_inherit=True), module.__dict__)
    except SyntaxError as error:
        raise UsageError(f"{file}, line {error.lineno}: {error.msg}") from None
    except LacetError:
        raise
    except Exception as error:
        raise UsageError(f"{file}{_line(error, file)}: {type(error).__name__}: {error}") from None
    return driver_class(vars(module), module.__name__, name, str(file))


def _line(error: BaseException, file: Path) -> str:
    """The last line of a file that an error went through, ``, line 3``."""
    found, trace = "", error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == str(file):
            found = f", line {trace.tb_lineno}"
        trace = trace.tb_next
    return found
