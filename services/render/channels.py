"""Sentences about faults of single channels."""

from __future__ import annotations

from lacet.identify.validation.channels.recorded_values import Copies, StandsStill


def at_rest(found: StandsStill) -> str:
    """A column that stands still, with its seconds and the remedy."""
    return (
        f"{found.column} stands still at {found.value:.6g} from {found.start:.2f} to {found.stop:.2f} s while others "
        "of its kind move: the instrument or its wire is dead. Leave the channel, or these seconds, out"
    )


def copies(found: Copies) -> str:
    """Columns with the same values, and the remedy."""
    first, *others = found.columns
    return (
        f"{', '.join(others)} {'is' if len(others) == 1 else 'are'} {first} again, sample by sample: "
        f"{'one of them was' if len(others) == 1 else 'all but one were'} written from the wrong channel. Export the "
        "table anew, or leave out those that are wrong"
    )
