"""The verdict card: what it names, how sure it is, why the others are out, and no more words than it may have."""

from __future__ import annotations

from typing import Any

import pytest

from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.catalogue import catalogue
from lacet.services.render.verdict_card import MOST_WORDS, verdict_card, words_of

EFFECTS = catalogue(Vehicle.load("peugeot-406"), "hub")


def candidate(effect: str, answer: str, **more: Any) -> dict[str, Any]:
    """A candidate as a diagnosis stores it."""
    one = {"shape": {}, "values": [], "half95": [], "ties": [], "stands_for": "", "margin": None, "rival": ""}
    return {"effect": effect, "answer": answer, **one, **more}


def diagnosis(verdict: str, *candidates: dict[str, Any], **more: Any) -> dict[str, Any]:
    """A diagnosis with these candidates."""
    found = [c["effect"] for c in candidates if c["answer"] == "missing"]
    best = found[0] if found else None
    return {"verdict": verdict, "best": best, "found": found, "candidates": candidates, "unlisted_rows": [],
            "rows": {"suspension.fl": 3.44}, "formulas": [], **more}  # fmt: skip


def texts(card: dict[str, Any]) -> list[str]:
    """Its lines."""
    return [line["text"] for line in card["lines"]]


BAR = candidate(
    "anti_roll_bar.front", "missing", values=[15012.4], half95=[318.0], margin=5432.1, rival="sensor_gain.hub.fl"
)


def test_an_effect_with_its_size_its_lead_and_the_next_three():
    others = [
        candidate("coulomb.rear", "not needed"), candidate("anti_roll_bar.rear", "undecided"),
        candidate("sensor_gain.hub.fl", "stands in", stands_for="anti_roll_bar.front"),
        candidate("spring_cubic.front", "not needed"),
    ]  # fmt: skip
    card = verdict_card(diagnosis("missing", BAR, *others), EFFECTS)
    assert card["title"] == "Missing: anti-roll bar, front"
    assert texts(card) == [
        "k = 15010 ± 320 N/m (95 %, with sheet)", "5430 weighted squares ahead of sensor_gain.hub.fl",
    ]  # fmt: skip
    assert [one["effect"] for one in card["out"]] == [c["effect"] for c in others[:3]]
    assert [one["why"] for one in card["out"]] == ["chance", "judged next", "stands for anti_roll_bar.front"]
    assert (card["add"], card["label"]) == ("anti_roll_bar.front", "anti-roll bar, front")


def test_a_law_at_places_that_runs_do_not_part_is_one_title_with_its_sum():
    total = {"effects": ["anti_roll_bar.front", "anti_roll_bar.rear"], "parameter": "k", "unit": "N/m",
             "value": 20312.4, "half95_sheet": 2114.7}  # fmt: skip
    bars = [candidate(key, "missing", values=[10000.0], half95=[40000.0], sum=total) for key in total["effects"]]
    card = verdict_card(diagnosis("missing", *bars, candidate("coulomb.rear", "missing")), EFFECTS)
    assert card["title"] == "Missing: anti-roll bar, front + rear, and 1 more"
    assert texts(card) == ["k summed = 20300 ± 2100 N/m (95 %, with sheet); these runs do not show the split"]
    assert words_of(card) <= MOST_WORDS


def test_an_effect_that_is_not_told_apart_has_no_lead():
    tied = {**BAR, "ties": [{"effect": "sensor_gain.hub.fl", "correlation": 0.99}]}
    card = verdict_card(diagnosis("missing", tied, candidate("sensor_gain.hub.fl", "undecided")), EFFECTS)
    assert texts(card)[1] == "Not told apart from sensor_gain.hub.fl on these runs"
    assert card["out"] == [{"effect": "sensor_gain.hub.fl", "why": "tied"}]


def test_nothing_missing_says_which_runs_would_show_the_rest():
    silent = [candidate(f"damper_{kind}.front", "not testable") for kind in ("knee", "saturation", "digressive")]
    silent.append(candidate("anti_dive.front", "not testable"))
    card = verdict_card(diagnosis("nothing missing", candidate("coulomb.rear", "not needed"), *silent), EFFECTS)
    assert card["title"] == "Nothing missing that these runs can show, 4 effects untestable"
    assert card["showing"][0]["shown_by"].startswith("rough road")
    assert sum(one["effects"] for one in card["showing"]) == 4
    assert card["add"] is None
    assert card["out"] == [{"effect": "coulomb.rear", "why": "chance"}]


@pytest.mark.parametrize(("ratio", "said"), [(2.164, "chassis.fy 2.16 → 1.06 once the rig file is right"), (1.2, "")])
def test_nothing_missing_says_what_of_the_error_the_sensors_may_be_off_by(ratio: float, said: str):
    rows = {"chassis.fy": ratio, "tyre.fl": 1.1}
    found = diagnosis("nothing missing", candidate("coulomb.rear", "not needed"), rows=rows)
    assert texts(verdict_card(found, EFFECTS)) == []  # of a lacet that did not store it
    card = verdict_card({**found, "tolerated": {"chassis.fy": 1.0553, "tyre.fl": 1.0}}, EFFECTS)
    assert texts(card) == ([f"{said}: lacet check"] if said else [])
    assert words_of(card) <= MOST_WORDS


def test_a_cause_that_is_not_listed_names_the_worst_row():
    card = verdict_card(
        diagnosis("unlisted cause", candidate("coulomb.rear", "undecided"), unlisted_rows=["suspension.fl"]), EFFECTS
    )
    assert card["title"].startswith("Something is missing")
    assert texts(card) == ["suspension.fl is 3.4 times its noise floor"]
    assert card["out"] == [{"effect": "coulomb.rear", "why": "undecided"}]


@pytest.mark.parametrize("verdict", ["missing", "nothing missing", "unlisted cause"])
def test_a_card_has_no_more_words_than_it_may(verdict: str):
    effects = [key for key, effect in EFFECTS.items() if not effect.base]
    many = [candidate(key, "stands in", stands_for="anti_roll_bar.front") for key in effects[:6]]
    many += [candidate(key, "not testable") for key in effects[6:]]
    best = {**BAR, "ties": [{"effect": key, "correlation": 0.9} for key in effects[:5]]}
    second = {**BAR, "effect": "anti_roll_bar.rear"}
    found = (best, second) if verdict == "missing" else ()
    card = verdict_card(diagnosis(verdict, *found, *many, unlisted_rows=["suspension.fl", "tyre.fl"]), EFFECTS)
    assert words_of(card) <= MOST_WORDS
    assert card["out"] or verdict == "missing"
