"""Fixtures of the simulated car; all its tests need MuJoCo."""

from __future__ import annotations

import pytest

pytest.importorskip("mujoco")

from simulate.motion import SimulatedMotion  # noqa: E402
from simulated_drives import MOTIONS, drive  # noqa: E402


@pytest.fixture(params=MOTIONS)
def motion(request: pytest.FixtureRequest) -> SimulatedMotion:
    """Every manoeuvre in turn."""
    return drive(request.param)
