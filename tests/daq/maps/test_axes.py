"""Signs that a drive does not show: those of the instrument's other channels, or of the quantity's own derivative."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lacet.daq.channels import CHANNELS
from lacet.daq.maps.axes import DISAGREEING, SAME_INSTRUMENT, by_others, of_one_kind, turns
from lacet.daq.maps.guess import ACCEPTED, Guess, guess
from lacet.daq.run import Run
from lacet.daq.sources.shares import SharedSource, Stored
from lacet.daq.sources.source import Listed
from tests.support.tables import piece

GERMAN = {
    "wheel.force": "Radkraft_F{a}_{c}", "wheel.moment": "Radmoment_M{a}_{c}", "wheel.speed": "Raddrehzahl_{c}",
    "camera.steer": "Lenkwinkel_{c}", "imu.accel": "Beschleunigung_{a}", "imu.rate": "{gier}rate",
    "imu.attitude": "{gier}winkel", "correvit.speed": "v_{a}",
}  # fmt: skip
CORNERS = {"fl": "VL", "fr": "VR", "rl": "HL", "rr": "HR"}


def in_axes(run: Run, down: bool, wrapped: bool = False) -> SharedSource:
    """A German log of a run in the axes of ISO 8855, or `down` those of SAE J670; `wrapped` : yaw from 0 to 2π."""
    source = SharedSource(Path("drawn.mat"))
    for name, signal in run.signals.items():
        channel = CHANNELS[name]
        if channel.family not in GERMAN:
            continue
        for k, column in enumerate(channel.columns):
            axis = channel.components[k] if channel.components else ""
            words = {"a": axis, "c": CORNERS.get(channel.corner or "", "")}
            words["gier"] = ("Wank", "Nick", "Gier")[k] if channel.components else ""
            values = (-1.0 if down and turns(column) else 1.0) * signal.values[:, k]
            if wrapped and column == "imu.attitude.yaw":
                values = np.mod(values, 2.0 * np.pi)
            own = GERMAN[channel.family].format(**words)
            source.add(Listed(own, channel.unit, len(signal.t)), Stored.of(values), "t", Stored.of(signal.t))
    return source


def signs(found: list[Guess]) -> dict[str, int]:
    return {one.column: -1 if one.expression.startswith("-") else 1 for one in found if one.column}


@pytest.mark.parametrize("run", ["sine", "sweep", "liftoff"])
def test_a_log_in_the_axes_of_sae_has_every_sign_of_them_proposed(run: str) -> None:
    """Moments as forces, rear steer as front, pitch and yaw as their rates: also where nothing shows them."""
    found = signs(guess(in_axes(piece(run, 3.0, 28.0), down=True)))
    assert len(found) >= 40
    assert {column for column, sign in found.items() if sign != (-1 if turns(column) else 1)} == set()


@pytest.mark.parametrize("run", ["sine", "sweep"])
def test_in_those_of_iso_none_is_turned(run: str) -> None:
    assert set(signs(guess(in_axes(piece(run, 3.0, 28.0), down=False))).values()) == {1}


@pytest.mark.parametrize("wrapped", [False, True])
def test_an_angle_s_sign_is_sure_where_its_rate_s_is(wrapped: bool) -> None:
    """Also of a heading from 0 to 360°, and of a pitch whose rate is mostly that of a rolled car that yaws."""
    found = {one.column: one for one in guess(in_axes(piece("sine", 3.0, 28.0), down=True, wrapped=wrapped))}
    for angle, sign in (("roll", 1), ("pitch", -1), ("yaw", -1)):
        one = found[f"imu.attitude.{angle}"]
        assert (one.expression.startswith("-"), one.probability >= ACCEPTED) == (sign < 0, True)


def test_what_the_others_of_an_instrument_say_is_not_sure_enough_to_be_accepted() -> None:
    forces = {f"wheel.{c}.force.y": (-1, 0.97) for c in CORNERS}
    assert by_others("wheel.fl.moment.y", forces, {}) == (-1, SAME_INSTRUMENT)
    assert SAME_INSTRUMENT < ACCEPTED
    assert by_others("wheel.fl.moment.x", forces, {}) is None


def test_instruments_that_follow_no_system_of_axes_say_nothing() -> None:
    mixed = {"wheel.fl.force.y": (-1, 0.97), "wheel.fr.force.y": (1, 0.97)}
    assert by_others("wheel.fl.moment.y", mixed, {}) == (1, DISAGREEING)


def test_rear_steer_has_the_sign_of_front_steer_of_the_same_name() -> None:
    front = {"camera.fl.steer": (-1, 0.97), "camera.fr.steer": (-1, 0.97)}
    names = {"camera.fl.steer": "Lenkwinkel_VL", "camera.fr.steer": "Lenkwinkel_VR", "camera.rl.steer": "Lenkwinkel_HL"}
    assert by_others("camera.rl.steer", front, names) == (-1, SAME_INSTRUMENT)
    assert by_others("camera.rl.steer", front, names | {"camera.rl.steer": "Spur_HL"}) != (-1, SAME_INSTRUMENT)


def test_travels_with_names_of_one_pattern_have_one_sign() -> None:
    """Those that nothing shows that of the others; a name of another pattern is another sensor."""
    seen = {"damper.fl.travel": (-1, 0.99), "damper.fr.travel": (-1, 0.9), "damper.rl.travel": (1, 0.7)}
    names = {f"damper.{c}.travel": f"Pot_{c.upper()}" for c in ("fl", "fr", "rl")} | {"damper.rr.travel": "Stroke RR"}
    found = of_one_kind(seen | {"imu.rate.z": (1, 0.6)}, names | {"imu.rate.z": "GyroZ"})
    assert [found[f"damper.{c}.travel"] for c in ("fl", "fr", "rl")] == [(-1, pytest.approx(0.99, abs=0.01))] * 3
    assert found["damper.rr.travel"][1] == pytest.approx(0.5)
    assert found["imu.rate.z"] == (1, 0.6)
