"""Listed effects beside a force of unknown cause: found, and what is not listed is described."""

from __future__ import annotations

import pytest

from lacet.identify.effects.language.compiled import one_line_effects
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.validation.noise_floor import NoiseFloor
from lacet.services.render.verdicts import says
from tests.identify.exact_car import KNOWN, VEHICLE, driven, exact_with, fit_of
from tests.identify.selection.exact_ranking import CANDIDATES

LAW = "hidden = suspension.front: p * tanh(abs(travel)/s0)*rate + q * tanh(rate/v0), s0 = 10 mm, v0 = 10 mm/s"


def test_friction_is_found_beside_damping_that_is_not_listed(floor: NoiseFloor):
    (both,) = one_line_effects(LAW, VEHICLE, "hub")
    fitted = fit_of(driven(exact_with(both, 700.0, 50.0), 1))
    found = diagnose(fitted, floor, [*CANDIDATES, KNOWN["damper_stroke_symmetric.front"]])
    assert [c.key for c in found.found] == ["coulomb.front"], says(found)
    assert found.unlisted
    assert found.unlisted_rows
    described = found.formulas[0].of_one_term
    assert described.text.startswith("suspension.front: p * tanh(abs(travel)/s0)*rate")
    assert described.explained > 0.8
    assert described.text in says(found)
    assert found.found[0].values[0] == pytest.approx(50.0, abs=max(found.found[0].interval[0], 15.0))
