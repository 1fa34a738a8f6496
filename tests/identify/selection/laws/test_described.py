"""Listed effects beside a force of unknown cause: found, and what is not listed is described."""

from __future__ import annotations

import pytest

from lacet.identify.effects.language.compiled import one_line_effects
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.validation.noise_floor import NoiseFloor
from lacet.services.render.verdicts import says
from tests.identify.exact_car import VEHICLE, driven, exact_with, fit_of
from tests.identify.selection.exact_ranking import CANDIDATES

LAW = "hidden = suspension.front: p * travel**2*tanh(rate/v0) + q * tanh(rate/v1), v0 = 30 mm/s, v1 = 10 mm/s"
FRICTION = 60.0


def test_friction_is_found_beside_damping_that_is_not_listed(floor: NoiseFloor):
    """With its own size: a fit without the law that describes the rest has twice the friction."""
    (both,) = one_line_effects(LAW, VEHICLE, "hub")
    fitted = fit_of(driven(exact_with(both, 200000.0, FRICTION), 1))
    found = diagnose(fitted, floor, CANDIDATES)
    assert [c.key for c in found.found] == ["coulomb.front"], says(found)
    assert set(found.unlisted_rows) == {"suspension.fl", "suspension.fr"}
    described = found.formulas[0].of_one_term
    assert described.text.startswith("suspension.front: p * travel**2*tanh(rate/v0)")
    assert described.explained > 0.8
    assert f"from a fit with '{described.text}' in the model" in says(found)
    assert found.found[0].values[0] == pytest.approx(FRICTION, abs=20.0)
    assert found.after is not None
    assert found.after.formulas == found.formulas
