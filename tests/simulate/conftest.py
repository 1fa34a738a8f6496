"""Fixtures of the simulated car; all its tests need MuJoCo."""

from __future__ import annotations

import pytest

pytest.importorskip("mujoco")

from lacet.simulate.motion import SimulatedMotion
from tests.simulate.simulated_drives import MOTIONS, drive


@pytest.fixture(params=MOTIONS)
def motion(request: pytest.FixtureRequest) -> SimulatedMotion:
    """Every manoeuvre in turn."""
    return drive(request.param)
