"""identify works on arrays and texts: it neither opens files nor imports them by path."""

import ast
from pathlib import Path

import pytest

from tests.support.places import HOME

MODULES = sorted((HOME / "identify").rglob("*.py"))
CALLS = frozenset(
    {
        "open", "read_text", "read_bytes", "write_text", "write_bytes", "mkdir", "unlink", "glob", "rglob", "iterdir",
        "is_file", "is_dir", "exists", "spec_from_file_location", "loadtxt", "savetxt", "genfromtxt", "memmap",
    }
)  # fmt: skip
"""Functions and methods that reach into a file system."""
IMPORTS = frozenset({"io", "os", "pathlib", "shutil", "tempfile", "glob", "importlib.util", "importlib.resources"})
"""Modules whose purpose is files and paths."""


def found(tree: ast.Module) -> list[str]:
    """Lines that open, list or name files."""
    out: list[str] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            if name in CALLS or name == "Path":
                out.append(f"line {node.lineno}: {name}(")
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else [one.name for one in node.names]
            out += [f"line {node.lineno}: import {name}" for name in names if name in IMPORTS]
    return out


@pytest.mark.parametrize("file", MODULES, ids=lambda file: str(file.relative_to(HOME)))
def test_no_module_of_identify_reads_a_file(file: Path):
    """File access is the workspace's: what was read is handed over as text, classes or arrays."""
    assert not found(ast.parse(file.read_text(encoding="utf-8")))


def test_the_search_finds_what_it_is_for():
    """Each kind of access is seen."""
    text = "import pathlib\nfrom importlib.util import spec_from_file_location\nPath('x').read_text()\nopen('x')\n"
    assert len(found(ast.parse(text))) == 5
