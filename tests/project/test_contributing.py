"""CONTRIBUTING.md: the sensor and the effect on the page are short and work as they stand there."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

from lacet.daq.frames import Frames
from lacet.drivers.framework.can import CanSensor
from lacet.identify.car.kinematics import build_motion
from lacet.identify.effects.catalogue import catalogue
from lacet.identify.effects.user_files import checked_columns
from lacet.services.workspace.effect_files import own_classes
from tests.drivers.driver_cases import decode_all, plausible_blocks, same_blocks
from tests.identify import cars
from tests.support.places import HOME

PAGE = (HOME / "CONTRIBUTING.md").read_text(encoding="utf-8")
BLOCKS = dict(re.findall(r"^```(?:python|dbc) (\S+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))


@pytest.mark.parametrize("what", ["drivers/", "identify/effects/"])
def test_a_sensor_and_an_effect_take_forty_lines_at_most(what: str) -> None:
    lines = [line for name, text in BLOCKS.items() if name.startswith(what) for line in text.splitlines()]
    assert 0 < len(lines) <= 40


def test_the_files_of_the_page_are_in_rooms_that_are_there() -> None:
    assert len(BLOCKS) == 3
    for name in BLOCKS:
        assert (HOME / name).parent.is_dir()
        assert not (HOME / name).exists()


def test_the_sensor_decodes_what_it_sends_and_counts_what_is_lost(
    tmp_path: Path,
) -> None:
    (tmp_path / "brake_gauge.dbc").write_text(BLOCKS["drivers/dbc/brake_gauge.dbc"], encoding="utf-8")
    (tmp_path / "gauge.py").write_text(BLOCKS["drivers/brake_gauge.py"], encoding="utf-8")
    made = runpy.run_path(str(tmp_path / "gauge.py"))["BrakeGauge"]
    assert issubclass(made, CanSensor)
    driver = made("can0", {"dbc": "brake_gauge.dbc"}, tmp_path)
    sent = plausible_blocks(driver, 50, 3)
    sent["brake.pressure"].values[:] = np.rint(sent["brake.pressure"].values / 1000.0) * 1000.0
    frames = driver.encode(sent)
    found, counts = decode_all(driver, frames)
    same_blocks(found, sent)
    assert counts["samples"] == 50
    _, counts = decode_all(driver, Frames.from_iter("can0", [one for i, one in enumerate(frames) if i not in (10, 11)]))
    assert counts["lost"] == 2


def test_the_effect_keeps_the_contract_and_is_listed(tmp_path: Path) -> None:
    (text,) = (text for name, text in BLOCKS.items() if name.startswith("identify/effects/"))
    (tmp_path / "viscous_drag.py").write_text(text, encoding="utf-8")
    vehicle, rig = cars.reference_car()
    effect = catalogue(cars.with_tables(vehicle), "contact", own_classes(tmp_path))["viscous_drag"]
    motion = build_motion(cars.recording(cars.random_signals(5), cars.with_tables(vehicle), rig))
    columns = checked_columns(effect, motion)
    assert motion.velocity is not None
    np.testing.assert_array_equal(columns["chassis.fx"], motion.velocity[:1])
