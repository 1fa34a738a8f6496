"""docs/catalogue.md is what the catalogue says now; every effect has its entry, its case and its picture."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmarks.catalogue_page import page as made
from benchmarks.catalogue_page.cases import CASES
from lacet.identify.effects.catalogue import effect_classes
from lacet.identify.effects.excluded import EXCLUDED
from lacet.simulate import Hidden, make_manoeuvre

TEXT = made.PAGE.read_text(encoding="utf-8")
ENTRIES = dict(re.findall(r"^### (\w+)\n(.*?)(?=^##|\Z)", TEXT, re.DOTALL | re.MULTILINE))
MEASURED = {one.name: one for one in EXCLUDED}
FAMILIES = sorted([*effect_classes(), *MEASURED])
MOST_BYTES = 1_500_000


def test_the_page_is_what_the_catalogue_says() -> None:
    """Written anew it is the same."""
    assert made.page() == TEXT, "run python -m benchmarks.catalogue_page --text"


def test_every_family_has_an_entry_and_no_other() -> None:
    """By name, once in the contents and once as a heading."""
    assert sorted(ENTRIES) == FAMILIES
    assert sorted(re.findall(r"^- \[(\w+)\]\(#\1\): ", TEXT, re.MULTILINE)) == FAMILIES
    assert sorted(CASES) == FAMILIES


@pytest.mark.parametrize("family", FAMILIES)
def test_an_entry_says_everything(family: str) -> None:
    """What it is, rows, parameters, source, and a picture that is there and says something, or why there is none."""
    entry, case, measured = ENTRIES[family], CASES[family], family in MEASURED
    one = MEASURED[family] if measured else effect_classes()[family]
    for said in (one.source,) if measured else (one.signature, one.shown_by, one.source):
        assert said in entry
    assert f"\n- [{family}](#{family}): {one.about}\n" in TEXT
    for said in (
        (MEASURED[family].law, MEASURED[family].measured_by) if measured else effect_classes()[family].looks_like
    ):
        assert said in entry
    assert measured == ("cannot be missing" in entry)
    assert measured != bool(re.search(r"^- `[^\n]*: [^\n]* to ", entry, re.MULTILINE))
    pictures = re.findall(r"!\[.+\]\((.+)\)", entry)
    if case.how == "none":
        assert not pictures
        assert case.why in entry
        return
    assert pictures == [f"images/effects/{family}.png"]
    assert (made.PAGE.parent / pictures[0]).read_bytes().startswith(b"\x89PNG")
    facts = made.pictured()[family]
    assert facts["case"] == case.digest, "the picture is of another case: run python -m benchmarks.catalogue_page"
    ratio = facts["ratio"]
    if measured:
        assert ratio < 1.2, "the residual of what is measured stays at the floor"
    elif case.how != "share":
        assert ratio > 1.5, "a missing effect stands out"


@pytest.mark.parametrize("family", [name for name, case in CASES.items() if case.run])
def test_a_case_can_be_driven(family: str) -> None:
    """Its manoeuvres and its hidden effect exist, and what is hidden is what the page says one types."""
    case = CASES[family]
    for run in case.runs:
        name, *settings = run.split()
        make_manoeuvre(name, **dict(setting.split("=") for setting in settings))
    for hidden in case.effects:
        assert Hidden.parse(case.option) == hidden
        assert f"`--hide {case.option}` in `{case.run}" in ENTRIES[family]


def test_pictures_are_small_and_none_is_left_over() -> None:
    """Together below what a clone should carry."""
    files = sorted(made.PICTURES.iterdir())
    assert [f.name for f in files] == sorted(f"{name}.png" for name, case in CASES.items() if case.how != "none")
    assert sum(f.stat().st_size for f in files) < MOST_BYTES


def test_links_lead_to_headings() -> None:
    """Within the page, and to files beside it and headings in these."""
    for link in re.findall(r"\]\(([^)]+)\)", TEXT):
        file, _, heading = link.partition("#")
        there = Path(made.PAGE.parent, file) if file else made.PAGE
        assert there.is_file(), link
        if heading:
            lines = re.findall(r"^#+ (.+)$", there.read_text(encoding="utf-8"), re.MULTILINE)
            assert heading in {line.lower().replace(" ", "-") for line in lines}, link
