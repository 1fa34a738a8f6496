"""Shape constants as text: in millimetres and milliseconds where they are small; SI where no unit is stated."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lacet.identify.effects.language.compiled import one_line_effects
from lacet.identify.selection.candidate import Answer, Candidate, Reason
from lacet.services.render.candidate_reasons import sizes
from lacet.services.render.shape_constants import constants_text
from tests.identify.exact_car import KNOWN, VEHICLE


def test_constants_have_the_units_people_use():
    assert constants_text(KNOWN["bump_stop.front"], {"gap": 0.00555, "n": 1.05}) == ["gap 5.55 mm", "n 1.05"]
    assert constants_text(KNOWN["coulomb.front"], {"v0": 0.0148}) == ["v0 14.8 mm/s"]
    assert constants_text(KNOWN["damper_mount.front"], {"T": 1.5}) == ["T 1.5 s"]
    own = one_line_effects("own = suspension: p * tanh(travel/s0), s0 = 3 8 mm", VEHICLE, "hub")[0]
    assert constants_text(own, {"s0": 0.003, "other": 2.0}) == ["s0 3 mm", "other 2 (SI)"]


def test_every_constant_of_the_catalogue_has_a_unit():
    assert [key for key, effect in KNOWN.items() if set(effect.grids) != set(effect.grid_units)] == []


@pytest.mark.parametrize(
    ("half", "shape", "note"),
    [
        (900.0, {"T": 0.02}, ""),
        (
            5000.0, {"T": 0.02},
            " (it acts, but the interval of c holds zero, as shape constants and sensor tolerances may be others)",
        ),
        (5000.0, {}, " (it acts, but the interval of c holds zero, as sensor tolerances may be others)"),
    ],
)  # fmt: skip
def test_a_size_with_a_wider_interval_says_what_it_depends_on(half: float, shape: dict[str, float], note: str):
    """An effect may act beyond chance, and its size be another with other constants."""
    effect = KNOWN["damper_mount.front"]
    found = Candidate(effect.key, shape, Answer.MISSING, Reason.PASSES, values=(4000.0,), interval=(half,))
    assert sizes(found, effect).endswith(note or "T 20 ms")
    assert "it acts" not in sizes(replace(found, answer=Answer.UNDECIDED), effect)
