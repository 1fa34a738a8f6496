"""The pictures of docs/model.md are those of the model as it is now."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmarks.model_page.pictures import CAR, PICTURES, pictures
from benchmarks.model_page.style import save
from lacet.daq.vehicle import Vehicle
from lacet.identify.properties.structural_identifiability import car_tree
from tests.support.places import HOME


def texts(file: Path) -> list[str]:
    """What an SVG picture says, in order."""
    return re.findall(r"<text[^>]*>([^<]+)</text>", file.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def drawn(tmp_path_factory) -> Path:
    """A folder with every picture drawn now."""
    folder = tmp_path_factory.mktemp("pictures")
    for name, figure in pictures().items():
        save(figure, folder / f"{name}.svg")
    return folder


@pytest.mark.parametrize("name", ["tree", "frames", "rows"])
def test_a_picture_is_as_it_would_be_drawn_now(name: str, drawn: Path):
    assert texts(PICTURES / f"{name}.svg") == texts(drawn / f"{name}.svg"), "run make pictures"
    assert f"(images/model/{name}.svg)" in (HOME / "docs/model.md").read_text(encoding="utf-8")


def test_the_tree_has_every_joint_and_body():
    said = texts(PICTURES / "tree.svg")
    for joint in car_tree(Vehicle.load(CAR)):
        assert said.count(str(joint.number)) == 1
        assert f"{joint.name}, {joint.kind} {joint.axis}" in said
        assert not joint.body or joint.body in said


def test_there_are_no_other_pictures():
    assert {file.name for file in PICTURES.iterdir()} == {f"{name}.svg" for name in pictures()}
