"""Physical consistency: what any mass distribution fulfils, what none can, and the nearest fit that some can have."""

from __future__ import annotations

import importlib
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lacet.daq.errors import SolverError, UsageError
from lacet.daq.formats.open_run import open_run
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.multibody.pseudo_inertia import BASIS, body_fault, in_units, pseudo_inertia
from lacet.identify.multibody.rigid_body import move_parameters
from lacet.identify.multibody.vectors import Array
from lacet.identify.properties.body_consistency import bodies, check_bodies, clusters, whole
from lacet.identify.properties.consistent_fit import ConsistentFit, certain_sign, consistency, consistent_fit
from lacet.identify.regression.information import Information
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.services.render.consistency_report import body_fault_words, consistency_words
from tests.identify import cars
from tests.support.places import HOME

VEHICLE, RIG = cars.reference_car()

finite = st.floats(-5.0, 5.0, allow_nan=False)
points = st.lists(st.tuples(finite, finite, finite, st.floats(1e-3, 1e3)), min_size=1, max_size=12)


def of_points(mass: list[tuple[float, float, float, float]]) -> Array:
    """Ten parameters of point masses (x, y, z, m)."""
    out = np.zeros(10)
    for x, y, z, m in mass:
        out += move_parameters(np.array([0.0] * 9 + [m]), np.eye(3), np.array([x, y, z]))
    return out


@given(points)
def test_point_masses_are_always_possible(mass: list[tuple[float, float, float, float]]) -> None:
    """Whatever the points, and their pseudo-inertia is Σ m (r, 1)(r, 1)ᵀ."""
    ten = of_points(mass)
    assert body_fault(ten) is None
    direct = sum(m * np.outer((x, y, z, 1.0), (x, y, z, 1.0)) for x, y, z, m in mass)
    np.testing.assert_allclose(pseudo_inertia(ten), direct, rtol=1e-9, atol=1e-9 * np.max(np.abs(direct)))


@given(st.floats(0.1, 100.0), st.floats(0.1, 100.0), st.floats(1.01, 3.0), st.tuples(finite, finite, finite))
def test_what_breaks_the_triangle_inequality_is_impossible(
    a: float, b: float, more: float, at: tuple[float, float, float]
) -> None:
    """Positive moments of which one exceeds the sum of the others, anywhere and however turned."""
    turned = np.linalg.qr(np.random.default_rng(int(1e6 * more)).normal(size=(3, 3)))[0]
    ten = move_parameters(np.array([a, 0, 0, b, 0, more * (a + b), 0, 0, 0, 20.0]), turned, np.array(at))
    assert "more than the other two" in body_fault_words(body_fault(ten))


@pytest.mark.parametrize(
    ("ten", "word"),
    [
        ([1, 0, 0, 1, 0, 1, 0, 0, 0, -2], "mass is -2 kg"),
        ([1, 0, 0, 1, 0, 1, 30, 0, 0, 10], "moment of inertia about its centre of gravity"),
        ([0.1, 0.5, 0, 0.1, 0, 0.1, 0, 0, 0, 1], "moment of inertia about its centre of gravity"),
    ],
)
def test_faults_are_told_in_words(ten: list[float], word: str) -> None:
    """A negative mass, a centre of gravity farther out than the inertia allows, a product that is too large."""
    assert word in body_fault_words(body_fault(ten))


def test_units_do_not_change_the_answer() -> None:
    """A congruence: the signs of eigenvalues stay (Sylvester)."""
    rng = np.random.default_rng(0)
    for values in rng.normal(size=(50, 10)):
        J = np.tensordot(values, BASIS, 1)
        signs = [np.sign(np.linalg.eigvalsh(m)).tolist() for m in (J, in_units(J, 37.0, 0.03))]
        assert signs[0] == signs[1]


@pytest.fixture(scope="module")
def fitted() -> Fit:
    """A sine and a rough road of the reference car, with its bars."""
    known = catalogue(VEHICLE, "hub")
    model = Model.of(base_model(VEHICLE, "hub")) + known["anti_roll_bar.front"] + known["anti_roll_bar.rear"]
    drives = [PreparedRun.of(open_run(cars.CAR / f"{name}.parquet"), VEHICLE, RIG) for name in ("sine", "rough")]
    return fit(model, drives, FitOptions(unbias=False))


def changed(fitted: Fit, **values: float) -> Fit:
    """The fit with other values of some parameters."""
    theta = fitted.theta.copy()
    for name, value in values.items():
        theta[fitted.model.names.index(name.replace("__", "."))] = value
    return replace(fitted, theta=theta)


@pytest.fixture(scope="module")
def known(fitted: Fit) -> Information:
    """What its equations know."""
    return Information.of(fitted)


@pytest.fixture(scope="module")
def mended(fitted: Fit) -> ConsistentFit:
    """The fit made consistent: its axles' inertias, poorly excited, are partly negative."""
    return consistent_fit(fitted)


def test_the_information_is_that_of_the_fit(fitted: Fit, known: Information) -> None:
    """Its inverse is the fit's covariance as if residuals were independent; marginals agree with the joint."""
    inverse = known.inverse()
    place = fitted.base.independent
    expected = fitted.covariance_iid[np.ix_(place, place)]
    size = np.sqrt(np.diag(expected))
    joint = inverse @ inverse.T
    np.testing.assert_allclose((joint[: len(place), : len(place)] - expected) / np.outer(size, size), 0.0, atol=1e-9)
    chosen = np.array([3, 11, 40])
    small, follow = known.marginal(chosen)
    np.testing.assert_allclose(np.linalg.inv(small.T @ small), joint[np.ix_(chosen, chosen)], rtol=1e-8)
    change = np.array([1.0, -0.5, 20.0])
    assert np.sum((known.root @ follow @ change) ** 2) == pytest.approx(np.sum((small @ change) ** 2), rel=1e-9)


def test_bodies_that_stand_alone_and_those_counted_together(fitted: Fit) -> None:
    """Inboard hub masses act with their axles; the chassis and the whole car have values of their own."""
    checks = {check.name: check for check in check_bodies(fitted)}
    assert set(checks) == {"chassis", "vehicle", *(f"{kind}.{c}" for kind in ("axle", "wheel") for c in cars.CORNERS)}
    assert checks["chassis"].separable
    assert checks["vehicle"].separable
    assert checks["chassis"].possible
    assert not checks["axle.fl"].separable
    assert "M29 (with M32)" in checks["axle.fl"].shared
    assert "M32 (with M29)" in checks["wheel.fl"].shared
    assert [body.name for body in clusters(fitted)[0]] == ["chassis"]
    assert {len(group) for group in clusters(fitted)} == {1, 2}


def test_the_direct_test_needs_no_solver_and_shows_its_interval(fitted: Fit, monkeypatch: pytest.MonkeyPatch) -> None:
    """A chassis that is impossible by more than its interval is clear; the LMI asks for the extra."""

    def absent(name: str) -> object:
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", absent)
    wrong = next(check for check in check_bodies(changed(fitted, XX6=9000.0)) if check.name == "chassis")
    assert not wrong.possible
    assert wrong.clear
    assert "more than the other two" in body_fault_words(wrong.fault)
    for work in (consistency, consistent_fit):
        with pytest.raises(UsageError, match=r"lacet\[consistency\]"):
            work(fitted)


def possible(result: Array, fitted: Fit) -> bool:
    """Every body and every certain sign, from standard parameters alone."""
    signs = [certain_sign(q) for q in fitted.model.parameters[: len(result)]]
    good = all(sign * value >= 0.0 for sign, value in zip(signs, result, strict=True))
    return good and all(body_fault(body.to_ten @ result) is None for body in bodies(fitted))


def test_the_mended_fit_is_possible_and_keeps_its_base_values(fitted: Fit, mended: ConsistentFit) -> None:
    """The standard parameters exist, group to the base values of the fit, and a second look finds them consistent."""
    base = mended.fit.theta[fitted.base.independent]
    size = np.array([q.prior for q in fitted.model.parameters])[fitted.base.independent]
    np.testing.assert_allclose((fitted.base.grouping() @ mended.standard - base) / size, 0.0, atol=1e-8)
    assert possible(mended.standard, fitted)
    again = consistency(mended.fit)
    assert again.consistent
    assert again.distance == 0.0
    together = whole(mended.fit)
    assert together is not None
    assert body_fault(together.to_ten @ mended.fit.physics) is None


def test_the_price_is_the_quadratic_form_and_the_rise_of_the_residual(
    fitted: Fit, known: Information, mended: ConsistentFit
) -> None:
    """‖R Δx‖² from the changes of all unknowns; without bias correction it is the rise itself, zeros included."""
    change = mended.fit.solution - fitted.solution
    price = mended.price
    assert price.quadratic > 0.0
    assert price.quadratic == pytest.approx(np.sum((known.root @ change) ** 2), rel=1e-7)
    rise = penalty(mended.fit) - penalty(fitted)  # the estimate is its minimum: all of the rise is the quadratic form
    assert rise == pytest.approx(price.quadratic, rel=1e-4)
    _, piece = fitted.assembly.pieces()
    names, _, zeros = mended.fit.zeros[1]
    assert piece.zeros is not None
    assert piece.zeros.names == names
    for row in ("suspension.fl", "chassis.mx", "tyre.rr"):
        direct = piece.right[row] - piece.blocks[row] @ np.concatenate([zeros, mended.fit.solution])
        np.testing.assert_allclose(mended.fit.residual[1][row], direct, atol=1e-8 * np.max(np.abs(piece.right[row])))
    assert abs(price.percent) < 0.1
    assert set(price.rows) == set(fitted.rows)
    assert np.array_equal(mended.fit.covariance, fitted.covariance)


def penalty(fitted: Fit) -> float:
    """Weighted residual plus what is known beforehand, from the definitions."""
    parameters = fitted.model.parameters
    value = dict(zip(fitted.model.names, fitted.theta, strict=True))
    total = sum(
        float(np.sum((r / fitted.sigma[row]) ** 2)) for part in fitted.residual for row, r in part.items()
    ) + sum(float(np.sum((values / prior) ** 2)) for _, prior, values in fitted.zeros)
    kept = {parameters[int(i)].name: parameters[int(i)] for i in fitted.base.independent}
    for name, q in kept.items():
        total += (value[name] / q.prior) ** 2
        if q.twin in kept:
            total += ((value[name] - value[q.twin]) / q.twin_sigma) ** 2
    return total


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_no_possible_car_is_nearer(fitted: Fit, known: Information, mended: ConsistentFit, seed: int) -> None:
    """The angle at the nearest point of a convex set: (x̂ − x)ᵀ RᵀR (y − x) ≤ 0 for every possible car y."""
    rng = np.random.default_rng(seed)
    other = np.asarray(mended.standard).copy()
    for body in bodies(fitted):
        if body.name.startswith("wheel"):
            second, along, height = rng.uniform(0, 0.5, 2) * 1.0, rng.uniform(0, 0.5), rng.uniform(-0.05, 0.05)
            mass = rng.uniform(1.0, 30.0)
            zz, xx = 2 * second[0], second[0] + along + mass * height**2
            other[body.members] = (zz, xx, mass * height, mass)
        else:
            scale = 1.0 if body.name == "chassis" else 0.1
            cloud = [(*(scale * rng.normal(0, 1, 3)), rng.uniform(1, 300 * scale)) for _ in range(6)]
            other[body.members] = of_points(cloud)
    signed = [i for i, q in enumerate(fitted.model.parameters[: len(other)]) if certain_sign(q)]
    other[signed] *= rng.uniform(0.5, 1.5, len(signed))
    assert possible(other, fitted)
    b = len(fitted.base.independent)
    root, _ = known.marginal(np.arange(b))
    x = mended.fit.theta[fitted.base.independent]
    toward = root @ (fitted.base.grouping() @ other - x)
    back = root @ (fitted.theta[fitted.base.independent] - x)
    # The solver stands a millionth inside the set's border, and is good to about 1e-6 itself.
    assert back @ toward <= 1e-4 * np.linalg.norm(back) * np.linalg.norm(toward)


def test_a_poorly_excited_axle_is_within_noise_and_an_impossible_one_is_not(fitted: Fit) -> None:
    """The reference car's axles stand out by a σ, as those of a consistent car do; a mass of −20 kg does not."""
    found = consistency(fitted, draws=19)
    assert not found.consistent
    assert 0.0 < found.distance < 4.0
    assert found.p > 0.1
    assert "noise explains it" in consistency_words(found)
    wrong = consistency(changed(fitted, M29=-20.0), draws=19)
    assert wrong.p == pytest.approx(0.05)
    assert wrong.distance > 50.0
    assert max(wrong.alone, key=lambda name: wrong.alone[name]) == "axle.fl + wheel.fl"
    assert "axle.fl + wheel.fl" in consistency_words(wrong)
    assert wrong.distance >= max(wrong.alone.values()) - 1e-6  # a part of the constraints is never dearer than all


def test_far_out_cars_are_mended(fitted: Fit) -> None:
    """A chassis of negative mass, thousands of σ away, and a damper of the wrong sign."""
    far = consistent_fit(changed(fitted, M6=-1300.0, XX6=-100.0))
    assert possible(far.standard, fitted)
    assert far.price.percent > 100.0
    damper = changed(fitted, damper__fl__c=-100.0)
    assert "damper.fl.c" in consistency_words(consistency(damper, draws=19))
    assert consistency(damper, draws=19).wrong_sign["damper.fl.c"] > 10.0
    assert consistent_fit(damper).fit.value("damper.fl.c") >= 0.0


def test_a_consistent_fit_is_left_alone(mended: ConsistentFit) -> None:
    """To the last digit."""
    again = consistent_fit(mended.fit)
    np.testing.assert_array_equal(again.fit.theta, mended.fit.theta)
    assert again.price.quadratic == 0.0
    assert again.price.percent == 0.0
    assert possible(again.standard, mended.fit)


def test_the_python_of_the_page_runs(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """As it stands, from the folder of the sources."""
    monkeypatch.chdir(HOME)
    page = (HOME / "docs" / "consistency.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    known: dict[str, Any] = {}
    exec(compile(example, "docs/consistency.md", "exec"), known)
    assert known["mended"].price.distance > 1.0
    assert capsys.readouterr().out


def test_a_solver_that_fails_is_told(fitted: Fit, monkeypatch: pytest.MonkeyPatch) -> None:
    """An answer that does not fulfil the constraints is never handed on."""
    monkeypatch.setattr("lacet.identify.properties.consistent_fit.LEAST", -0.05)
    with pytest.raises(SolverError, match="did not come out consistent"):
        consistent_fit(fitted)
