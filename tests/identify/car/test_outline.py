"""The outline of a run that is made by stretches: that of its motion, in less memory."""

from __future__ import annotations

import tracemalloc
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

from lacet.identify.car.outline import Outline
from lacet.identify.regression.prepared_run import PreparedRun
from tests.identify import cars
from tests.support.tables import piece

VEHICLE, RIG = cars.reference_car()


def leaves(part: Any) -> list[Any]:
    """What is inside a nested mapping, in order."""
    return [leaf for one in part.values() for leaf in leaves(one)] if isinstance(part, dict) else [part]


def test_stretches_are_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    run = piece("rough", 2.0, 14.0)
    whole = PreparedRun.of(run, VEHICLE, RIG)
    expected = Outline.of(whole.motion)
    monkeypatch.setattr("lacet.identify.regression.prepared_run.PIECE", 2.5)
    cut = PreparedRun.of(run, VEHICLE, RIG)
    found = cut.outline
    assert "motion" not in vars(cut), "the motion of the whole run is not made"
    assert found.t.size == whole.recording.t.size
    for one, other in zip(leaves(asdict(found)), leaves(asdict(expected)), strict=True):
        if isinstance(other, np.ndarray):
            np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-12)
        else:
            assert one == other


def test_an_outline_takes_a_part_of_the_motions_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    run = piece("rough", 2.0, 14.0)
    peaks = []
    for length in (1e9, 2.0):
        monkeypatch.setattr("lacet.identify.regression.prepared_run.PIECE", length)
        prepared = PreparedRun.of(run, VEHICLE, RIG)
        tracemalloc.start()
        assert prepared.outline.t.size
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < peaks[0] / 3
