"""Optional parts of lacet: extras of the package that record, decode and identify do not need."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from lacet.daq.errors import UsageError


@dataclass(frozen=True)
class Part:
    """An extra of pyproject.toml.

    Attributes
    ----------
    modules : names under which its packages are imported.
    brings : what is done with them.
    """

    modules: tuple[str, ...]
    brings: str


PARTS = {
    "plots": Part(("matplotlib",), "pictures and reports"),
    "ui": Part(("fastapi", "uvicorn", "matplotlib"), "the workbench (lacet ui)"),
    "logs": Part(
        ("asammdf", "h5py", "nptdms", "mcap_protobuf", "mcap_ros2"),
        "logs of other systems: MDF, MATLAB 7.3, TDMS, MCAP of ROS 2 and Protobuf",
    ),
    "sim": Part(("mujoco",), "the simulated car (lacet simulate, bench --car, plan, diagnose --next, paper)"),
    "consistency": Part(("cvxpy", "clarabel"), "the nearest bodies that can exist (identify --consistent)"),
    "foxglove": Part(("foxglove",), "the recording live in Foxglove (lacet foxglove)"),
    "campaign": Part(("dask", "distributed", "bokeh"), "one fit over many runs (lacet campaign)"),
}
"""Extra → what it brings; a test holds the names and packages to pyproject.toml."""

EVERYTHING = "all"
"""The extra that brings all of them."""


class MissingPart(UsageError):
    """An optional part that is asked for and not installed; the message has the command that installs it."""


def install_command(part: str) -> str:
    """The command that installs an extra into this lacet's environment, whichever `pip` the shell has."""
    here, found = Path(sys.executable), shutil.which("pip")
    pip = "pip" if found is not None and Path(found).parent == here.parent else f"{here} -m pip"
    return f"{pip} install 'lacet[{part}]'"


def absent(part: str) -> list[str]:
    """The modules of an extra that are not installed; none of them is imported."""
    return [name for name in PARTS[part].modules if find_spec(name) is None]


def require(part: str, instead: str = "") -> None:
    """Raise MissingPart where an extra is not installed in full, before work is begun that needs it.

    `instead` : a way without it, as the end of a sentence.
    """
    if names := absent(part):
        raise _missing(part, f"{', '.join(names)} {'is' if len(names) == 1 else 'are'} not installed", instead)


@contextmanager
def from_part(part: str) -> Iterator[None]:
    """Context of the imports from an extra. Raises MissingPart where one of them fails, with the reason."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise _missing(part, f"{error.name} is not installed") from None
    except ImportError as error:
        raise _missing(part, f"a package of it cannot be loaded ({error})") from None


def _missing(part: str, why: str, instead: str = "") -> MissingPart:
    way_out = f"; or {instead}" if instead else ""
    return MissingPart(f"{why}. For {PARTS[part].brings}: {install_command(part)}{way_out}")
