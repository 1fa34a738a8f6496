"""A parameter whose name is nearly that of a state is asked about."""

from __future__ import annotations

import pytest

from lacet.identify.effects.language.misspelling import distance, doubtful, doubtful_words
from lacet.identify.effects.language.parser import LineFault, read_line


@pytest.mark.parametrize(("one", "other", "letters"), [
    ("travel", "travel", 0), ("tarvel", "travel", 1), ("travl", "travel", 1), ("trave", "travel", 1),
    ("traavel", "travel", 1), ("tarvl", "travel", 2), ("lode", "load", 2), ("k", "rate", 4), ("", "rate", 4),
])  # fmt: skip
def test_letters_that_differ(one: str, other: str, letters: int):
    assert distance(one, other) == distance(other, one) == letters


@pytest.mark.parametrize(("name", "state"), [
    ("tarvl", "travel"), ("treval", "travel"), ("raat", "rate"), ("sped", "speed"), ("p", ""), ("k1", ""), ("gap", ""),
    ("stiffness", ""), ("friction", ""),
])  # fmt: skip
def test_a_name_within_two_letters_of_a_state_is_asked_about(name: str, state: str):
    text = f"own = suspension: {name} * travel * rate"
    assert doubtful_words(text) == ({name: state} if state else {})
    try:
        said = f"'{doubtful(read_line(text)).get(name, '')}'"
    except LineFault as fault:  # so near that it is refused at once
        said = str(fault)
    assert f"'{state}'" in said


def test_a_line_that_cannot_be_read_is_asked_about_too():
    line = "own = suspension: p * trafl**2 * sign(rate) + q * m, s in 0..1 N"
    with pytest.raises(LineFault):
        read_line(line)
    assert doubtful_words(line) == {"trafl": "travel"}


def test_a_parameter_with_bounds_is_meant():
    assert not doubtful(read_line("own = suspension: lode * travel, lode in 0..500 N/mm"))
    assert doubtful(read_line("own = suspension: lode * travel")) == {"lode": "load"}
