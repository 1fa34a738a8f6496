"""Fixtures of the simulated car; all its tests need MuJoCo."""

from __future__ import annotations

import pytest

pytest.importorskip("mujoco")

from simulated_drives import MOTIONS, drive

from lacet.simulate.motion import SimulatedMotion


@pytest.fixture(params=MOTIONS)
def motion(request: pytest.FixtureRequest) -> SimulatedMotion:
    """Every manoeuvre in turn."""
    return drive(request.param)
