"""Full inertial parameters: possible bodies with the fit's base parameters, whatever was chosen."""

from __future__ import annotations

import json

import numpy as np
import pytest

from lacet.identify.multibody.pseudo_inertia import body_fault, pseudo_inertia
from lacet.identify.properties.body_consistency import bodies
from lacet.identify.properties.complete_car import TYPICAL, CompleteCar, complete_car
from lacet.identify.regression.wls import Fit
from lacet.simulate import find_car
from tests.identify.cars import CAR


@pytest.fixture(scope="module")
def complete(fitted: Fit) -> CompleteCar:
    """The reference car, whose fit noise has made slightly impossible (`test_consistency`)."""
    return complete_car(fitted)


def base_of(car: CompleteCar) -> np.ndarray:
    """Base parameters of a car's bodies."""
    return car.fit.base.grouping() @ car.standard


def test_every_body_can_exist_and_the_base_parameters_are_the_fit_s(complete: CompleteCar) -> None:
    base = complete.fit.base
    np.testing.assert_allclose(base_of(complete), complete.fit.theta[base.independent], rtol=1e-9, atol=1e-9)
    assert len(complete.bodies) == 9
    for name, ten in complete.bodies.items():
        assert body_fault(ten) is None, name
        assert np.linalg.eigvalsh(pseudo_inertia(ten))[0] > 1e-3, name


def test_an_impossible_fit_gives_way_within_its_intervals_and_says_so(complete: CompleteCar, fitted: Fit) -> None:
    assert complete.price is not None
    moved = np.abs(complete.fit.theta - fitted.theta)
    sigma = np.sqrt(np.maximum(np.diag(fitted.covariance), 1e-300))
    assert 0.5 < complete.price.largest[1] < 1.96
    assert np.max((moved / sigma)[fitted.base.independent]) == pytest.approx(complete.price.largest[1], rel=1e-6)
    assert complete.price.percent < 1.0


def test_a_possible_fit_is_kept_exactly_and_what_is_chosen_is_nearest_to_typical(complete: CompleteCar) -> None:
    again = complete_car(complete.fit)
    assert again.price is None
    np.testing.assert_allclose(base_of(again), base_of(complete), rtol=1e-10, atol=1e-12)
    # The first one was the nearest in what is chosen, too.
    np.testing.assert_allclose(again.standard, complete.standard, rtol=1e-4, atol=1e-6)

    def far(car: CompleteCar, standard: np.ndarray) -> float:
        total = 0.0
        for name, ten in car.bodies.items():
            kind = name.partition(".")[0]
            typical = np.linalg.inv(pseudo_inertia(TYPICAL["wheel.hub" if kind == "wheel" else kind]))
            ten = ten + bodies_to_ten[name] @ (standard - car.standard)
            J = typical @ pseudo_inertia(ten)
            total += np.trace(J) - np.linalg.slogdet(J)[1]
        return total

    bodies_to_ten = {body.name: body.to_ten for body in bodies(again.fit)}
    names, base = again.fit.model.names, again.fit.base
    for name in ("M32", "MZ41", "XX14"):
        k = names.index(name)
        step = np.zeros(len(again.standard))
        step[k] = 0.002
        step[base.independent] -= base.grouping()[:, k] * 0.002
        np.testing.assert_allclose(base.grouping() @ (again.standard + step), base_of(again), rtol=1e-9, atol=1e-9)
        assert min(far(again, again.standard + step), far(again, again.standard - step)) > far(again, again.standard)


def test_what_is_chosen_and_shared_is_named(complete: CompleteCar) -> None:
    assert {"M32", "M41", "M14", "M23"} <= set(complete.chosen)
    assert {"M29", "M38", "M11", "M20"} <= set(complete.shared)
    assert "M6" not in (*complete.chosen, *complete.shared)
    truth = json.loads((CAR / "truth.json").read_text(encoding="utf-8"))
    assert complete.value("M6") == pytest.approx(truth["chassis"]["mass_kg"], rel=2e-3)
    assert complete.value("M29") + complete.value("M32") == pytest.approx(32.0, abs=0.6)  # arm, upright and hub
    with pytest.raises(KeyError):
        complete.value("M99")


def test_typical_bodies_are_those_of_the_simulated_406() -> None:
    car = find_car("peugeot-406")
    axle, front = TYPICAL["axle"], car.front
    assert (axle[0], axle[3], axle[5]) == front.carrier_inertia
    assert (TYPICAL["wheel.hub"][5], TYPICAL["wheel.hub"][0]) == (front.inboard_spin, front.inboard_transverse)
    whole = TYPICAL["wheel.contact"]
    assert whole[5] == front.spin_inertia
    assert whole[0] == pytest.approx(front.inboard_transverse + front.outboard_transverse)
    assert whole[9] == front.inboard_mass + front.outboard_mass
    t, (mx, _, mz) = car.chassis.about(np.zeros(3)), car.chassis.mass * np.asarray(car.chassis.com)
    own = (t[0, 0], 0.0, t[0, 2], t[1, 1], 0.0, t[2, 2], mx, 0.0, mz, car.chassis.mass)
    assert TYPICAL["chassis"] == pytest.approx(own, abs=0.6)
