"""``lacet diagnose --next``: what is compared, what is refused, and a table that says what the numbers say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from lacet.daq.errors import UsageError
from lacet.identify.design.discrimination import NEEDED, SHOWS, wrong_pick
from lacet.identify.selection.candidate import Answer, Candidate
from lacet.services.commands.__main__ import main
from lacet.services.planning.manoeuvre_library import KMH, Limits, Plan
from lacet.services.planning.separation import ORDINARY, next_result, next_run, recommend, tied, untestable
from lacet.services.render.separation_report import hint, next_text
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study
from tests.services.commands.test_json import conforms
from tests.support.candidates import few_candidates
from tests.support.tables import FILES, piece, written

FRONT, REAR = "anti_roll_bar.front", "anti_roll_bar.rear"


def diagnosis(best: Candidate | None, *others: Candidate) -> Any:
    """As much of a diagnosis as a hint needs."""
    return SimpleNamespace(best=best, candidates=(*((best,) if best else ()), *others))


def hint_of(found: Any) -> str:
    """The hint after a diagnosis."""
    return hint(bool(tied(found)), bool(untestable(found)), False, [], "DIR")


def test_the_hint_says_what_can_be_asked():
    lone = Candidate("a", {}, Answer.MISSING)
    assert tied(diagnosis(None)) == tied(diagnosis(lone)) == []
    assert hint_of(diagnosis(lone)) == ""
    both = replace(lone, ties=(("b", 0.9), ("c", 0.8)))
    assert tied(diagnosis(both)) == ["a", "b", "c"]
    assert "lacet diagnose DIR --next" in hint_of(diagnosis(both))
    assert "EFFECT" in hint_of(diagnosis(lone, Candidate("x", {}, Answer.NOT_TESTABLE)))


def test_what_is_not_listed_is_looked_for_and_its_law_can_be_kept():
    law = "tyre.front: p * speed*deflection"
    lines = hint(False, True, True, [law, "tyre.rear: p * speed*deflection"], "DIR").splitlines()
    assert lines[0].endswith("lacet where DIR")
    assert "lacet effect DIR 'found = tyre: p * speed*deflection'" in lines[1]  # at both axles
    for laws in ([law], [law, "tyre.rear: p * deflection"]):
        assert f"'found = {law}'" in hint(False, False, True, laws, "DIR")
    body = ["chassis.mz: p * vy", "chassis.mx: p * vy"]  # rows of the body are no places of one law
    assert f"'found = {body[0]}'" in hint(False, False, True, body, "DIR")
    assert lines[2].endswith("--next EFFECT")
    assert hint(False, False, True, [], "DIR").endswith("lacet where DIR")


def test_nothing_is_said_unless_it_was_asked():
    assert next_text({}, 8) == ""
    assert "Nothing is tied" in next_text({"next": None}, 8)


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("mujoco")
    folder = tmp_path_factory.mktemp("next")
    run = str(written(piece("sine", 5.0, 12.0), folder / "sine.parquet"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lacet.services.workspace.kept.kept_values.SCORE_DRAWS", 3)
        assert main(["study", "new", str(folder / "study"), "--use", run, *FILES, "--draws", "19"]) == 0
    return folder / "study"


def asked(study: Path, monkeypatch: pytest.MonkeyPatch, *names: str) -> dict[str, Any]:
    """The result of asking, with two manoeuvres of a few seconds."""
    few_candidates(monkeypatch, "anti_roll_bar", "spring_cubic", "bump_stop", "damper_stroke", "damper_asymmetry")
    monkeypatch.setattr("lacet.services.planning.separation.SECONDS", 5.0)
    few = lambda only, without: ["liftoff"]  # noqa: E731
    monkeypatch.setattr("lacet.services.planning.separation.kinds", few)
    monkeypatch.setattr("lacet.services.planning.separation.Limits", lambda: Limits(speed=50 * KMH))
    file = study / "out.json"
    assert main(["diagnose", str(study), "--next", *names, "--json", str(file)]) == 0
    return conforms(file, "diagnose")["next"]


def test_two_effects_and_one(study: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    pair = asked(study, monkeypatch, "spring_cubic.front", "bump_stop.front")
    out = capsys.readouterr().out
    assert pair["says"] in out
    assert (pair["quantity"], pair["needed"]) == ("separation", NEEDED)
    for e in pair["effects"]:
        assert e["found"] or e["size"] <= ORDINARY * (1 + 1e-6)
    assert len(pair["runs"]) == 1
    for one in pair["runs"]:
        assert one["after"] >= pair["now"] * (1 - 1e-9)
        assert one["wrong_pick"] == pytest.approx(wrong_pick(one["after"]))
        assert (one["seconds"] is not None) == (one["after"] >= NEEDED > pair["now"])
        assert one["ordinary"] is None
    assert len(list((study / "planned").glob("*.parquet"))) == 1

    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("simulated again")

    with monkeypatch.context() as patch:
        patch.setattr("lacet.services.planning.separation.recommend", refuse)
        assert asked(study, monkeypatch, "spring_cubic.front", "bump_stop.front") == pair
        with pytest.raises(AssertionError, match="again"):
            asked(study, monkeypatch, "spring_cubic.front", "bump_stop.rear")
    monkeypatch.setattr("lacet.services.planning.simulated_plans.drive_car", refuse)
    nothing: Any = SimpleNamespace(best=None, candidates=(), noise_ratio={})
    shown = recommend(Session(Study.open(study)), nothing, ["tyre_damping.front"])
    assert shown is not None
    alone = next_result(shown)
    assert alone["says"] in next_text({"next": alone}, 8)
    (one,), (effect,) = alone["runs"], alone["effects"]
    assert (alone["quantity"], alone["needed"]) == ("size", SHOWS)
    assert one["wrong_pick"] is None
    assert one["after"] >= alone["now"] * (1 - 1e-9)
    # √λ grows with the size, and the smallest size that shows is where it comes to what is needed.
    assert one["ordinary"] == pytest.approx(one["after"] * effect["values"][0] / effect["largest"][0])
    assert one["smallest"] == pytest.approx(effect["largest"][0] * SHOWS / one["after"])


def test_what_cannot_be_asked_is_refused(study: Path, monkeypatch: pytest.MonkeyPatch):
    session = Session(Study.open(study))
    nothing: Any = SimpleNamespace(best=None, candidates=(), noise_ratio={})
    assert recommend(session, nothing) is None
    with pytest.raises(UsageError, match="did you mean"):
        recommend(session, nothing, ["bump_stop.frnt"])
    with pytest.raises(UsageError, match="in the model"):
        recommend(session, nothing, ["spring.fl"])
    with pytest.raises(UsageError, match="no manoeuvre"):
        recommend(session, nothing, ["bump_stop.front"], without=["looping"])


def test_a_plan_of_a_study_is_kept_for_what_was_asked(study: Path, monkeypatch: pytest.MonkeyPatch):
    made: list[int] = []
    shown: list[Any] = []

    def planned(*_: Any) -> dict[str, Any]:
        made.append(len(made))
        return {"warnings": [], "says": f"plan {len(made)}"}

    monkeypatch.setattr("lacet.services.commands.plan._planned", planned)
    monkeypatch.setattr("lacet.services.commands.plan._print", lambda result, _: shown.append(result["says"]))
    for more in ([], [], ["--max-speed", "60"], ["--goal", "5"], ["--only", "liftoff"], []):
        assert main(["plan", str(study), *more]) == 0
    assert shown == ["plan 1", "plan 1", "plan 2", "plan 3", "plan 4", "plan 1"]


@pytest.mark.parametrize(("within", "number"), [(None, 3), (0.0, 1), (15.0, 1), (25.0, 2)])
def test_the_library_is_not_gone_through_where_nothing_shows_or_time_is_over(
    study: Path, monkeypatch: pytest.MonkeyPatch, within: float | None, number: int
):
    """One of each kind is tried, the strongest first, as far as there is time for one more; an incomplete answer is
    not kept."""
    tried: list[str] = []
    clock = [0.0]

    def shows_nothing(plans: Sequence[Plan], *_: Any) -> tuple[list[Any], list[str]]:
        tried.append(plans[0].manoeuvre.name)
        clock[0] += 10.0
        return [], []

    place = "lacet.services.planning.separation"
    monkeypatch.setattr(f"{place}.time", SimpleNamespace(monotonic=lambda: clock[0]))
    monkeypatch.setattr(f"{place}.simulated_runs", shows_nothing)
    monkeypatch.setattr(f"{place}.kinds", lambda only, without: ["liftoff", "braking", "kerb"])
    session = Session(Study.open(study))
    nothing: Any = SimpleNamespace(best=None, candidates=(), noise_ratio={})
    found = recommend(session, nothing, ["tyre_damping.front"], within=within)
    assert found is not None
    assert len(set(tried)) == len(tried) == number
    assert (found.tried, found.complete) == (number, False)
    assert found.of > 3
    assert ("were not tried" if within is None else f"{number} of {found.of} manoeuvres") in found.says
    next_run(session, nothing, ["tyre_damping.front"], within=within)
    next_run(session, nothing, ["tyre_damping.front"], within=within)
    assert len(tried) == 3 * number, "it was kept"
