"""Notes of a chain in words."""

from __future__ import annotations

from typing import get_args

import pytest

from lacet.identify.multibody import chain_notes as notes
from lacet.services.render.chain_text import chain_notes

SAYS = {
    notes.LoopsCut(4, (5, 6)): "2 closed loop(s): the equivalent tree of bodies 1…4 is taken, cut at joint(s) 5, 6. ",
    notes.LoadsLeftOut(("FX", "CZ")): "external forces (FX, CZ) are left out: torques are those of free bodies",
    notes.GeometryMissing(("b", "r")): "the file has no b, r: taken as 0",
    notes.ParametersMissing(("MX",)): "the file has no MX: every body is taken to have them",
    notes.ConstantPosition("theta", 3, "pi/2"):
        "theta of joint 3 is the number pi/2: taken as what stands beside the joint position",
    notes.GravityAssumed((0.0, 0.0, -9.8)): "the file has no G: gravity is (0, 0, -9.8) m/s² in the ground frame",
    notes.GravityAssumed((0.0, 0.0, -9.8), ("G3",)):
        "G3 has no value: gravity is (0, 0, -9.8) m/s² in the ground frame",
    notes.ValuesUnused(("Q", "P")): "values were given for unknown symbols: Q, P",
    notes.LinksJoined(("tool", "camera")):
        "link(s) tool, camera on fixed joints are part of the body that carries them",
    notes.FramesInserted((2, 5)): "axes are nearly parallel: fixed frame(s) 2, 5 were inserted",
    notes.NearlyRight(("joint 'a'",), 4e-6): "angles of joint 'a' are up to 4e-06 rad off a quarter turn: taken as ",
}  # fmt: skip


@pytest.mark.parametrize("note", SAYS, ids=lambda note: type(note).__name__)
def test_a_note_has_its_sentence(note: notes.ChainNote) -> None:
    """With every name and number that the note holds, and its representation has them too."""
    (said,) = chain_notes([note])
    assert said.startswith(SAYS[note])
    assert all(f"{name}={value!r}" in repr(note) for name, value in vars(note).items())


def test_no_kind_of_note_is_without_words() -> None:
    """Each kind stands in the list above."""
    assert {type(note) for note in SAYS} == {*get_args(notes.ChainNote)}
