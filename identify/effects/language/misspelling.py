"""Parameters of a one-line effect whose names may be misspelt states."""

from __future__ import annotations

import re

from lacet.daq.expressions.expression import CONSTANTS
from lacet.identify.effects.language.linearity import FUNCTIONS
from lacet.identify.effects.language.parser import Line
from lacet.identify.effects.language.states import STATES, use_of

MOST_LETTERS = 2
"""Number of letters, at most, in which a misspelt name differs: other, missing, extra, or exchanged with the next."""
SHORTEST_STATE = 4
"""Length of the shortest state that is looked for: of shorter ones nearly every short name is a neighbour."""
SHORTEST_NAME = 3


def doubtful(line: Line) -> dict[str, str]:
    """Parameter → the state that it may be meant for; without parameters whose bounds the line gives.

    Examples
    --------
    >>> from lacet.identify.effects.language.parser import read_line
    >>> doubtful(read_line("bump = suspension: tarvl * rate"))
    {'tarvl': 'travel'}
    """
    found = {name: _nearest(name) for name in line.parameters if name not in line.bounds}
    return {name: state for name, state in found.items() if state}


def doubtful_words(text: str) -> dict[str, str]:
    """The same of the words of a line that cannot be read: those of its law that have no meaning yet."""
    law = text.partition(":")[2].partition("#")[0].split(",")[0]
    names = [name for name in re.findall(r"[A-Za-z_]\w*", law) if name not in (*FUNCTIONS, *CONSTANTS)]
    found = {name: _nearest(name) for name in names if use_of(name) is None}
    return {name: state for name, state in found.items() if state}


def _nearest(name: str) -> str:
    """The state nearest to a name within `MOST_LETTERS`; an empty string where there is none."""
    if len(name) < SHORTEST_NAME:
        return ""
    most = min(MOST_LETTERS, len(name) - 2)
    far = {state: distance(name.lower(), state) for state in STATES if len(state) >= SHORTEST_STATE}
    best = min(far, key=lambda state: far[state])
    return best if far[best] <= most else ""


def distance(one: str, other: str) -> int:
    """Number of letters to change, insert, leave out or exchange with the next that make one word of another.

    Optimal string alignment (Damerau, Comm. ACM 7, 1964).
    """
    before: list[int] = []
    row = list(range(len(other) + 1))
    for i, letter in enumerate(one, 1):
        last, row = row, [i]
        for j, own in enumerate(other, 1):
            found = min(last[j] + 1, row[j - 1] + 1, last[j - 1] + (letter != own))
            if i > 1 and j > 1 and letter == other[j - 2] and one[i - 2] == own:
                found = min(found, before[j - 2] + 1)
            row.append(found)
        before = last
    return row[-1]
