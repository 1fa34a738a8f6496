"""identify returns values: sentences for people are made of them in services/render."""

import ast
from pathlib import Path

import pytest

from tests.support.places import HOME

MODULES = sorted((HOME / "identify").rglob("*.py"))
SENTENCE = 6
"""Words from which on a text counts as a sentence; labels and units are shorter. A word has a letter."""
DECLARED = ("about", "signature", "shown_by", "source", "parameters_shown_by")
"""Attributes in whose texts a class of effects declares what it is."""
ALLOWED = {
    "identify/effects/excluded.py": "what each excluded effect declares of itself",
    "identify/effects/language/compiled.py": "what is wrong with a user's line, and what its effect declares of itself",
    "identify/effects/language/linearity.py": "what is wrong with a user's line",
    "identify/effects/language/parser.py": "what is wrong with a user's line",
    "identify/effects/language/states.py": "what each state declares of itself",
}
"""Where texts of that length stand, and what they are."""


def sentences(tree: ast.Module) -> list[tuple[int, str]]:
    """Line and text of every string that reads like a sentence.

    Docstrings, messages of exceptions (those of a file's faults, put together by `fault`, among them), representations
    and what effects declare of themselves are left out.
    """
    skipped: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            skipped.add(id(node.value))
        elif isinstance(node, ast.Raise) or _puts_a_fault(node) or _represents(node):
            skipped.update(id(part) for part in ast.walk(node))
        elif isinstance(node, ast.ClassDef):
            skipped.update(id(part) for one in node.body if _declares(one) for part in ast.walk(one))
        elif isinstance(node, ast.JoinedStr):
            skipped.update(id(part) for part in node.values)
    out: list[tuple[int, str]] = []
    for node in ast.walk(tree):
        text = ""
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            text = node.value
        elif isinstance(node, ast.JoinedStr):
            text = "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values)
        if id(node) not in skipped and sum(any(sign.isalpha() for sign in word) for word in text.split()) >= SENTENCE:
            out.append((node.lineno, text))
    return out


def _puts_a_fault(node: ast.AST) -> bool:
    """``fault(…)`` or ``self.fault(…)``: one of the faults of a file, which an exception has all of."""
    return isinstance(node, ast.Call) and ast.unparse(node.func).rpartition(".")[2] == "fault"


def _represents(node: ast.AST) -> bool:
    return isinstance(node, ast.FunctionDef) and node.name in ("__repr__", "__str__")


def _declares(node: ast.stmt) -> bool:
    """An attribute in which a class of effects says what it is."""
    names = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    return any(isinstance(name, ast.Name) and name.id in DECLARED for name in names)


@pytest.mark.parametrize("file", MODULES, ids=lambda file: str(file.relative_to(HOME)))
def test_no_module_of_identify_makes_sentences(file: Path):
    """Enumerations and data classes with the numbers and names; exceptions say themselves what is wrong."""
    name = file.relative_to(HOME).as_posix()
    if not any(name.startswith(place) for place in ALLOWED):
        assert not sentences(ast.parse(file.read_text(encoding="utf-8")))


def test_what_is_allowed_is_there():
    """No place on the list that has gone, or has no sentence any more."""
    for place in ALLOWED:
        files = [file for file in MODULES if file.relative_to(HOME).as_posix().startswith(place)]
        assert any(sentences(ast.parse(file.read_text(encoding="utf-8"))) for file in files), place


def test_the_search_finds_what_it_is_for():
    """A returned sentence is found; a docstring, an error's message, a declaration and a label are not."""
    text = '''
class Bump:
    about = "bump stop touched beyond a gap in compression"
    note = "bump stop touched beyond a gap in compression"


def why(x):
    """A docstring of as many words as one likes to write."""
    if x:
        raise ValueError(f"a message of {x} words, of which there are many")
    self.fault(3, f"a message of {x} words, of which there are many")
    label = "vertical wheel load"
    return f"the runs leave {x}, hardly less than is plausible at all"
'''
    assert [line for line, _ in sentences(ast.parse(text))] == [4, 13]
