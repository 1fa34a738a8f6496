"""Draws of a run in one piece and in several: which draws of the pieces make one of the run."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.identify.car.rows import Row
from lacet.identify.multibody.vectors import Array
from lacet.identify.validation.noise_floor import LEAST_OF_PIECE, RunDraws, draws_of_piece

HEAVE, SPIN = Row("chassis.fz"), Row("spin.rl")
DRAWN, COUNT = 4, 10


def drawn(*lengths: int, piece: int = 0) -> dict[Row, Array]:
    """Row → (DRAWN, n) numbers that tell row, piece, draw and sample apart."""
    return {
        row: np.asarray(10000.0 * r + 1000.0 * piece + 100.0 * np.arange(DRAWN)[:, None] + np.arange(n), float)
        for r, (row, n) in enumerate(zip((HEAVE, SPIN), lengths, strict=False))
    }


@pytest.fixture
def joined() -> RunDraws:
    """Three pieces, of which the second lacks a row."""
    pieces = [drawn(5, 3, piece=0), drawn(2, piece=1), drawn(4, 6, piece=2)]
    return RunDraws.joined(pieces, COUNT, np.random.default_rng(1))


def test_each_draw_of_a_run_is_one_draw_of_every_piece_end_to_end(joined: RunDraws) -> None:
    assert (joined.count, joined.drawn, joined.rows) == (COUNT, DRAWN, (HEAVE, SPIN))
    for r, (row, lengths) in enumerate({HEAVE: (5, 2, 4), SPIN: (3, 0, 6)}.items()):
        whole = joined.whole(row)
        assert whole.shape == (COUNT, sum(lengths))
        for draw in range(COUNT):
            parts = [
                10000.0 * r + 1000.0 * piece + 100.0 * joined.choice[piece, draw] + np.arange(n)
                for piece, n in enumerate(lengths)
            ]
            np.testing.assert_array_equal(whole[draw], np.concatenate(parts))


def test_the_draws_of_a_piece_are_used_equally_often_and_in_another_order_in_each(joined: RunDraws) -> None:
    """Ten of four: each twice or three times."""
    for chosen in joined.choice:
        assert set(np.bincount(chosen, minlength=DRAWN)) == {2, 3}
    assert len({tuple(chosen) for chosen in joined.choice}) == len(joined.choice)


def test_part_of_a_piece_has_the_samples_of_the_whole(joined: RunDraws) -> None:
    """Also behind a piece without the row; samples of two pieces are refused."""
    for row, start, end in ((HEAVE, 0, 5), (HEAVE, 1, 3), (HEAVE, 5, 7), (HEAVE, 8, 11), (SPIN, 0, 3), (SPIN, 3, 9)):
        series, choice = joined.piece(row, start, end)
        assert series.shape == (DRAWN, end - start)
        np.testing.assert_array_equal(series[choice], joined.whole(row)[:, start:end])
    for row, start, end in ((HEAVE, 4, 6), (HEAVE, 5, 8), (SPIN, 2, 4)):
        with pytest.raises(ValueError, match="not of one piece"):
            joined.piece(row, start, end)


def test_a_run_in_one_piece_keeps_its_draws_in_their_order() -> None:
    """As many as were drawn; where more are asked for, its draws are used again."""
    piece = drawn(5, 3)
    own = RunDraws.joined([piece], DRAWN, np.random.default_rng(1))
    for row, series in piece.items():
        assert own.whole(row) is series
        part, choice = own.piece(row, 1, 3)
        np.testing.assert_array_equal(part[choice], series[:, 1:3])
    more = RunDraws.joined([piece], COUNT, np.random.default_rng(1))
    assert more.whole(HEAVE).shape == (COUNT, 5)
    assert {tuple(line) for line in more.whole(HEAVE)} == {tuple(line) for line in piece[HEAVE]}


def test_no_draws_have_the_rows_and_no_line() -> None:
    none = RunDraws.none({HEAVE: 5, SPIN: 3})
    assert (none.count, none.drawn, none.whole(SPIN).shape) == (0, 0, (0, 3))


def test_pieces_of_a_long_run_are_drawn_less_often_than_the_run() -> None:
    """One piece as often as the run; more pieces share the draws, but each has enough for a p of its own."""
    assert draws_of_piece(199, 1) == 199
    assert draws_of_piece(199, 2) == 100
    assert draws_of_piece(199, 3) == 67
    assert draws_of_piece(199, 50) == LEAST_OF_PIECE
    assert draws_of_piece(19, 1) == draws_of_piece(19, 2) == draws_of_piece(19, 50) == 19
