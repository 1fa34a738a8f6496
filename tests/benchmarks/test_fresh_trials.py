"""The fresh benchmark's trials: drawn from their number alone, testable, and telling nothing of what is hidden."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from benchmarks.fresh import drives, making, sizing
from benchmarks.fresh.cars import SPREAD, fresh_car, fresh_rig
from benchmarks.fresh.laws import COUNTS, FAULTS, LAWS, UNLISTED, drawn_parts, parts_of
from benchmarks.fresh.making import class_of, make, stream, write
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.catalogue import catalogue
from lacet.simulate import KINDS, find_car, make_manoeuvre
from lacet.simulate import run as simulate_drive
from lacet.simulate.vehicle_file import vehicle_text

pytest.importorskip("mujoco")
ALLOWED = {name: 0.01 for name, *_ in FAULTS}


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs of 1.5 s, and whatever size was drawn."""
    monkeypatch.setattr(drives, "DURATION", (1.5, 1.6))
    monkeypatch.setattr(making, "TESTABLE", 0.0)
    monkeypatch.setattr(making, "MOST", math.inf)


def _bytes(folder: Path) -> dict[str, bytes]:
    return {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}


@pytest.mark.usefixtures("short")
@pytest.mark.slow  # a minute
def test_a_trial_is_the_same_bytes_each_time_and_tells_nothing(tmp_path: Path) -> None:
    trial = make("development", 1)
    first, again = _bytes(write(trial, tmp_path / "a")), _bytes(write(make("development", 1), tmp_path / "b"))
    assert first == again
    assert set(first) == {
        "rig.toml", "vehicle.toml", *(f"used/{run}.parquet" for run in trial.used),
        *(f"held/{run}.parquet" for run in trial.held),
    }  # fmt: skip
    assert (len(trial.used), len(trial.held), len(trial.parts) > 0) == (4, 1, True)
    for name, data in first.items():
        for part in trial.parts:
            assert part.hidden.effect.encode() not in data, name
        assert not any(word in data for word in (b"hidden", b"development", b"root_lambda")), name
    other = _bytes(write(make("test", 1), tmp_path / "c"))
    assert all(other[name] != first[name] for name in ("rig.toml", "vehicle.toml"))


def test_streams_of_sets_trials_and_purposes_are_disjoint() -> None:
    names = [(s, n, word) for s in making.SETS for n in range(50) for word in ("car", "effects")]
    draws = {stream(*name).integers(2**63) for name in names}
    assert len(draws) == len(names)
    assert stream("test", 3).integers(2**63) == stream("test", 3).integers(2**63)
    with pytest.raises(ValueError, match="no set is called"):
        stream("training", 0)


def test_classes_hide_as_many_effects_as_they_say_and_not_one_twice() -> None:
    for number in range(9 * 12):
        kind = class_of(number)
        parts = drawn_parts(kind, stream("development", number), ALLOWED)
        low, high = COUNTS[kind]
        assert low <= len({part.law.name for part in parts if part.listed}) <= high, kind
        assert len({part.law.name for part in parts if not part.listed}) == ("unlisted" in kind)
        assert len({part.hidden.name for part in parts}) == len(parts)
        assert sum(part.hidden.of_sensor for part in parts) <= 1
    counts = Counter(class_of(number) for number in range(90))
    assert set(counts) == set(COUNTS)
    assert set(counts.values()) == {10}


def test_the_catalogue_has_the_listed_laws_and_none_of_the_others(tmp_path: Path) -> None:
    file = tmp_path / "vehicle.toml"
    file.write_text(vehicle_text(find_car("peugeot-406")), encoding="utf-8")
    known = catalogue(Vehicle.load(file), "contact")
    families = {effect.name for effect in known.values()}
    for law in LAWS:
        assert set(law.families) & families, law.name
        for family, values in law.values.items():
            of_it = [effect for effect in known.values() if effect.name == family]
            for effect in of_it:
                named = {parameter.name.removeprefix(f"{effect.key}.") for parameter in effect.parameters}
                assert set(values) <= named, law.name
            constants = {*law.constants, *law.shape} & {"gap", "v0", "n"}
            assert family != law.families[0] or constants <= set(of_it[0].grids), law.name
    assert {name for name, *_ in FAULTS} <= set(known)
    assert not {law.kind for law in UNLISTED} & families
    assert {law.kind for law in (*LAWS, *UNLISTED)} <= set(KINDS)


def test_every_car_is_another_one_within_the_spread() -> None:
    like = find_car("peugeot-406")
    cars = [fresh_car(np.random.default_rng(seed), "fresh") for seed in range(20)]
    for name in ("stiffness", "damping", "tyre_stiffness", "outboard_mass", "cornering"):
        ratios = [getattr(car.front, name) / getattr(like.front, name) for car in cars]
        assert len(set(ratios)) == len(cars)
        assert max(abs(ratio - 1.0) for ratio in ratios) <= SPREAD + 1e-6
        assert max(ratios) - min(ratios) > SPREAD
    for car in cars:
        assert car.axle("fl").stiffness != car.axle("fr").stiffness
        moments = np.linalg.eigvalsh(np.array(car.chassis.tensor))
        assert moments[0] > 0.0
        assert moments[2] < moments[0] + moments[1]
    rigs = {fresh_rig(np.random.default_rng(seed), "fresh").text for seed in range(5)}
    assert len(rigs) == 5


def test_root_lambda_is_that_of_a_law_beside_the_others() -> None:
    car, rig = find_car("peugeot-406"), Rig.load("peugeot-406")
    motion = simulate_drive(car, make_manoeuvre("rough", duration=4.0), [], 1)
    rng = np.random.default_rng(0)
    by_name = {law.name: law for law in LAWS}
    bar = parts_of(by_name["anti-roll bar"], rng)[0].of_size(8000.0)
    alike = bar.of_size(16000.0)
    friction = parts_of(by_name["friction"], rng)[0].of_size(50.0)
    alone, twice = sizing.roots([bar], [motion], rig)[0], sizing.roots([alike], [motion], rig)[0]
    assert twice == pytest.approx(2.0 * alone)
    assert sizing.roots([bar], [motion, motion], rig)[0] == pytest.approx(math.sqrt(2.0) * alone, rel=1e-6)
    beside = sizing.roots([bar, friction], [motion], rig)
    assert 0.5 * alone < beside[0] <= alone
    assert max(sizing.roots([bar, alike], [motion], rig)) < 1e-3 * alone  # neither can be told from the other
    # By hand: the bar's force on both front corners, their spring, damper and offset taken out of it.
    total, slow = 0.0, butter(4, 5.0, fs=250.0, output="sos")
    for i, corner in enumerate(("fl", "fr")):
        s, rate = motion.travel[::4, 0], motion.travel[::4, 1]
        own = np.stack([s[:, i], rate[:, i], np.ones(len(s))], axis=1)
        force = 8000.0 * (s[:, i] - s[:, 1 - i])
        own[:, :2], force = sosfiltfilt(slow, own[:, :2], axis=0), sosfiltfilt(slow, force)
        left = force - own @ np.linalg.lstsq(own, force)[0]
        axle = car.axle(corner)
        noise = math.hypot(30.0, math.hypot(axle.stiffness, axle.damping * sizing.BAND) * 0.0003)
        total += float(left @ left) / noise**2
    assert alone == pytest.approx(math.sqrt(total), rel=1e-6)
