"""Python, the packages lacet stands on, and its optional parts: are they here, in versions that lacet takes?"""

from __future__ import annotations

import platform
import sys
from importlib import metadata

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from lacet.daq.parts import PARTS, absent, install_command
from lacet.services.machine.finding import Finding, State

TRIED = ("3.11", "3.12", "3.13", "3.14")
"""Python versions with which lacet has decoded and fitted a run (docs/install.md)."""


def python() -> Finding:
    """The interpreter: its version, and whether lacet has been tried with it."""
    version, says = platform.python_version(), f"{platform.python_version()} at {sys.executable}"
    if sys.maxsize < 2**32:
        return Finding("Python", State.WARNING, f"{says} has 32 bits", "use a 64-bit Python: packages have no others")
    if version.rpartition(".")[0] in TRIED:
        return Finding("Python", State.OK, says)
    return Finding("Python", State.WARNING, f"{says}: lacet was not tried with it", f"tried: {', '.join(TRIED)}")


def packages() -> list[Finding]:
    """lacet itself, what it always needs in one finding, and each optional part."""
    try:
        itself = metadata.distribution("lacet")
    except metadata.PackageNotFoundError:
        says = "runs from a folder and is not installed: versions of packages are not checked"
        return [Finding("lacet", State.WARNING, says, "pip install . in the folder of lacet"), *_parts([])]
    wanted = [Requirement(text) for text in itself.requires or []]
    always = [one for one in wanted if one.marker is None or one.marker.evaluate({"extra": ""})]
    faults = [fault for one in always if (fault := _fault(one))]
    found = (
        Finding("packages", State.WARNING, "; ".join(faults), "pip install --upgrade lacet, or make demo in a clone")
        if faults
        else Finding("packages", State.OK, f"all {len(always)} that lacet needs")
    )
    return [Finding("lacet", State.OK, itself.version), found, *_parts(wanted)]


def versions() -> dict[str, str]:
    """Name and version of each package that is here of those lacet asks for, optional parts included."""
    try:
        wanted = [Requirement(text).name for text in metadata.distribution("lacet").requires or []]
    except metadata.PackageNotFoundError:
        return {}
    out: dict[str, str] = {}
    for name in sorted(set(wanted)):
        try:
            out[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return out


def _parts(wanted: list[Requirement]) -> list[Finding]:
    """The optional parts; `wanted` : the requirements of lacet, which hold the versions."""
    out: list[Finding] = []
    for name, part in PARTS.items():
        if lacking := absent(name):
            says = f"not installed ({', '.join(lacking)}): {part.brings}"
            out.append(Finding(f"part {name}", State.ABSENT, says, install_command(name)))
            continue
        own = [one for one in wanted if one.marker and one.marker.evaluate({"extra": name}) and one.name != "lacet"]
        faults = [fault for one in own if (fault := _fault(one))]
        if faults:
            found = Finding(f"part {name}", State.WARNING, "; ".join(faults), f"{install_command(name)} --upgrade")
        else:
            found = Finding(f"part {name}", State.OK, part.brings)
        out.append(found)
    return out


def _fault(wanted: Requirement) -> str:
    """What is wrong with a package, in words; empty where it is as asked for."""
    try:
        version = metadata.version(wanted.name)
    except metadata.PackageNotFoundError:
        return f"{wanted.name} is not installed"
    if not wanted.specifier.contains(version, prereleases=True):
        return f"{wanted.name} is {version}, wanted is {SpecifierSet(str(wanted.specifier))}"
    return ""
