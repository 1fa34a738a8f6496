"""What a command loads before it works."""

import subprocess
import sys

import pytest

HEAVY = (
    "asammdf", "cvxpy", "matplotlib", "mujoco", "pandas", "pyarrow", "scipy.interpolate", "scipy.io", "scipy.linalg",
    "scipy.ndimage", "scipy.optimize", "scipy.signal", "scipy.stats",
)  # fmt: skip
"""Packages that take longer to load than a command whose values are kept takes to answer."""


@pytest.mark.parametrize("command", ["where", "diagnose", "export"])
def test_what_is_used_seldom_is_loaded_when_it_is_used(command: str):
    """`import scipy` loads a subpackage when it is first named."""
    code = f"import sys, lacet.services.commands.{command}; print(*(m for m in {HEAVY} if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.split() == []
