"""Sensors' faults among the effects found: which stand, and which the instruments show or deny."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from lacet.identify.car.rows import Row
from lacet.identify.effects.base import Effect, Implausible, SensorFault
from lacet.identify.progress import Progress, silent
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sums.prepared_runs import recording_without_faults, without_faults
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.joint.refits import (
    Joint,
    _tests_of_some,
    fitted_with,
    not_part_of_the_rest,
    only_plausible,
)
from lacet.identify.selection.joint.rounds import found_together, started_with, without_denied_faults
from lacet.identify.selection.rest import (
    AddedLaw,
    Departure,
    Rest,
)
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.validation.channels.speed_agreement import AgreeingSize
from lacet.identify.validation.noise_floor import NoiseFloor
from tests.identify.exact_car import KNOWN, driven, exact, fit_of
from tests.identify.selection.exact_ranking import DRAWS
from tests.identify.selection.joint.three_hidden import HIDDEN, KEYS, LAWS, WithFault, with_all


def test_a_law_stands_in_a_fit_beside_tolerances_that_the_runs_show_and_a_fault_does_not():
    """Both as large as the sheet allows instruments to be wrong, and a hundred times their own standard error."""
    effects = [KNOWN["anti_roll_bar.front"], KNOWN["sensor_gain.hub.fl"]]

    def with_effects(kept: Sequence[Effect]) -> SimpleNamespace:
        one = np.eye(len(kept))
        names = [effect.parameters[0].name for effect in kept]
        return SimpleNamespace(
            theta=np.ones(len(kept)), covariance=1e-4 * one, covariance_sheet=one, model=SimpleNamespace(names=names)
        )

    _, kept = fitted_with(cast(Fit, SimpleNamespace(with_effects=with_effects)), effects, len(KEYS), DRAWS)
    assert [effect.key for effect in kept] == ["anti_roll_bar.front"]


@pytest.mark.parametrize(("change", "stands"), [(0.1, True), (1.0, False)])
def test_beside_a_rest_a_fault_that_rows_of_other_kinds_want_back_is_no_name(
    subset: Joint, with_fault: WithFault, monkeypatch: pytest.MonkeyPatch, change: float, stands: bool
):
    """And no other fault is tried in its place; a law of the car is."""
    fault, other = KNOWN["sensor_gain.hub.fl"], "sensor_gain.hub.rr"
    _, joint = with_fault(fault.key, "coulomb.rear")
    rest = Rest.of(joint.space, joint.laws)
    assert without_denied_faults(joint, replace(rest, unlisted=()), 0)[0] is joint
    asked: list[object] = []

    def departures(
        space: ScoreTests, effects: Sequence[Effect], rows: Sequence[Row], removed: Mapping[str, float]
    ) -> list[Departure]:
        asked.append([effect.key for effect in effects])
        assert rows
        assert all(row.kind != "chassis" for row in rows)
        return [Departure(fault.key, change**2 * 5000.0, np.full(DRAWS, 2.0), 5000.0)]

    monkeypatch.setattr("lacet.identify.selection.joint.rounds.departures_on_rows", departures)
    found, _ = without_denied_faults(joint, replace(rest, unlisted=(Row("chassis.my"),)), 0)
    assert asked == [[fault.key]]
    assert (fault.key in found.keys) == stands
    assert set(subset.keys) <= set(found.keys)
    if not stands:
        assert {fault.key, other} <= found.dropped
        assert found.space.effects.keys().isdisjoint(found.dropped)
        assert "coulomb.rear" in found.space.effects


@pytest.mark.parametrize("beside_a_rest", [False, True])
@pytest.mark.parametrize(
    ("removed", "change", "sigma", "stands"),
    [(0.08, 0.1, 0.01, True), (0.08, 1.0, 2.0, True), (0.005, 1.0, 0.01, True), (0.08, 1.0, 0.01, False)],
)
def test_a_fault_that_the_speed_sensor_denies_is_no_name(
    subset: Joint, with_fault: WithFault, monkeypatch: pytest.MonkeyPatch, removed: float, change: float, sigma: float,
    stands: bool, beside_a_rest: bool,
):  # fmt: skip
    """Within a fifth of its size, or by the chance of either, it may differ. Other faults may be tried where nothing is
    unlisted."""
    fault, other = KNOWN["sensor_gain.accel.x"], "sensor_gain.hub.rr"
    fitted, joint = with_fault(fault.key, "coulomb.rear")
    joint = replace(joint, sizes={fault.key: removed}, shown=frozenset({"sensor_position.imu.x"}))
    at = fitted.model.names.index(f"{fault.key}.g")
    known = float(np.sqrt(fitted.covariance[at, at] + fitted.covariance_sheet[at, at]))
    assert 0.005 < 2.5 * known < 0.01
    size = removed + float(fitted.theta[at])

    class Agreement:
        @staticmethod
        def of(runs: Sequence[PreparedRun]) -> Agreement:
            assert list(runs) == list(fitted.runs)
            return Agreement()

        def sizes(self, keys: Collection[str]) -> dict[str, AgreeingSize]:
            assert set(keys) == {fault.key, "sensor_position.imu.x"}
            return {fault.key: AgreeingSize((1.0 - change) * size - removed, sigma * abs(size))}

    monkeypatch.setattr("lacet.identify.selection.joint.rounds.SpeedAgreement", Agreement)
    monkeypatch.setattr("lacet.identify.selection.joint.rounds._denied_by_rows", lambda *_: set())
    rest = replace(Rest.of(joint.space, joint.laws), unlisted=(Row("chassis.my"),) if beside_a_rest else ())
    found, _ = without_denied_faults(joint, rest, 0)
    assert (fault.key in found.keys) == stands
    assert set(subset.keys) <= set(found.keys)
    if not stands:
        assert fault.key in found.dropped
        assert (other in found.dropped) == beside_a_rest


def test_what_the_instruments_show_stands_whatever_rows_and_sizes_say(
    with_fault: WithFault, monkeypatch: pytest.MonkeyPatch
):
    fault = KNOWN["sensor_gain.hub.fl"]
    _, joint = with_fault(fault.key)
    joint = replace(joint, shown=frozenset({fault.key}))
    for name in ("_denied_by_rows", "_denied_by_speed"):
        monkeypatch.setattr(
            f"lacet.identify.selection.joint.rounds.{name}", lambda joint, *rest: {fault.key for fault in rest[-1]}
        )
    rest = replace(Rest.of(joint.space, joint.laws), unlisted=(Row("chassis.my"),))
    assert without_denied_faults(joint, rest, 0)[0] is joint
    wrong = Implausible(fault.parameters[0], 0.3, 0.4)
    no_sensor = [replace(one, implausible=wrong, force=0.0) for one in joint.faults]
    monkeypatch.setattr(Joint, "faults", property(lambda joint: no_sensor))
    assert only_plausible(joint, 0) is joint
    monkeypatch.setattr(Rest, "beside", lambda rest, law: np.inf if law.key == fault.key else 0.0)
    monkeypatch.setattr("lacet.identify.selection.joint.refits._not_standing_elsewhere", lambda *_: set())
    assert not_part_of_the_rest(joint, rest, 0)[0] is joint


def test_other_starts_begin_with_what_the_instruments_show(subset: Joint, monkeypatch: pytest.MonkeyPatch):
    first = subset.first
    begun: list[tuple[str, ...]] = []

    def fitted_together(joint: Joint, seed: int, progress: Progress) -> Joint:
        begun.append(tuple(effect.key for effect in joint.added))
        return replace(joint, effects=joint.added[1:])

    monkeypatch.setattr("lacet.identify.selection.joint.rounds.fitted_together", fitted_together)
    joint = replace(subset, shown=frozenset({"sensor_gain.hub.fl"}))
    other = started_with(joint, first.effects["coulomb.rear"], 0)
    assert begun == [("coulomb.rear", "sensor_gain.hub.fl")]
    assert not other.effects
    assert other.shown == joint.shown


@pytest.mark.parametrize("wrong", [0.0, 0.05])
def test_a_search_begins_with_a_fault_that_the_speed_sensor_shows(
    fitted: Fit, floor: NoiseFloor, monkeypatch: pytest.MonkeyPatch, wrong: float
):
    """Any fault will do for one; it is in the fit if it stands there, and if not it may be found later."""
    fault = KNOWN["sensor_gain.hub.rr"]
    assert isinstance(fault, SensorFault)
    record = recording_without_faults(with_all(HIDDEN), [fault], np.array([-wrong]))
    drive = fit_of(driven(record, 3), fitted)
    space = ScoreTests.of(Linearisation.of(drive, floor), [*LAWS, fault], 0)
    begun: list[Joint] = []
    monkeypatch.setattr(
        "lacet.identify.selection.joint.rounds.SpeedAgreement",
        SimpleNamespace(of=lambda runs: SimpleNamespace(beyond_sheet=lambda significance: [fault])),
    )
    monkeypatch.setattr(
        "lacet.identify.selection.joint.rounds.continued", lambda joint, *_: begun.append(joint) or joint
    )
    found_together(space, 0)
    (first,) = begun
    assert first.keys == ((fault.key,) if wrong else ())
    assert first.shown == {fault.key}
    assert not first.dropped


def test_a_removed_latency_has_its_column_where_nothing_else_is_tried(subset: Joint):
    """Any effect of the first tests will do for one: what remains of it is estimated with the others."""
    removed = KNOWN["sensor_gain.hub.rr"]
    joint = replace(subset, removed=(removed,))
    space = _tests_of_some(joint, joint.fit, (), 0, silent)
    assert [trial.effect.key for trial in space.columns.selected] == [removed.key]
    assert not space.best_tests


def test_a_fault_that_a_model_does_without_is_in_its_runs_again():
    """To first order of what was removed."""
    gain = KNOWN["sensor_gain.hub.fl"]
    plain = fit_of(driven(exact(), 0))
    wrong = replace(plain, runs=tuple(without_faults(run, [gain], np.array([-0.03])) for run in plain.runs))
    found = wrong.with_effect(gain)
    removed = found.refitted_to(found)
    values = [
        one.runs[0].recording.signals.value["laser.fl.hub"]
        for one in (wrong, removed, removed.without_effects([gain.key], {gain.key: float(found.theta[-1])}))
    ]
    assert found.theta[-1] == pytest.approx(0.03, abs=0.003)
    assert np.max(np.abs(values[1] / values[0] - 1.0)) > 0.02
    np.testing.assert_allclose(values[2], values[0], rtol=2e-3)
    assert removed.without_effects([gain.key]).runs[0].recording is removed.runs[0].recording


@pytest.mark.parametrize(("removed", "stands"), [(0.05, True), (1.1, False)])
def test_a_fault_of_a_size_that_no_sensor_has_is_not_found(
    subset: Joint, removed: float, stands: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its size is what was removed from the runs and what remains in the fit: a scale of 1 + 1.1 is none."""
    gain = KNOWN["sensor_gain.hub.fl"]
    fault = replace(subset.laws[0], key=gain.key, values=np.array([0.01]), force=100.0, implausible=None)

    def faults(_: ScoreTests, gone: Mapping[str, float]) -> tuple[AddedLaw, ...]:
        return (
            replace(fault, implausible=gain.implausible(fault.values + gone.get(gain.key, 0.0), np.array([0.001]))),
        )

    monkeypatch.setattr("lacet.identify.selection.joint.refits.added_faults", faults)
    monkeypatch.setattr("lacet.identify.selection.joint.refits.without_effects", lambda *_: subset)
    joint = replace(subset, effects=(*subset.effects, gain), sizes={gain.key: removed})
    assert (only_plausible(joint, 0) is joint) == stands
