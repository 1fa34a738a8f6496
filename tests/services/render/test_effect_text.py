"""Effects in words: what a run lacks for one, what came of trying one, the catalogue."""

from __future__ import annotations

from itertools import pairwise

import pytest

from lacet.daq.vehicle import Vehicle
from lacet.identify.car.motion import GroundLaserOffset
from lacet.identify.regression.prepared_run import Unmeasured
from lacet.identify.selection.candidate import Answer, Candidate, Reason
from lacet.services.commands.__main__ import main
from lacet.services.render.candidate_reasons import reason_text
from lacet.services.render.effect_text import catalogue_text, effect_label, not_measured, trial_outcome, why_not
from lacet.services.workspace.effect_list import list_effects

LACKING = Unmeasured("sine", ("correvit.speed", GroundLaserOffset(-0.06)))
WORDS = "correvit.speed, the road under the wheels (lasers stand 60 mm from their centres) not measured in sine"


def test_what_a_run_lacks_is_said_with_its_name() -> None:
    """By itself, and as the reason of a candidate's answer."""
    assert not_measured(LACKING) == WORDS
    assert not_measured(None) == ""
    one = Candidate("tyre_damping.front", {}, Answer.NOT_TESTABLE, Reason.NOT_COMPUTABLE, lacks=LACKING)
    assert reason_text(one, None, 99) == f"Cannot be tested: {WORDS}."


def test_an_effect_has_a_label_in_words() -> None:
    """With its corner, axle, channel or run."""
    assert effect_label("anti_roll_bar.front") == "anti-roll bar, front"
    assert effect_label("spring.fl") == "spring, front left"
    assert effect_label("sensor_gain.hub.rr") == "sensor gain, hub, rear right"


def test_a_trial_says_where_it_acts_or_why_not() -> None:
    """What is lacking comes before rows that are not there."""
    assert why_not(LACKING, []) == WORDS
    assert why_not(None, []) == "it never acts in a row that this run has"
    assert why_not(None, ["suspension.fl"]) == ""
    front, rear = {"effect": "bump.front", "why_not": ""}, {"effect": "bump.rear", "why_not": "no reason"}
    assert trial_outcome([front]) == "acts, with finite values"
    assert trial_outcome([front, rear]) == "acts: bump.front; bump.rear cannot be tested (no reason)"
    assert trial_outcome([rear]) == "bump.rear cannot be tested (no reason)"


def test_the_catalogue_has_its_headings_once_and_every_family() -> None:
    """Base model first, sensor faults and what is measured last."""
    found = list_effects(Vehicle.load("peugeot-406"), "hub")
    lines = catalogue_text(found.families, found.variants, found.measured, "hub").split("\n")
    titles = [above for above, below in pairwise(lines) if below and set(below) == {"-"}]
    assert titles == [
        "Base model", "Effects that may be missing", "Faults of the instruments",
        "Already measured: cannot be missing here",
    ]  # fmt: skip
    names = {family.name for family in found.families} | {one.name for one in found.measured}
    assert names == {line.split(":")[0] for line in lines if line[:1].strip() and ": " in line} - {"Already measured"}


@pytest.mark.parametrize("asked", ["coulomb", "coulomb.front"])
def test_a_family_is_printed_by_its_name_or_an_effects(asked: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Without a heading, with unit and range of its parameter, and an empty line at its end."""
    assert main(["info", "--effects", asked]) == 0
    lines = capsys.readouterr().out.split("\n")
    assert lines[0] == "coulomb: dry friction in the dampers and joints"
    assert any(line.startswith("    parameter: f [N], 0 to ") for line in lines)
    assert lines[-3].startswith("    source: ")
    assert lines[-2:] == ["", ""]
    assert sum(": " in line and not line.startswith(" ") for line in lines) == 1


def test_what_is_measured_is_a_family_too(capsys: pytest.CaptureFixture[str]) -> None:
    """With the reason why it cannot be missing."""
    assert main(["info", "--effects", "road_grade"]) == 0
    assert "    why not: the inertial unit measures" in capsys.readouterr().out
