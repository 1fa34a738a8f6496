"""One thread for linear algebra, as the command line has it (matrices are small), and tests that go together."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

# Before NumPy and SciPy load their libraries; commands started by tests inherit it.
for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

TOGETHER = {
    "browser/test_charts.py": "a small study in the browser",
    "browser/test_page.py": "a small study in the browser",
    "identify/test_derived.py": "the reference car",
    "identify/test_doubt.py": "the reference car",
    "identify/test_reference_car.py": "the reference car",
}
"""Files that one process runs, as they share what takes long to make; others are on their own."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tell pytest-xdist (``--dist loadgroup``) which tests go to one process."""
    here = Path(__file__).parent
    for item in items:
        file = item.path.relative_to(here).as_posix()
        folder = "ranking" if file.startswith("identify/ranking/") else file
        item.add_marker(pytest.mark.xdist_group(TOGETHER.get(file, folder)))
