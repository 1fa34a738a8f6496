"""Columns of two joints that are exchanged are named; a wrong sign, or a law that is missing, is no exchange."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.identify.chains.exchanges import ExchangedColumns, ExchangedJoints, exchanged_joints
from lacet.identify.multibody.chain import Chain
from lacet.services.library.chains import IdentifiedChain, identify_chain
from tests.identify.chains.arms import ARM, RATE, record


def of(found: IdentifiedChain) -> ExchangedJoints | None:
    """The exchange found, without the other doubts."""
    return exchanged_joints(found.fitted, found._recorded, found.filters, found.slowest)


@pytest.mark.parametrize(
    ("columns", "pair"),
    [(ExchangedColumns.POSITIONS, (1, 2)), (ExchangedColumns.TORQUES, (2, 3)), (ExchangedColumns.BOTH, (0, 1))],
)
def test_exchanged_columns_are_named(columns: ExchangedColumns, pair: tuple[int, int]):
    """With the two joints, and errors that are those of noise once they are exchanged."""
    order = np.arange(4)
    order[list(pair)] = pair[::-1]
    q, tau = record(31)
    found = identify_chain(
        ARM, q if columns is ExchangedColumns.TORQUES else q[:, order],
        tau if columns is ExchangedColumns.POSITIONS else tau[:, order], rate=RATE, cutoff=0.9,
    )  # fmt: skip
    one = of(found)
    assert one is not None
    assert one.joints == (ARM.names[pair[0]], ARM.names[pair[1]])
    assert one.columns == (columns,)
    assert max(one.exchanged) < 0.2 * min(one.sigma)


def test_of_a_long_record_the_beginning_shows_it():
    q, tau = record(31, 150.0)
    found = identify_chain(ARM, q, tau[:, [0, 1, 3, 2]], rate=RATE, cutoff=0.9)
    one = of(found)
    assert one is not None
    assert (one.joints, one.columns) == (ARM.names[2:4], (ExchangedColumns.TORQUES,))
    part = found._recorded.beginning(0.4)
    assert (len(part.q), len(part.tau), len(part.missing)) == (len(q) * 2 // 5,) * 3


def test_no_law_is_named_beside_exchanged_columns():
    """Cross-friction of two joints fits exchanged torques: it is in doubt, and what to do is said."""
    q, tau = record(31)
    found = identify_chain(ARM, q, tau[:, [0, 1, 3, 2]], rate=RATE, cutoff=0.9)
    assert f"The columns of {ARM.names[2]} and {ARM.names[3]} fit exchanged in tau" in str(found)
    ranking = found.rank()
    assert ranking.verdict == "unsound fit"
    assert ranking.missing == ()


def test_what_else_is_wrong_is_no_exchange():
    """A torque of opposite sign, a joint's position of opposite sign, a stiff spring; and nothing wrong."""
    q, tau = record(31)
    spring = np.outer(60.0 * (q[:, 1] - 0.3), [0.0, 1.0, 0.0, 0.0])
    for signs, mirrored, more in (
        ([1, 1, -1, 1], [1, 1, 1, 1], 0.0), ([1, 1, 1, 1], [1, -1, 1, 1], 0.0),
        ([1, 1, 1, 1], [1, 1, 1, 1], spring), ([1, 1, 1, 1], [1, 1, 1, 1], 0.0),
    ):  # fmt: skip
        assert of(identify_chain(ARM, q * mirrored, tau * signs + more, rate=RATE, cutoff=0.9)) is None


def test_friction_between_two_joints_that_fits_one_of_them_exchanged_is_no_exchange():
    """The other joint's error stays: of exchanged columns both are wrong."""
    q, tau = record(31)
    rates = np.gradient(q, 1.0 / RATE, axis=0)
    coupled = 20.0 * rates @ np.eye(4)[[0, 3, 2, 1]] * [0.0, 1.0, 0.0, 1.0]
    assert of(identify_chain(ARM, q, tau + coupled, rate=RATE, cutoff=0.9)) is None


def test_slides_that_do_not_act_on_each_other_fit_exchanged_either_way():
    """Both columns that may be exchanged are named."""
    slides = Chain.from_table([{"j": j, "ant": 0, "sigma": 1} for j in (1, 2)])
    t = np.arange(0.0, 20.0, 0.01)[:, None]
    w = np.array([1.3, 2.1])
    rng = np.random.default_rng(1)
    q, tau = np.sin(w * t), [3.0, 5.0] * (9.81 - w**2 * np.sin(w * t)) + 0.1 * rng.standard_normal((len(t), 2))
    one = of(identify_chain(slides, q[:, ::-1], tau, rate=100, effects=[]))
    assert one is not None
    assert set(one.columns) == {ExchangedColumns.POSITIONS, ExchangedColumns.TORQUES}
