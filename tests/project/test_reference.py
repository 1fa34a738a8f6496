"""Reference pages are those that `make reference` writes; every public class and function is explained in them."""

from __future__ import annotations

import ast

from docs.reference import generate
from tests.project.test_words import PYTHON
from tests.support.places import HOME


def test_the_pages_are_those_of_the_docstrings():
    """When this fails: `make reference`."""
    kept = {page.name: page.read_text(encoding="utf-8") for page in generate.HERE.glob("*.md")}
    made = generate.pages()
    assert sorted(kept) == sorted(made)
    assert [name for name, text in made.items() if kept[name] != text] == []


def test_every_public_class_and_function_is_in_the_glossary_or_the_reference():
    pages = [HOME / "docs" / "glossary.md", *generate.HERE.glob("*.md")]
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    missing = [
        f"{file.relative_to(HOME)}: {node.name}"
        for file in PYTHON
        for node in generate.public(ast.parse(file.read_text(encoding="utf-8")).body)
        if f"`{node.name}" not in text or not generate.first_sentence(node)
    ]
    assert missing == []


def test_a_docstring_that_changes_makes_a_page_change(tmp_path):
    file = HOME / "daq" / "run.py"
    node = next(one for one in generate.public(ast.parse(file.read_text(encoding="utf-8")).body) if one.name == "Run")
    before = generate.entry(node)
    node.body[0] = ast.parse('"""Other words. More of them."""').body[0]
    assert generate.entry(node)[0] != before[0]
    assert generate.entry(node)[0].endswith(": Other words.")
