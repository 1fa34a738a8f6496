"""What is proposed, what is called unlisted, and how it is told: on a car that is its model, or lacks one law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from lacet.identify.car.rows import SUSPENSION_ROWS
from lacet.identify.effects.base import Effect
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit
from lacet.identify.selection.candidate import Answer, Candidate, Reason, is_significant, judged
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.selection.diagnosis import Diagnosis
from lacet.identify.selection.joint.unknown_tables import BesideTable
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.noise_floor import NoiseFloor
from lacet.services.render.candidate_reasons import reason_text, why
from lacet.services.render.verdict_card import verdict_card
from lacet.services.render.verdicts import says
from lacet.services.workspace.results import diagnosis_result
from tests.identify.exact_car import KNOWN, driven, exact, exact_with, fit_of
from tests.identify.selection.exact_ranking import CANDIDATES, DRAWS, HIDDEN, SIZE


def test_a_law_of_no_catalogue_is_unlisted_and_its_formula_comes_first(hidden: Diagnosis):
    assert hidden.verdict == "unlisted cause", says(hidden)
    assert hidden.best is None
    assert hidden.formulas
    first = hidden.formulas[0]
    law, _, constant = first.text.partition(", v0 = ")
    assert law == "suspension.front: p * travel**2*tanh(rate/v0)"
    assert float(constant.removesuffix(" mm/s")) == pytest.approx(30.0, rel=0.05)
    assert first.law.explained > 0.95
    assert set(first.rows) == {"suspension.fl", "suspension.fr"}
    assert first.gain > 0.8
    assert first.p == pytest.approx(1.0 / (DRAWS + 1))
    assert first.text in says(hidden)
    assert set(hidden.failing) >= {"suspension.fl", "suspension.fr"}


def test_what_explains_most_at_an_implausible_size_is_named_with_what_to_look_at(hidden: Diagnosis):
    """An instrument first of all; of a law that it only looks like one. Where others explain more: not."""
    fault = next(key for key, e in hidden.effects.items() if e.as_fault)
    law = next(key for key, e in hidden.effects.items() if e.as_physics)
    for key, advice in ((fault, "look at this instrument first"), (law, "something else looks like it")):
        high = hidden.effects[key].parameters[0].high
        far = Candidate(
            key, {}, Answer.IMPLAUSIBLE, Reason.IMPLAUSIBLE, gain=0.96, rows=(hidden.unlisted_rows[0],),
            values=(20.0 * high,), interval=(high,),
        )  # fmt: skip
        said = says(replace(hidden, candidates=(far, *hidden.candidates)))
        assert f"{key} would explain 96 % of what {hidden.unlisted_rows[0]} leave" in said
        assert advice in said
        for less in (replace(far, gain=0.3), replace(far, answer=Answer.NOT_NEEDED, reason=Reason.CHANCE)):
            assert "would explain" not in says(replace(hidden, candidates=(less, *hidden.candidates)))
    assert "would explain" not in says(hidden)


def test_the_same_law_in_the_catalogue_is_missing(unlisted: Fit, floor: NoiseFloor):
    """As a one-line effect it is named, with its size."""
    found = diagnose(unlisted, floor, [*CANDIDATES[:3], HIDDEN])
    assert found.verdict == "missing", says(found)
    assert found.best is not None
    assert found.best.key == "hidden.front"
    assert found.best.values[0] == pytest.approx(SIZE, abs=max(2.0 * found.best.interval[0], 0.05 * SIZE))
    assert not found.formulas


def test_what_a_table_that_is_lacking_explains_as_well_is_not_counted_as_found(
    unlisted: Fit, floor: NoiseFloor, monkeypatch: pytest.MonkeyPatch
):
    place, lookup = "lacet.identify.selection.diagnose", "lacet.identify.selection.joint.unknown_tables"
    beside = {HIDDEN.key: BesideTable(np.zeros(1), np.ones(1), stands=False)}
    for module in (place, lookup):
        monkeypatch.setattr(f"{module}.axles_without_tables", lambda *_: ("front",))
    monkeypatch.setattr(f"{place}.beside_tables", lambda *_: beside)
    found = diagnose(unlisted, floor, [*CANDIDATES[:3], HIDDEN])
    assert not found.found
    assert found.verdict == "unlisted cause"
    assert found.unlisted
    assert says(found).startswith("Something is missing, and these runs do not show what: the effects found, or")
    assert "show that they do not. Not counted as found, since an unknown table" in says(found)
    assert says(found).endswith("With a bench table in the vehicle file a diagnosis can decide.")
    result = diagnosis_result(found)
    assert (result["without_tables"], result["tables_instead"]) == (["front"], [HIDDEN.key])
    (line,) = verdict_card(result, {})["lines"]
    assert line["text"].startswith("Undecided beside an unknown bench table: ")
    said = next(c for c in found.candidates if c.key == HIDDEN.key)
    assert said.answer == "undecided"
    assert "an unknown bench table of its axle" in why(found, said)
    other = replace(said, key="jacking.front", answer=Answer.MISSING, reason=Reason.PASSES)
    text = says(replace(found, found=(other,), effects={**found.effects, other.key: HIDDEN}))
    assert "no bench table of the front axle" in text
    assert f"Not counted as found, since an unknown table may explain as much: {HIDDEN.key}." in text


def test_a_latency_is_ranked_by_what_it_takes_off_beside_all_tolerances(
    unlisted: Fit, floor: NoiseFloor, monkeypatch: pytest.MonkeyPatch
):
    """Beside the rig file's clocks it may take off far more than what is missing: clocks two tolerances off do."""
    latencies = KNOWN["sensor_latency.laser"]
    measured = ScoreTests.try_all

    def seen(space: ScoreTests) -> list[Candidate]:
        found = measured(space)
        law = next((c for c in found if c.key == HIDDEN.key), None)
        if law is None:
            return found
        gain, drop = 5.0 * law.total_gain, 0.1 * law.drop
        return [replace(c, total_gain=gain, gain=1.0, drop=drop) if c.key == latencies.key else c for c in found]

    monkeypatch.setattr(ScoreTests, "try_all", seen)
    found = diagnose(unlisted, floor, [latencies, HIDDEN])
    assert found.best is not None, says(found)
    assert found.best.key == HIDDEN.key
    assert next(c for c in found.candidates if c.key == latencies.key).p <= SELECTION.level(
        DRAWS
    )  # chance is not what puts it last


def test_what_chance_does_as_well_comes_last(unlisted: Fit, floor: NoiseFloor, monkeypatch: pytest.MonkeyPatch):
    """However much it takes off."""
    compared = ScoreTests.family_wise

    def by_chance(space: ScoreTests, found: Sequence[Candidate]) -> list[Candidate]:
        said = compared(space, found)
        return [c if c.key == HIDDEN.key else replace(c, total_gain=1e9, drop=1e9, p=0.5) for c in said]

    monkeypatch.setattr(ScoreTests, "family_wise", by_chance)
    found = diagnose(unlisted, floor, [*CANDIDATES[:2], HIDDEN])
    assert found.candidates[0].key == HIDDEN.key


def test_what_stands_out_and_is_too_small_is_told_where_nothing_is_proposed(
    floor: NoiseFloor, monkeypatch: pytest.MonkeyPatch
):
    small = fit_of(driven(exact_with(HIDDEN, 0.15 * SIZE), 1))
    assert diagnose(small, floor, [HIDDEN, *CANDIDATES[:2]]).verdict == "missing"
    monkeypatch.setattr("lacet.identify.selection.candidate.SELECTION", replace(SELECTION, least_gain=0.5))
    found = diagnose(small, floor, [HIDDEN, *CANDIDATES[:2]])
    assert found.verdict == "nothing missing"
    assert "Chance does not explain all: hidden.front " in says(found)
    assert " N RMS, p = 0.025" in says(found)
    assert "the best of 3 candidates, hidden.front (p = 0.025), is smaller than asked for" in says(found)
    others = replace(found, candidates=[c for c in found.candidates if c.key != HIDDEN.key])
    assert "chance does as well as the best of 2 candidates with p = " in says(others)


@pytest.mark.parametrize(
    ("changed", "out"),
    [({}, True), ({"p": 0.06}, False), ({"gain": -0.001}, False), ({"values": (1e9,)}, False)],
)
def test_what_stands_out_may_be_small_but_is_plausible_and_no_chance(changed: dict, out: bool):
    effect = KNOWN["anti_roll_bar.front"]
    small = Candidate(effect.key, {}, p=0.01, gain=0.002, most=0.004, values=(400.0,), interval=(50.0,))
    assert judged(small, effect, 199).answer == "smaller than asked for"
    assert is_significant(replace(small, **changed), effect, 199) == out


def sentences(text: str) -> list[str]:
    """Parts that end with a full stop before a space, or at the end."""
    return [part for part in text.rstrip(".").split(". ") if part]


def test_every_answer_has_its_reason_with_numbers(hidden: Diagnosis, fitted: Fit, floor: NoiseFloor, space: ScoreTests):
    nothing = diagnose(fitted, floor, CANDIDATES, noise=space.noise)
    for step, c in [(d, c) for d in (hidden, nothing) for c in d.candidates]:
        text = why(step, c)
        assert text.endswith("."), text
        assert len(sentences(text)) >= 2, text
        if c.tested:
            assert (" N RMS off " if c.gain > 0.0 else " takes nothing off ") in text, text
            assert "p = " in text, text
            assert text.startswith("Added to the model it takes "), text
        else:
            assert text.startswith("Cannot be tested: "), text
            assert "What shows it: " in text, text


def candidate(effect: Effect, **changed: object) -> Candidate:
    """A candidate that passes every bar."""
    plain = Candidate(
        effect.key, {}, rows=SUSPENSION_ROWS[:2], gain=0.4, gain_rms=12.3, total_gain=900.0, drop=1000.0,
        p=1.0 / (DRAWS + 1), values=(40.0,), interval=(6.0,),
    )  # fmt: skip
    return replace(plain, **changed)


@pytest.mark.parametrize(
    ("changed", "answer", "parts"),
    [
        ({}, "missing", ("12.3 N RMS off suspension.fl, suspension.fr", "40.0 ± 6.0 N", "never did as well in 39")),
        ({"p": 0.2}, "not needed", ("p = 0.2", "0.025")),
        ({"gain": 0.004}, "smaller than asked for", ("less than 1 %",)),
        ({"values": (-40.0,)}, "implausible size", ("-40.0 ± 6.0 N", "plausible: 0 to 500", "no car has that")),
        ({"values": (-4.0,)}, "missing", ("-4.0 ± 6.0 N",)),
        ({"values": (900.0,)}, "implausible size", ("900.0 ± 6.0 N",)),
    ],
)
def test_wording(changed: dict[str, object], answer: str, parts: Sequence[str]):
    effect = KNOWN["coulomb.front"]
    said = judged(candidate(effect, **changed), effect, DRAWS)
    text = reason_text(said, effect, DRAWS)
    assert said.answer == answer, text
    assert len(sentences(text)) >= 2
    for part in parts:
        assert part in text, (part, text)


def test_negative_friction_does_not_hide_in_the_best_set(
    space: ScoreTests, floor: NoiseFloor, fitted: Fit, monkeypatch: pytest.MonkeyPatch
):
    """A car with less friction than none: the ranking does not propose it."""
    record = driven(exact(), 4).recording
    friction = KNOWN["coulomb.front"]
    columns = friction.columns(fitted.runs[0].motion)
    values = dict(record.signals.value)
    for row, series in columns.items():
        name = f"wheel.{row.partition('.')[2]}.force"
        values[name] = values[name] - np.array([[0.0], [0.0], [1.0]]) * 120.0 * series
    spoilt = fit_of(PreparedRun(record.with_signals(replace(record.signals, value=values))), fitted)
    monkeypatch.setattr("lacet.identify.selection.diagnose.propose", lambda *_: [])  # the formulas are another test's
    found = diagnose(spoilt, floor, CANDIDATES, noise=space.noise)
    said = next(c for c in found.candidates if c.key == "coulomb.front")
    assert said.values[0] < -60.0
    assert said.answer in ("implausible size", "stands in"), why(found, said)
    assert "coulomb.front" not in [c.key for c in found.found]
