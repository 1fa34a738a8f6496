"""Telling effects apart: T by brute force, identities, and what a tie means for the pick."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from lacet.identify.design.discrimination import (
    Compared,
    Present,
    Question,
    Separations,
    planned_run,
    present_runs,
    weighted_run,
    wrong_pick,
)
from lacet.identify.effects.base import Bend, Parameter, SuspensionForce
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.assembly import Piece
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, fit
from lacet.identify.validation.noise_floor import NoiseFloor, floor_of
from tests.identify.cars import reference_car
from tests.support.tables import piece

VEHICLE, RIG = reference_car()
KNOWN = catalogue(VEHICLE, "hub")


@cache
def drive(name: str) -> PreparedRun:
    return PreparedRun.of(piece(name, 5.0, 12.0), VEHICLE, RIG)


@cache
def fitted() -> Fit:
    bars = [KNOWN["anti_roll_bar.front"], KNOWN["anti_roll_bar.rear"]]
    return fit(Model.of([*base_model(VEHICLE, drive("sine").recording.reference), *bars]), [drive("sine")])


@cache
def floor() -> NoiseFloor:
    return floor_of(fitted(), 6)


STOP = Compared(replace(KNOWN["bump_stop.front"], shape={"gap": 0.02}), np.array([5e4]))
CUBIC = Compared(KNOWN["spring_cubic.front"], np.array([4e6]))
TYRE = Compared(KNOWN["tyre_damping.front"], np.array([300.0]))
LATE = Compared(KNOWN["sensor_latency.laser"], np.array([0.004]))


def told(*compared: Compared, planned: str = "rough") -> tuple[Question, Present, Array]:
    question = Question(fitted(), compared)
    return question, present_runs(question, floor()), planned_run(question, drive(planned)).lasting()


@cache
def pair(which: str) -> tuple[Question, Present, Array]:
    return told(*{"springs": (CUBIC, STOP), "late": (TYRE, LATE)}[which])


def brute(
    question: Question, y_of: int, others: list[slice], without: list[int], *runs: tuple[Piece, dict[str, float]]
):
    """T from all samples of all runs stacked, each run's zeros in columns of their own."""
    parts, priors = [], []
    for held, sigma in runs:
        assert held.zeros is not None
        parts.append(np.concatenate([block / sigma[row] for row, block in question.columns(held)]))
        priors.append(held.zeros.sigma)
    z = sum(len(p) for p in priors)
    stacked = np.zeros((sum(len(p) for p in parts) + z + len(question.known), z + question.width))
    row, place = 0, 0
    for part, prior in zip(parts, priors, strict=True):
        stacked[row : row + len(part), place : place + len(prior)] = part[:, : len(prior)]
        stacked[row : row + len(part), z:] = part[:, len(prior) :]
        row, place = row + len(part), place + len(prior)
    stacked[row : row + z, :z] = np.diag(1.0 / np.concatenate(priors))
    stacked[row + z :, z:] = question.known
    place = question.places[y_of][0]
    y = stacked[:, z + place.start : z + place.stop] @ question.compared[y_of].values
    least = np.inf
    for other in others:
        columns = [*range(z), *(z + i for i in range(question.first) if i not in without)]
        columns += [z + i for i in range(other.start, other.stop)]
        X = stacked[:, columns]
        X = X[:, np.any(X != 0.0, axis=0)]
        X = X / np.linalg.norm(X, axis=0)
        x = np.linalg.lstsq(X, y, rcond=1e-13)[0]
        least = min(least, float(np.sum((y - X @ x) ** 2)))
    return least


@pytest.mark.parametrize("which", ["springs", "late"])
@pytest.mark.parametrize(("a", "b"), [(0, 1), (1, 0)])
def test_it_is_the_least_squares_of_all_samples(which: str, a: int, b: int):
    question, _, _ = pair(which)
    sigma = {row: floor().sigma[row] for row in drive("sine").rows}
    held = list(fitted().assembly.pieces_of(0))
    one = weighted_run(question, held, sigma).lasting()
    same = {row: 1.3 * sigma[row] for row in drive("sine").rows}
    other = weighted_run(question, held, same).lasting()
    found = Separations(question, None, one, other).separation(a, b)
    expected = brute(question, a, question.places[b], question.own(a, b), (held[0], sigma), (held[0], same))
    assert found == pytest.approx(expected, rel=1e-8)
    assert found > 1e-3


@pytest.mark.parametrize("which", ["springs", "late"])
def test_an_effect_is_not_told_from_itself_and_a_run_never_makes_it_worse(which: str):
    question, now, then = pair(which)
    before, after = Separations(question, now), Separations(question, now, then)
    for a, b in ((0, 1), (1, 0)):
        size = after.size(a) ** 2
        assert after.separation(a, a) < 1e-9 * max(1.0, size)
        assert before.separation(a, b) <= after.separation(a, b) * (1 + 1e-9)
    assert before.least() == min(before.separation(0, 1), before.separation(1, 0))
    assert before.size(0) <= after.size(0) * (1 + 1e-9)
    # What stands out alone is more than what stands out beside a rival.
    assert Separations(*pair("springs")).separation(0, 1) <= Separations(*pair("springs")).size(0) ** 2 * (1 + 1e-9)


class Pounds(SuspensionForce):
    """The bump stop of the front with its stiffness in other units."""

    name = "bump_stop_lbf"
    bend = Bend.TRAVEL
    factor = 175.127

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (self.named("k", "lbf/in", -3e3, 3e3),)

    def law(self, travel: Array, rate: Array) -> Array:
        return self.factor * np.maximum(0.0, travel - 0.02)


def test_units_do_not_matter():
    metric, now, then = pair("springs")
    stop = Compared(replace(KNOWN["bump_stop.front"], shape={"gap": 0.02}), STOP.values)
    imperial, other_now, other_then = told(CUBIC, Compared(Pounds("front"), stop.values / Pounds.factor))
    size = Separations(metric, now, then).size(1)
    assert Separations(imperial, other_now, other_then).size(1) == pytest.approx(size, rel=1e-6)
    assert Separations(imperial, other_now, other_then).separation(1, 0) == pytest.approx(
        Separations(metric, now, then).separation(1, 0), rel=1e-6
    )


def test_it_grows_with_the_square_of_the_size():
    question, now, then = pair("springs")
    double = Question(fitted(), [Compared(CUBIC.effect, 2.0 * CUBIC.values), STOP])
    one, two = (Separations(q, now, then) for q in (question, double))
    assert two.separation(0, 1) == pytest.approx(4.0 * one.separation(0, 1), rel=1e-9)
    assert two.separation(1, 0) == pytest.approx(one.separation(1, 0), rel=1e-9)
    assert one.size(0, 2.0 * CUBIC.values) == pytest.approx(two.size(0), rel=1e-12)


def test_it_grows_with_the_time_driven():
    """In proportion, once what is known beforehand counts for little; in less where priors do the separating."""
    question, _, _ = pair("springs")
    run = planned_run(question, drive("rough"))
    at = [
        Separations(question, None, run.lasting(run.edges + share * run.seconds)).separation(0, 1)
        for share in (1e4, 2e4, 1.0, 2.0)
    ]
    assert at[1] / at[0] == pytest.approx(2.0, rel=0.02)
    assert at[2] <= at[3] <= 2.0 * at[2] * (1 + 1e-9)
    assert Separations(question, None, run.lasting(0.5 * run.edges)).separation(0, 1) == pytest.approx(0.0, abs=1e-12)


def test_what_is_noise_in_the_columns_sets_nothing_apart():
    """A law that follows a rate's noise beyond the filter stands out by nothing that a run without noise has not."""
    question, now, _ = pair("springs")
    bare = Present(now.root, np.zeros_like(now.noise))
    sound, all_of_it = Separations(question, now), Separations(question, bare)
    assert 0.9 * all_of_it.size(0) < sound.size(0) < all_of_it.size(0)
    nothing = Present(np.zeros_like(now.root), now.root)
    assert Separations(question, nothing).size(0) == 0.0
    torsion = Compared(KNOWN["chassis_torsion"], np.array([q.largest for q in KNOWN["chassis_torsion"].parameters]))
    noisy = Question(fitted(), [torsion])
    told_now = present_runs(noisy, floor())
    as_if = Separations(noisy, Present(told_now.root, np.zeros_like(told_now.noise))).size(0)
    assert as_if > 8.0
    assert Separations(noisy, told_now).size(0) < 0.5 * as_if


def test_noise_makes_it_smaller_by_its_square():
    question, now, _ = pair("springs")
    louder = present_runs(question, floor(), dict.fromkeys(floor().sigma, 2.0))
    quiet, loud = Separations(question, now), Separations(question, louder)
    assert 0.2 < loud.separation(0, 1) / quiet.separation(0, 1) < 0.5


def test_a_fault_is_compared_free_of_its_own_tolerance():
    """Its tolerance stays where another question is asked: by itself it stands out by no more than its size in σ."""
    question, now, then = pair("late")
    assert question.own(1)
    assert not question.own(0)
    late = Separations(question, now, then)
    tolerance = RIG.tolerance("laser.fl.ground", "latency")
    assert late.size(1) <= np.sqrt(len(question.own(1))) * LATE.values[0] / tolerance * (1 + 1e-6)
    assert late.separation(1, 0) > 0.0


def test_the_wrong_pick_is_that_of_two_losses():
    """Losses of A and B beside noise, drawn: B leaves less as often as Φ(−√T/2) says."""
    rng = np.random.default_rng(4)
    d = rng.normal(size=60)
    for T in (1.0, 4.0, 10.0):
        shift = d * np.sqrt(T / (d @ d))
        noise = rng.normal(size=(20000, 60))
        worse = np.sum((noise + shift) ** 2, axis=1) < np.sum(noise**2, axis=1)
        difference = np.sum((noise + shift) ** 2, axis=1) - np.sum(noise**2, axis=1)
        assert np.mean(worse) == pytest.approx(wrong_pick(T), abs=0.01)
        assert np.mean(difference) == pytest.approx(T, abs=0.15)
        assert np.std(difference) == pytest.approx(2.0 * np.sqrt(T), rel=0.03)
    assert wrong_pick(0.0) == 0.5
    assert wrong_pick(25.0) == pytest.approx(0.0062, abs=1e-4)
