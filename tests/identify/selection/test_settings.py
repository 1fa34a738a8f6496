"""Every bar of the selection stands in its settings; the room needs few names of the rooms below it."""

from __future__ import annotations

import ast
import inspect
import itertools
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import pytest

from lacet.identify.selection import settings
from lacet.identify.selection.settings import SELECTION, SelectionSettings
from tests.support.places import HOME

ROOM = sorted((HOME / "identify" / "selection").glob("*.py"))
FOLDERS = [HOME / "identify" / "selection" / name for name in ("columns", "joint", "laws")]
WITH_COLUMNS = [*ROOM, *(file for folder in FOLDERS for file in sorted(folder.glob("*.py")))]
MOST_FILES = 13
MOST_NAMES = 13

STRUCTURE = {
    0: "nothing; a side of a sum; the first",
    1: "the whole of a share; a ratio of equals; the last",
    -1: "the last",
    2: "an array of two axes, a pair, a square",
}
"""Numbers that a comparison may hold elsewhere, with what they mean there."""

BOUNDING = ("min", "max", "minimum", "maximum", "clip", "quantile", "percentile", "isclose", "allclose")
"""Calls whose numbers are bars."""


def number(node: ast.AST) -> float | None:
    """The number that an expression is by itself: a literal with signs, sums and products of literals; or None."""
    match node:
        case ast.Constant(value=bool()):
            return None
        case ast.Constant(value=int() | float() as value):
            return value
        case ast.UnaryOp(op=ast.USub(), operand=inner):
            found = number(inner)
            return None if found is None else -found
        case _:
            return None


def called(node: ast.Call) -> str:
    """The last name of what is called."""
    match node.func:
        case ast.Attribute(attr=name) | ast.Name(id=name):
            return name
        case _:
            return ""


def literals(node: ast.AST) -> Iterator[tuple[int, float]]:
    """Line and value of each number inside an expression, calls and indices apart."""
    if (found := number(node)) is not None:
        yield getattr(node, "lineno", 0), found
    elif not isinstance(node, ast.Call | ast.Subscript | ast.Lambda):
        for child in ast.iter_child_nodes(node):
            yield from literals(child)


def bars(source: str) -> list[str]:
    """Numeric thresholds in a module: constants at its top, and numbers in comparisons and bounding calls."""
    tree, out = ast.parse(source), list[str]()
    for node in tree.body:
        value = node.value if isinstance(node, ast.Assign | ast.AnnAssign) else None
        if value is not None and any(literals(value)):
            out.append(f"{node.lineno}: a constant of the module")
    for node in ast.walk(tree):
        parts: list[ast.AST] = []
        if isinstance(node, ast.Compare):
            parts = [node.left, *node.comparators]
        elif isinstance(node, ast.Call) and called(node) in BOUNDING:
            parts = [*node.args, *(word.value for word in node.keywords)]
        elif isinstance(node, ast.keyword) and node.arg in ("rcond", "rtol", "atol", "tol"):
            parts = [node.value]
        out += [f"{line}: {value:g}" for part in parts for line, value in literals(part) if value not in STRUCTURE]
    # A float that is no count is a bar wherever it stands: a factor of what is compared is one, too.
    out += [
        f"{node.lineno}: {node.value:g}"
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, float) and node.value not in STRUCTURE
    ]
    return out


def names_from_below(source: str) -> set[str]:
    """Names that a module imports from lacet's other rooms; how progress is told belongs to no room."""
    return {
        f"{node.module}.{alias.name}"
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("lacet.")
        and not str(node.module).startswith(("lacet.identify.selection", "lacet.identify.progress"))
        for alias in node.names
    }  # fmt: skip


@pytest.mark.parametrize(
    "file", [file for file in WITH_COLUMNS if file.name != "settings.py"], ids=lambda file: file.name
)
def test_no_other_file_has_a_bar(file: Path):
    assert bars(file.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    "source",
    [
        "LEAST = 3.0",
        "LEAST: float = 8",
        "PAIRS = (1, 2)",
        "if share > 0.05: ...",
        "kept = values > 1e-9 * values[-1]",
        "if count < 6: ...",
        "x = max(0.3, share)",
        "x = np.quantile(spectrum, 0.25)",
        "x = np.linalg.lstsq(A, b, rcond=1e-9)",
        "half = 1.96 * sigma",
    ],
)
def test_a_bar_elsewhere_would_be_found(source: str):
    assert bars(source)


@pytest.mark.parametrize("source", ["if len(runs) < 2: ...", "x = max(0.0, y)", "a[:, 3] > b[5]", "n = range(4)"])
def test_counts_of_structure_are_none(source: str):
    assert bars(source) == []


def test_every_bar_says_its_meaning_its_unit_and_its_source():
    tree = ast.parse(Path(str(settings.__file__)).read_text(encoding="utf-8"))
    (body,) = (node.body for node in tree.body if isinstance(node, ast.ClassDef))
    said: dict[str, str] = {}
    for node, after in itertools.pairwise(body):
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            text = ast.literal_eval(after.value) if isinstance(after, ast.Expr) else ""
            said[node.target.id] = " ".join(text.split())
    assert list(said) == [one.name for one in fields(SelectionSettings)]
    for name, text in said.items():
        assert "[" in text, name
        assert "]" in text, name
        assert "Source: " in text, name
        assert getattr(SELECTION, name) >= 0, name


def test_every_bar_is_used():
    text = "\n".join(
        file.read_text(encoding="utf-8")
        for file in [*WITH_COLUMNS, *(HOME / "services").rglob("*.py"), *(HOME / "identify" / "design").glob("*.py")]
    )
    text += inspect.getsource(SelectionSettings.level).replace("self.", "SELECTION.")
    assert [one.name for one in fields(SelectionSettings) if f"SELECTION.{one.name}" not in text] == []


def test_the_room_is_small_and_needs_few_names_from_below():
    assert len(ROOM) <= MOST_FILES
    needed = set[str]().union(*(names_from_below(file.read_text(encoding="utf-8")) for file in ROOM))
    assert len(needed) <= MOST_NAMES, sorted(needed)


def test_the_columns_need_nothing_of_the_tests_but_their_settings():
    """The sums over columns stand below the tests that read them."""
    room, needed = "lacet.identify.selection", set[str]()
    for file in WITH_COLUMNS:
        if file.parent.name == "columns":
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                match node:
                    case ast.ImportFrom(module=str(module)) if module == room:
                        needed |= {f"{module}.{alias.name}" for alias in node.names}
                    case ast.ImportFrom(module=str(module)):
                        needed.add(module)
                    case ast.Import(names=names):
                        needed |= {alias.name for alias in names}
                    case _:
                        pass
    ours = {module for module in needed if module == room or module.startswith(f"{room}.")}
    assert {module for module in ours if not module.startswith(f"{room}.columns.")} == {f"{room}.settings"}


def test_nothing_below_calls_back():
    rooms = ("multibody", "signals", "car", "effects", "regression", "validation", "properties")
    files = [file for room in rooms for file in (HOME / "identify" / room).rglob("*.py")]
    assert [file.name for file in files if "identify.selection" in file.read_text(encoding="utf-8")] == []
