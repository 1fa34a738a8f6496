"""A catalogue of few candidates, for tests of what a command does with a ranking, whatever its length."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from lacet.identify.effects.base import Effect
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.selection.diagnosis import Diagnosis
from lacet.identify.validation.noise_floor import NoiseFloor


def few_candidates(patch: pytest.MonkeyPatch, *families: str) -> None:
    """Let the rankings of studies try the effects of these families only."""

    def ranked(fitted: Fit, floor: NoiseFloor, candidates: Sequence[Effect], **options: Any) -> Diagnosis:
        return diagnose(fitted, floor, [e for e in candidates if e.name in families], **options)

    patch.setattr("lacet.services.workspace.kept.kept_values.diagnose", ranked)
