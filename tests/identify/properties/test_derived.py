"""Derived values against independent models: energies of the whole car, characteristic polynomials, the car's truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import scipy.linalg
from scipy.optimize import minimize

from lacet.daq.channels import CORNERS
from lacet.identify.effects.base import Effect
from lacet.identify.effects.catalogue import catalogue
from lacet.identify.multibody.rigid_body import STANDARD_GRAVITY as G
from lacet.identify.multibody.rigid_body import move_parameters
from lacet.identify.multibody.vectors import Array
from lacet.identify.properties.corner_rates import CornerNumbers, corner_numbers
from lacet.identify.properties.derived import Derived, _by_parameter, damper_curves, derived_values, ranges
from lacet.identify.properties.ride_model import modes, ride_values, roll_centre
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.validation.prediction_uncertainty import Knowledge
from lacet.services.render.identifiability import not_derived
from tests.identify import cars

VEHICLE, RIG = cars.reference_car()
X = np.array([VEHICLE.corners[c].position[0] for c in CORNERS])
Y = np.array([VEHICLE.corners[c].position[1] for c in CORNERS])
HEIGHT = VEHICLE.corners["fl"].height


def symmetric_car() -> CornerNumbers:
    """A car alike on both sides, its centre of gravity in the middle plane."""
    central = np.array([480.0, 0.0, 0.0, 2050.0, 0.0, 2250.0, 0.0, 0.0, 0.0, 1270.0])
    bars = np.zeros((4, 4))
    for (i, j), k in {(0, 1): 14000.0, (2, 3): 6500.0}.items():
        bars[i, i] = bars[j, j] = k
        bars[i, j] = bars[j, i] = -k
    return CornerNumbers(
        stiffness=np.array([24e3, 24e3, 27e3, 27e3]), damping=np.array([1600.0, 1600.0, 1900.0, 1900.0]),
        coupled_stiffness=bars, coupled_damping=np.zeros((4, 4)), tyre=np.full(4, 205e3),
        unsprung=np.array([56.0, 56.0, 48.0, 48.0]),
        chassis=move_parameters(central, np.eye(3), np.array([-1.2, 0.0, 0.26])),
        static=np.array([3460.75, 3460.75, 2768.6, 2768.6]),
    )  # fmt: skip


def value(numbers: CornerNumbers, name: str) -> float:
    """One derived value."""
    return ride_values(numbers, VEHICLE)[name][0]


def hessian(function: Callable[[Array], float], n: int) -> Array:
    """Of a quadratic function about zero, exactly; linear terms drop out."""
    e, zero = np.eye(n), function(np.zeros(n))
    return np.array([[function(a + b) - function(a) - function(b) + zero for b in e] for a in e])


def energies(n: CornerNumbers) -> tuple[Callable[[Array], float], Callable[[Array], float], Callable[[Array], float]]:
    """Kinetic, potential and dissipated energy of seven positions: heave, pitch, roll of the body, four wheels."""
    x, z, mass = n.chassis[6] / n.chassis[9], n.chassis[8] / n.chassis[9], n.chassis[9]
    pitch, roll = n.chassis[3] - mass * (x**2 + z**2), n.chassis[0] - mass * z**2

    def travel(q: Array) -> Array:
        return q[3:] - (q[0] - (X - x) * q[1] + Y * q[2])

    def kinetic(v: Array) -> float:
        return 0.5 * float(mass * v[0] ** 2 + pitch * v[1] ** 2 + roll * v[2] ** 2 + n.unsprung @ v[3:] ** 2)

    def bars(s: Array) -> float:
        return 0.5 * float(14000.0 * (s[0] - s[1]) ** 2 + 6500.0 * (s[2] - s[3]) ** 2)

    def potential(q: Array) -> float:
        return 0.5 * float(n.stiffness @ travel(q) ** 2 + n.tyre @ q[3:] ** 2) + bars(travel(q))

    def dissipated(v: Array) -> float:
        return 0.5 * float(n.damping @ travel(v) ** 2)

    return kinetic, potential, dissipated


def test_heave_pitch_and_roll_are_modes_of_the_whole_car() -> None:
    """Seven positions by their energies, all modes at once, contain the three body modes of the two small models."""
    numbers = symmetric_car()
    M, K, C = (hessian(energy, 7) for energy in energies(numbers))
    roots = scipy.linalg.eig(
        np.block([[np.zeros((7, 7)), np.eye(7)], [-K, -C]]), scipy.linalg.block_diag(np.eye(7), M)
    )[0]
    roots = roots[roots.imag > 0]
    whole = sorted((abs(r) / (2 * np.pi), -r.real / abs(r)) for r in roots)
    small = sorted(
        (value(numbers, f"{m}.frequency"), value(numbers, f"{m}.damping_ratio")) for m in ("heave", "pitch", "roll")
    )
    np.testing.assert_allclose(small, whole[:3], rtol=1e-9)
    assert value(numbers, "heave.frequency") < value(numbers, "pitch.frequency")


def test_quarter_car_has_the_roots_of_its_polynomial() -> None:
    """Ride and hop by the characteristic polynomial of two masses, expanded by hand."""
    n = symmetric_car()
    share = 1270.0 * (-1.2 - X[2]) / (X[0] - X[2])
    ms, mu, k, c, kt = share, 112.0, 48e3, 3200.0, 410e3
    roots = np.roots([ms * mu, (ms + mu) * c, ms * (k + kt) + mu * k, c * kt, k * kt])
    found = sorted({round(abs(r) / (2 * np.pi), 10): -r.real / abs(r) for r in roots}.items())
    assert value(n, "ride_frequency.front") == pytest.approx(found[0][0], rel=1e-8)
    assert value(n, "hop_frequency.front") == pytest.approx(found[1][0], rel=1e-8)
    assert value(n, "hop_damping_ratio.front") == pytest.approx(found[1][1], rel=1e-8)
    assert value(n, "damping_ratio.fl") == pytest.approx(found[0][1], rel=1e-8)  # half of everything: the same modes
    assert value(n, "ride_rate.fl") == pytest.approx(1 / (1 / 24e3 + 1 / 205e3))


def test_overdamped_modes_keep_product_and_sum_of_their_roots() -> None:
    """m ẍ + c ẋ + k x with ζ = 2: one mode of that frequency and ratio."""
    (mode,) = modes(np.eye(1), np.array([[4.0]]), np.array([[1.0]]))
    assert (mode.frequency, mode.damping) == (pytest.approx(0.5 / np.pi), pytest.approx(2.0))
    assert modes(np.zeros((1, 1)), np.eye(1), np.eye(1)) == []


def test_roll_and_load_transfer_are_the_least_energy() -> None:
    """Steady cornering with the roll axis on the road: energy less work is least there."""
    n = symmetric_car()
    potential = energies(n)[1]
    h, mass = HEIGHT + 0.26, 1270.0

    def total(q: Array) -> float:
        roll_f, roll_r = (q[3] - q[4]) / (Y[0] - Y[1]), (q[5] - q[6]) / (Y[2] - Y[3])
        sideways = mass * h * q[2] + HEIGHT * (112.0 * roll_f + 96.0 * roll_r)
        return potential(q) - G * sideways - 0.5 * mass * G * h * q[2] ** 2

    gradient = np.array([(total(e) - total(-e)) / 2 for e in np.eye(7)])
    q = -np.linalg.solve(hessian(total, 7), gradient)
    assert value(n, "roll_gradient") == pytest.approx(np.degrees(q[2]), rel=1e-9)
    assert value(n, "load_transfer.front") == pytest.approx(205e3 * (q[3] - q[4]) / 2, rel=1e-9)
    assert value(n, "load_transfer.rear") == pytest.approx(205e3 * (q[5] - q[6]) / 2, rel=1e-9)
    stiffness = np.radians(24e3 * 1.5**2 / 2 + 14e3 * 1.5**2)
    assert value(n, "roll_stiffness.front") == pytest.approx(stiffness)


def test_load_transfer_keeps_the_overturning_moment_with_any_roll_centre() -> None:
    """Track × load transfer of both axles is the moment of all sideways forces, however the parts are shared."""
    vehicle, n = cars.with_tables(VEHICLE), symmetric_car()
    found = {name: v for name, (v, _) in ride_values(n, vehicle).items()}
    centres = [np.mean([roll_centre(vehicle.corners[c]) for c in pair]) for pair in (("fl", "fr"), ("rl", "rr"))]
    assert min(abs(c) for c in centres) > 0.01
    share = np.array([-1.2 - X[2], X[0] + 1.2]) / (X[0] - X[2])
    arm = HEIGHT + 0.26 - float(share @ centres)
    moment = G * (1270.0 * (HEIGHT + 0.26) + 208.0 * HEIGHT + 1270.0 * arm * np.radians(found["roll_gradient"]))
    assert 1.5 * found["load_transfer.front"] + 1.48 * found["load_transfer.rear"] == pytest.approx(moment)
    for axle in ("front", "rear"):
        parts = sum(found[f"load_transfer_{part}.{axle}"] for part in ("elastic", "geometric", "unsprung"))
        assert parts == pytest.approx(found[f"load_transfer.{axle}"])


def test_roll_centre_of_a_swing_axle_is_its_pivot() -> None:
    """A wheel on a swing arm about a pivot at height p in the middle: the roll centre is that pivot."""
    corner, pivot = VEHICLE.corners["rl"], 0.22
    s = np.linspace(-0.05, 0.05, 21)
    half, low = abs(corner.position[1]), corner.height - pivot
    angle = np.arcsin((low + s) / np.hypot(half, low)) - np.arctan2(low, half)
    table = replace(
        cars.with_tables(VEHICLE).corners["rl"].table,  # type: ignore[type-var]
        travel=s, half_track=np.hypot(half, low) * np.cos(angle + np.arctan2(low, half)) - half, half_wheelbase=0 * s,
        toe=0 * s, camber=-angle, pitch=0 * s,
    )  # fmt: skip
    assert roll_centre(replace(corner, table=table)) == pytest.approx(pivot, rel=2e-3)
    assert roll_centre(corner) == 0.0


def test_static_loads_are_in_balance_and_of_least_energy() -> None:
    """Any car, unequal springs and centre of gravity aside: forces and moments balance, found by minimising energy."""
    n = symmetric_car()
    central = np.array([480.0, 0, 0, 2050.0, 0, 2250.0, 0, 0, 0, 1270.0])
    n = replace(
        n, stiffness=n.stiffness * [1.0, 1.1, 0.9, 1.2],
        chassis=move_parameters(central, np.eye(3), np.array([-1.15, 0.05, 0.2])),
    )  # fmt: skip
    load = np.array([value(n, f"static_load.{c}") for c in CORNERS])
    weight = G * np.array([1270.0 + 208.0, 1270 * -1.15 + n.unsprung @ X, 1270 * 0.05 + n.unsprung @ Y])
    np.testing.assert_allclose(np.stack([np.ones(4), X, Y]) @ load, weight, rtol=1e-9)
    K = np.diag(n.stiffness) + n.coupled_stiffness

    def energy(q: Array) -> float:
        body, wheel = np.stack([np.ones(4), X, Y], axis=1) @ q[:3], q[3:]
        s = wheel - body
        lifted = G * 1270.0 * float(np.array([1.0, -1.15, 0.05]) @ q[:3]) + G * float(n.unsprung @ wheel)
        tyres = 0.5 * float(n.tyre @ wheel**2) - float((n.static + G * n.unsprung) @ wheel)
        return 0.5 * float(s @ K @ s) + float(n.static @ s) + tyres + lifted

    q = minimize(energy, np.zeros(7), method="BFGS", options={"gtol": 1e-7}).x
    np.testing.assert_allclose(load, n.static + G * n.unsprung - n.tyre * q[3:], atol=0.5)


def exact_drive() -> PreparedRun:
    """A lively drive of exact signals."""
    rng = np.random.default_rng(8)
    t = np.arange(2000) / 125.0
    return PreparedRun(cars.recording(cars.exact_signals(cars.drive_curves(rng), t), VEHICLE, RIG))


def test_corner_numbers_are_the_laws_best_lines() -> None:
    """Springs, dampers and bars give themselves; other laws the line through force, travel and rate over the run."""
    drive, known = exact_drive(), catalogue(VEHICLE, "hub")
    keys = ("spring.fl", "damper.fl", "offset.fl", "tyre_stiffness.fl", "outboard_mass.fl", "anti_roll_bar.front",
            "coulomb.front", "spring_cubic.fl", "damper_asymmetry.fr", "tyre_progression.front")  # fmt: skip
    model = Model.of(cast(Effect, known[key]) for key in keys)
    fitted = cast(Fit, SimpleNamespace(model=model, runs=(drive,)))
    one = [CornerNumbers.unpack(column) for column in corner_numbers(fitted).T]
    by_key = dict(zip(keys, one, strict=True))
    assert by_key["spring.fl"].stiffness == pytest.approx([1, 0, 0, 0], abs=1e-9)
    assert by_key["damper.fl"].damping == pytest.approx([1, 0, 0, 0], abs=1e-9)
    assert by_key["offset.fl"].static == pytest.approx([1, 0, 0, 0])
    assert by_key["tyre_stiffness.fl"].tyre == pytest.approx([1, 0, 0, 0])
    assert by_key["outboard_mass.fl"].unsprung == pytest.approx([1, 0, 0, 0])
    bar = np.zeros((4, 4))
    bar[:2, :2] = [[1, -1], [-1, 1]]
    np.testing.assert_allclose(by_key["anti_roll_bar.front"].coupled_stiffness, bar, atol=1e-9)
    at = drive.index["suspension.fl"]
    corner = drive.motion.corners["fl"]
    s, v = corner.travel[at], corner.rate[at]
    for key, law in (("coulomb.front", np.tanh(v / 0.01)), ("spring_cubic.fl", s**3)):
        line = np.linalg.lstsq(np.stack([np.ones_like(s), s, v], axis=1), law, rcond=None)[0]
        assert by_key[key].stiffness[0] == pytest.approx(line[1]), key
        assert by_key[key].damping[0] == pytest.approx(line[2]), key
    deflection = drive.motion.corners["fl"].deflection[drive.index["tyre.fl"]]
    assert by_key["tyre_progression.front"].tyre[0] == pytest.approx(2 * deflection.mean())


def truth_numbers(truth: dict[str, Any]) -> CornerNumbers:
    """The reference car's numbers from what it is made of."""
    body, n = truth["chassis"], symmetric_car()
    Ixy, Ixz, Iyz = (body[f"I{p}_tensor"] for p in ("xy", "xz", "yz"))
    central = np.array([body["Ixx"], Ixy, Ixz, body["Iyy"], Iyz, body["Izz"], 0, 0, 0, body["mass_kg"]])
    axles = ("front", "front", "rear", "rear")
    outboard, hub = truth["wheel_rim_and_tyre"]["mass"], truth["hub"]["mass"]
    upright = {"front": truth["front_upright"]["mass"], "rear": 0.0}
    return replace(
        n, chassis=move_parameters(central, np.eye(3), np.array(body["cog_m"])),
        stiffness=np.array([truth["suspension"][a]["k_N_m"] for a in axles]),
        damping=np.array([truth["suspension"][a]["c_Ns_m"] for a in axles]),
        unsprung=np.array([truth["arm"][a]["mass"] + upright[a] + hub + outboard for a in axles]),
        static=np.array([truth["static_suspension_load_N"][c] for c in CORNERS]),
        tyre=np.full(4, truth["tyre_vertical_stiffness_N_m"]),
    )  # fmt: skip


@pytest.fixture(scope="module")
def knowledge(fitted: Fit) -> Knowledge:
    """What all four runs tell."""
    return Knowledge.of(fitted)


@pytest.fixture(scope="module")
def derived(fitted: Fit, knowledge: Knowledge) -> list[Derived]:
    """The reference car's derived values."""
    return derived_values(fitted, VEHICLE, knowledge)


def test_the_reference_car_s_values_are_found(derived: list[Derived], truth: dict[str, Any]) -> None:
    """All determined; within 2 % of the truth, and 85 % of them inside their intervals."""
    wanted = ride_values(truth_numbers(truth), VEHICLE)
    inside: list[bool] = []
    for d in derived:
        target = wanted[d.name][0]
        assert d.determined, (d.name, d.why)
        assert d.value == pytest.approx(target, rel=0.02, abs=1e-9), d.name
        assert d.half < 0.03 * abs(target) + 1e-9, d.name
        inside.append(abs(d.value - target) <= d.half)
    assert np.mean(inside) > 0.85, [d.name for d, good in zip(derived, inside, strict=True) if not good]


@pytest.mark.parametrize("corner", ["fl", "rr"])
def test_a_corner_that_no_run_measures_is_not_taken_for_a_car_without_a_spring(
    models: dict[str, Model], corner: str
) -> None:
    """Roll stiffness, its share and the roll modes stand on all corners they are made of; the other axle's are told."""
    run = cars.piece("rough", 2.0, 14.0)
    run = replace(run, signals={n: s for n, s in run.signals.items() if n != f"wheel.{corner}.force"})
    fitted = fit(models["base"], [PreparedRun.of(run, VEHICLE, RIG)])
    found = {d.name: d for d in derived_values(fitted, VEHICLE, Knowledge.of(fitted))}
    own, other = ("front", "rear") if corner == "fl" else ("rear", "front")
    for name in (f"roll_stiffness.{own}", "roll_stiffness_share.front", "roll_gradient", f"ride_rate.{corner}"):
        assert not found[name].determined, name
        assert f"{corner} needs: wheel.{corner}.force" in not_derived(found[name].why)
    assert found[f"roll_stiffness.{other}"].determined


def test_frequencies_without_travel_are_unknown_not_zero(models: dict[str, Model]) -> None:
    """No spring or tyre is measured: every frequency lacks the suspension's rows; what is zero by geometry is known."""
    run = cars.piece("rough", 2.0, 8.0)
    run = replace(run, signals={n: s for n, s in run.signals.items() if not n.startswith("laser.")})
    fitted = fit(models["base"], [PreparedRun.of(run, VEHICLE, RIG)], FitOptions(unbias=False))
    found = {d.name: d for d in derived_values(fitted, VEHICLE, Knowledge.of(fitted))}
    for name in ("hop_frequency.rear", "heave.frequency", "roll.frequency", "ride_rate.rl"):
        assert not found[name].determined, name
        assert "needs: laser." in not_derived(found[name].why)
    assert found["load_transfer_geometric.rear"].determined


def test_intervals_are_those_of_drawn_parameters(fitted: Fit, knowledge: Knowledge, derived: list[Derived]) -> None:
    """The delta method against 200 draws of the parameters."""
    table, rng = corner_numbers(fitted), np.random.default_rng(3)
    drawn = rng.multivariate_normal(fitted.physics, knowledge.covariance, 200, method="svd") @ table.T
    values = np.array([[v for v, _ in ride_values(CornerNumbers.unpack(x), VEHICLE).values()] for x in drawn])
    half = np.array([d.half for d in derived])
    moving = half > 1e-9
    np.testing.assert_allclose(1.96 * values.std(axis=0)[moving], half[moving], rtol=0.2)


def test_a_value_names_the_effects_that_it_depends_on(derived: list[Derived]) -> None:
    """A front spring rate on that spring alone; the axle's roll stiffness on its bar too, and on nothing behind."""
    by_name = {one.name: set(one.effects) for one in derived}
    assert "spring.fl" in by_name["ride_rate.fl"]
    assert not by_name["ride_rate.fl"] & {"spring.rl", "anti_roll_bar.rear", "damper.fl"}
    assert {"spring.fl", "spring.fr", "anti_roll_bar.front"} <= by_name["roll_stiffness.front"]
    assert not by_name["roll_stiffness.front"] & {"spring.rl", "anti_roll_bar.rear", "damper.fl"}


def test_damper_curves_and_ranges(fitted: Fit, knowledge: Knowledge, truth: dict[str, Any]) -> None:
    """Linear dampers give straight lines of the true slope over the rates seen; ranges hold what was driven."""
    for corner, curve in damper_curves(fitted, knowledge).items():
        c = truth["suspension"]["front" if corner[0] == "f" else "rear"]["c_Ns_m"]
        np.testing.assert_allclose(curve.force, fitted.value(f"damper.{corner}.c") * curve.rate, atol=1e-9)
        assert np.all(np.abs(curve.force - c * curve.rate) <= 1.6 * curve.half + 1e-9), corner
    found = {r.name: r for r in ranges(fitted)}
    assert found["speed"].low > 20.0
    assert found["speed"].high < 40.0
    assert found["travel.fl"].low < -0.02
    assert found["travel.fl"].high > 0.02
    assert found["load.fl"].low < 4059 - 40 * 9.81 < found["load.fl"].high


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("mass", [0.0, 1e-318, -1200.0])
def test_an_impossible_mass_gives_no_values_of_the_ride_and_no_warning(mass: float) -> None:
    """As fits to channels that read 0 throughout have it."""
    numbers = symmetric_car()
    numbers = replace(numbers, chassis=mass / 1270.0 * numbers.chassis)
    assert not np.isfinite(value(numbers, "heave.frequency"))
    assert not np.isfinite(value(numbers, "roll.frequency"))


@pytest.mark.filterwarnings("error")
def test_a_value_with_an_infinite_derivative_has_none_by_any_parameter() -> None:
    by_number = np.array([[np.inf, 1.0], [2.0, 1.0], [-np.inf, np.nan]])
    slopes = _by_parameter(by_number, np.array([[0.0, 1.0, 3.0], [1.0, 0.0, 2.0]]))
    assert np.all(np.isnan(slopes[[0, 2]]))
    assert slopes[1].tolist() == [1.0, 2.0, 8.0]
