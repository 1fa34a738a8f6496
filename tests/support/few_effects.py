"""A catalogue of few effects and a library of two manoeuvres: for tests of what is done with an answer, in seconds.

In this process by `few_effects`; as a program, ``python -m tests.support.few_effects SUB-COMMAND …``, the command line
of a lacet that has no others. The whole catalogue is ranked in `tests/services/workbench/browser/test_story.py`.
"""

from __future__ import annotations

import sys

from lacet.identify.effects.base import Effect
from lacet.services.commands.__main__ import main
from lacet.services.planning import separation
from lacet.services.workspace.study import Study

KEYS = (
    "anti_roll_bar.front", "anti_roll_bar.rear", "coulomb.front", "coulomb.rear", "damper_asymmetry.front",
    "damper_stroke.rear", "spring_cubic.front", "chassis_torsion", "sensor_gain.speed",
)  # fmt: skip
"""What is ranked: bars, what stands in for them, what does not, and what no manoeuvre shows."""
RUNS, SECONDS = ("braking", "sinus"), 5.0
"""Manoeuvres from which the next run is chosen, and how long their simulated motions last [s]."""
_all_effects = Study.effects


def few_effects(study: Study, reference: str) -> dict[str, Effect]:
    """The base model and those of `KEYS`."""
    return {key: effect for key, effect in _all_effects(study, reference).items() if effect.base or key in KEYS}


if __name__ == "__main__":
    Study.effects = few_effects
    separation.SECONDS = SECONDS
    separation.kinds = lambda only=(), without=(): list(RUNS)
    sys.exit(main())
