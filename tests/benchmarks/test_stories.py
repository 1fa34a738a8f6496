"""The stories of docs/stories: every command runs, prints what the page shows, and ends as the page says."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from pathlib import Path

import pytest

pytest.importorskip("mujoco")

from benchmarks.stories.__main__ import PICTURES
from benchmarks.stories.page import STORIES, close, not_printed, play, steps
from lacet.identify.validation.score import pooled_ratio
from lacet.services.workspace.study import Study, Version


def played(page: str) -> None:
    """Play a page in the present folder, and compare what its commands print with what it shows."""
    blocks = steps(page)
    assert sum(bool(step.shown) for step in blocks) >= 3
    for step in blocks:
        printed = play(step)
        missing = not_printed(step.shown, printed)
        assert missing is None, (
            f"{page} shows what is not printed:\n{missing}\n\nprinted by {step.commands}:\n{printed}"
        )


def held(version: Version) -> float:
    """Error ÷ floor on the run held out."""
    return pooled_ratio(version.result["rows"]["held"])


def falls(versions: Sequence[Version]) -> None:
    """Every version is better than the one before, on the runs used and held out; the last is at the floor."""
    for before, after in itertools.pairwise(versions):
        assert pooled_ratio(after.result["rows"]["used"]) < pooled_ratio(before.result["rows"]["used"])
        assert held(after) < held(before)
    assert pooled_ratio(versions[-1].result["rows"]["used"]) < 1.05
    assert held(versions[-1]) < 1.10


@pytest.mark.slow  # a minute
def test_bars_and_friction_separate_table_2_from_table_6(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    played("bars-and-friction.md")
    study = Study.open(Path("bars"))
    versions = study.versions()
    order = ["anti_roll_bar.front", "anti_roll_bar.rear", "coulomb.front", "coulomb.rear"]
    assert [list(version.effects) for version in versions] == [order[:n] for n in range(5)]
    assert held(versions[0]) > 3.0
    falls(versions)
    diagnosis = study.diagnosis()
    assert diagnosis is not None
    assert diagnosis["verdict"] == "nothing missing"
    found = {p["name"]: p for p in versions[-1].result["parameters"]}
    page = (STORIES / "bars-and-friction.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([\w.]+)` \| ([\d.]+) \| ([\d.]+) ± ([\d.]+) \| (\S+) \|$", page, re.MULTILINE)
    hidden = {name.rpartition(".")[0]: float(true) for name, true, *_ in rows}
    assert list(hidden) == order
    commands = " ".join(steps("bars-and-friction.md")[0].commands)
    for name, true, value, half, unit in rows:
        assert f"--hide {name.rpartition('.')[0]}={true} " in commands
        assert close(value, f"{found[name]['value']:.6f}")
        assert close(half, f"{found[name]['half95']:.6f}")
        assert found[name]["unit"] == unit
        assert abs(found[name]["value"] - float(true)) < found[name]["half95"]


@pytest.mark.slow  # two minutes
def test_the_effect_nobody_listed_is_written_by_the_engineer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    played("an-effect-of-ones-own.md")
    study = Study.open(Path("groove"))
    versions = study.versions()
    assert [dict(version.effects) for version in versions] == [
        {},
        {"groove.rear": {"reach": pytest.approx(0.02, abs=1e-3)}},
    ]
    falls(versions)
    diagnosis = study.diagnosis()
    assert diagnosis is not None
    assert diagnosis["verdict"] == "nothing missing"
    found = {p["name"]: p for p in versions[-1].result["parameters"]}["groove.rear.c"]
    assert abs(found["value"] - 2500.0) < 1.5 * found["half95"]


def test_the_pages_are_the_pictured_ones() -> None:
    assert set(PICTURES) == {file.name for file in STORIES.glob("*.md")}
    for page, (picture, _) in PICTURES.items():
        assert f"../images/stories/{picture})" in (STORIES / page).read_text(encoding="utf-8")


PRINTED = "  version  used\n  -------  ----\n  1        3.73\n  2        1.00\nbar is missing (p = 0.025).\n"


@pytest.mark.parametrize(
    "shown",
    ["1 3.73\n2 1.00", "… 1 3.74 … bar is\nmissing (p = 0.025).", "version used\n---- --\n…", "", "bar … (p = 0.025)."],
)
def test_what_was_printed_is_found(shown: str) -> None:
    assert not_printed(shown, PRINTED) is None


@pytest.mark.parametrize(
    ("shown", "missing"),
    [
        ("1 3.93", "1 3.93"),
        ("bar is … 1 3.73", "1 3.73"),
        ("bar is not missing", "bar is not missing"),
        ("1 3.73 … (p = 0.05).", "(p = 0.05)."),
        ("1 … foo", "foo"),
    ],
)
def test_what_was_not_printed_is_told(shown: str, missing: str) -> None:
    assert not_printed(shown, PRINTED) == missing


@pytest.mark.parametrize(
    ("shown", "printed", "same"),
    [("19405", "19800", True), ("19405", "20100", False), ("1.00", "1.015", True), ("1.00", "1.05", False),
     ("2.3e+02", "2.35e+02", True), ("2.3e+02", "2.5e+02", False), ("−5", "-5.1", True)],
)  # fmt: skip
def test_a_number_is_close_when_rounding_alone_can_tell_them_apart(shown: str, printed: str, same: bool) -> None:
    assert close(shown, printed) is same
