"""No circles: a shipped module never imports, by whatever way, a module that imports it.

The contracts of import-linter hold the rooms bottom to top; within a room nothing else holds modules in order. An
import inside a function or under TYPE_CHECKING only hides a circle, so they count here like any other.
"""

import ast
from collections.abc import Iterable
from pathlib import Path

import pytest

from tests.support.places import HOME

FOLDERS = ("daq", "drivers", "identify", "services", "simulate")


def modules() -> dict[str, Path]:
    """Dotted name and file of each shipped module."""
    files = [file for folder in FOLDERS for file in sorted((HOME / folder).rglob("*.py"))]
    names = {}
    for file in [*files, *sorted((HOME / "lacet").glob("*.py"))]:
        parts = file.relative_to(HOME).with_suffix("").parts
        parts = parts if parts[0] == "lacet" else ("lacet", *parts)
        names[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    return names


def imported(name: str, file: Path, known: Iterable[str]) -> set[str]:
    """The shipped modules that a module's text imports, wherever in it the import stands."""
    package = name if file.name == "__init__.py" else name.rpartition(".")[0]
    found: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = ".".join(package.split(".")[: len(package.split(".")) - node.level + 1]) if node.level else ""
            source = ".".join(part for part in (above, node.module) if part)
            for alias in node.names:
                inner = f"{source}.{alias.name}"
                found.add(inner if inner in known else source)
    return {other for other in found if other in known and other != name}


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Strongly connected components of more than one module (Tarjan 1972, without recursion by reachability)."""

    def reached(start: str) -> set[str]:
        seen: set[str] = set()
        todo = [start]
        while todo:
            for other in graph[todo.pop()] - seen:
                seen.add(other)
                todo.append(other)
        return seen

    reach = {name: reached(name) for name in graph}
    together = {frozenset(b for b in reach[a] if a in reach[b]) for a in graph if a in reach[a]}
    return sorted(sorted(component) for component in together)


def test_no_module_imports_one_that_imports_it() -> None:
    """Over every import, also those within functions and under TYPE_CHECKING."""
    known = modules()
    graph = {name: imported(name, file, known) for name, file in known.items()}
    assert circles(graph) == []


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("def f():\n    from lacet.b import g\n", {"lacet.b"}),
        ("from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from lacet import b\n", {"lacet.b"}),
        ("import lacet.b as b\n", {"lacet.b"}),
        ("from . import b\n", {"lacet.b"}),
        ("from .b import g\n", {"lacet.b"}),
        ("import numpy\n", set()),
    ],
)
def test_every_form_of_import_counts(tmp_path: Path, text: str, expected: set[str]) -> None:
    file = tmp_path / "a.py"
    file.write_text(text)
    assert imported("lacet.a", file, ("lacet.a", "lacet.b")) == expected


def test_a_circle_is_seen() -> None:
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == [["a", "b", "c"]]
