"""identify returns values: sentences for people are made of them in services/render."""

import ast
from pathlib import Path

import pytest

from tests.support.places import HOME

MODULES = sorted((HOME / "identify").rglob("*.py"))
SENTENCE = 6
"""Words from which on a text counts as a sentence; labels and units are shorter."""
ALLOWED = {
    "identify/effects/": "what an effect or a state declares of itself, and what is wrong with a user's law or file",
    "identify/multibody/symbolic_table.py": "what is wrong with a table",
    "identify/multibody/symoro.py": "what is wrong with a file",
    "identify/validation/parameter_estimates.py": "runs that show a parameter, as effects declare them",
    "identify/selection/": "sentences of the ranking",
}
"""Where texts of that length stand, and what they are."""


def sentences(tree: ast.Module) -> list[tuple[int, str]]:
    """Line and text of every string that reads like a sentence, docstrings and messages of exceptions apart."""
    skipped: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            skipped.add(id(node.value))
        elif isinstance(node, ast.Raise) or (
            isinstance(node, ast.FunctionDef) and node.name in ("__repr__", "__str__")
        ):
            skipped.update(id(part) for part in ast.walk(node))
        elif isinstance(node, ast.JoinedStr):
            skipped.update(id(part) for part in node.values)
    out: list[tuple[int, str]] = []
    for node in ast.walk(tree):
        text = ""
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            text = node.value
        elif isinstance(node, ast.JoinedStr):
            text = "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values)
        if id(node) not in skipped and len([word for word in text.split() if word.strip("{}.,:;()") != ""]) >= SENTENCE:
            out.append((node.lineno, text))
    return out


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
    """A returned sentence is found; a docstring, an error's message and a label are not."""
    text = '''
def why(x):
    """A docstring of as many words as one likes to write."""
    if x:
        raise ValueError(f"a message of {x} words, of which there are many")
    label = "vertical wheel load"
    return f"the runs leave {x}, hardly less than is plausible at all"
'''
    assert [line for line, _ in sentences(ast.parse(text))] == [7]
