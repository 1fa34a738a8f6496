"""The benchmark of waiting: what it keeps, what its page concludes, and its answer in a clone without history."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from benchmarks.first_work import items, measuring, page, sides
from benchmarks.first_work.measuring import Cost, Kept

THEN, NOW = (sides.Side(name, name, Path(name), "lacet") for name in ("then", "now"))
ADD = next(item for item in items.PAIRS if item.name == "add")


def kept_times(file: Path, then: float, now: float) -> Kept:
    """Costs of `add` with a start-up of 1 s, measured twice in each commit; the second time is slower."""
    kept = Kept(file)
    for side, seconds in ((THEN, then), (NOW, now)):
        for slower in (0.0, 0.5):
            kept.add(page.key("add", side, items.START), Cost(1.0 + slower, 1.0, 100.0, 1.0))
            kept.add(page.key("add", side, items.FIRST), Cost(1.0 + seconds + slower, 1.0, 200.0, 3.0))
    return kept


def test_the_page_judges_the_smallest_times_beyond_start_up(tmp_path: Path) -> None:
    """One tenth is below the fifth wanted; three tenths are named among what misses."""
    text = page.page(kept_times(tmp_path / "good", 10.0, 1.0), THEN, NOW, 2)
    assert f"| {ADD.what} | 10.00 | 1.00 | 0.100 | 1/5 | yes |" in text
    assert "Nothing that was measured misses" in text
    assert "`where`, base model" in text[text.index("Not measured:") :]
    text = page.page(kept_times(tmp_path / "bad", 10.0, 3.0), THEN, NOW, 2)
    assert f"- {ADD.what}: 0.300, wanted 0.200." in text


def test_measurements_outlive_a_run_that_was_cut_off(tmp_path: Path) -> None:
    """Read again they are the same; those of one side can be dropped."""
    file = tmp_path / "kept.json"
    before = kept_times(file, 10.0, 1.0)
    again = Kept(file)
    for side in (THEN, NOW):
        name = page.key("add", side, items.FIRST)
        assert again.count(name) == 2
        assert again.least(name) == before.least(name)
    again.forget(page.key("add", NOW, ""))
    assert again.count(page.key("add", NOW, items.FIRST)) == 0
    assert again.count(page.key("add", THEN, items.FIRST)) == 2


def test_a_process_is_measured_and_a_failure_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Memory that was written to counts; a wrong exit code raises with what the process said."""
    monkeypatch.setattr(sides.Side, "work", property(lambda _: tmp_path))
    cost = measuring.ran([sys.executable, "-c", "b'x' * 80_000_000"], NOW)
    assert cost.memory > 80.0
    assert cost.seconds > 0.0
    with pytest.raises(measuring.Failed, match="no room"):
        measuring.ran([sys.executable, "-c", "raise SystemExit('no room')"], NOW)


def test_a_clone_without_the_commit_is_refused() -> None:
    """A shallow clone names the commit that it lacks and what brings it."""
    with pytest.raises(sides.NoCommit, match=r"0123456.*--unshallow"):
        sides.full_hash("0123456789012345678901234567890123456789")


def test_names_are_unique() -> None:
    """Measurements are kept by name."""
    every = [*items.STARTS, *items.PAIRS, *items.AGAIN, *items.LIMITS, *items.long_runs(items.MINUTES_LONG)]
    assert len({item.name for item in every}) == len(every)
