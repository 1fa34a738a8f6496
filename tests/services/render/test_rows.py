"""Rows of the equations in words."""

from __future__ import annotations

from lacet.services.render.rows import failing_in_one_run


def scores(*ratios: float, judged: bool = True) -> dict[str, dict[str, dict[str, object]]]:
    """Scores of the row tyre.fl in so many runs of 100 samples."""
    return {
        f"run {k}": {
            "tyre.fl": {
                "rms": ratio, "floor": 1.0, "ratio": ratio, "samples": 100, "judged": judged,
                "colour": "coloured: 4.2 Hz",
            }
        }
        for k, ratio in enumerate(ratios)
    }  # fmt: skip


def test_a_row_that_fails_in_one_run_alone_is_said() -> None:
    """Nothing is found missing over all runs then, and `lacet compare` shows that row failing."""
    said = failing_in_one_run(scores(1.31, 1.02, 0.95), ())
    assert said.startswith("in run 0 alone tyre.fl is at 1.31 of its floor (coloured: 4.2 Hz), over all runs at 1.10")


def test_nothing_is_said_twice_nor_of_rows_that_are_not_judged() -> None:
    assert not failing_in_one_run(scores(1.31, 1.02), ("tyre.fl",))
    assert not failing_in_one_run(scores(1.31, 1.02, judged=False), ())
    assert not failing_in_one_run(scores(1.31, 1.31), ())
    assert not failing_in_one_run(scores(1.31), ())
    assert not failing_in_one_run(scores(1.02, 1.01), ())


def test_scores_of_an_older_study_say_less() -> None:
    old = {run: {"tyre.fl": {"rms": 1.31 - k, "floor": 1.0, "ratio": 1.31 - k}} for k, run in ((0, "a"), (0.4, "b"))}
    assert failing_in_one_run(old, ()).startswith("in a alone tyre.fl is at 1.31 of its floor (no colour)")
