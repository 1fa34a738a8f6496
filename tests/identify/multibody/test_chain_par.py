"""SYMORO's files: what is read, what is refused, and that nothing is run."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lacet.daq.expressions.expression import Expression
from lacet.identify.multibody.chain import Chain
from lacet.identify.multibody.chain_base_parameters import base_parameters
from lacet.identify.multibody.chain_notes import (
    ConstantPosition,
    GeometryMissing,
    GravityAssumed,
    LoadsLeftOut,
    LoopsCut,
    ParametersMissing,
    ValuesUnused,
)
from lacet.identify.multibody.symoro import ParError, read_par
from lacet.services.workspace.loading import load_chain
from tests.support.places import HOME

FOLDER = HOME / "tests" / "data" / "symoro"
CARLITE = json.loads((FOLDER / "CarLite.json").read_text(encoding="utf-8"))
# A five-bar-like robot whose loop is cut at joint 5, with every spelling the format allows.
LOOP = """\
(* General parameters of a robot
   in two lines *)
(* Robotname = 'Bars' *)
NF = 6
NL = 4
NJ = 5
Type = 2 (* Closed *)
Ant  = {
    0,1,1,3,
    2,4}
Sigma = {0,0,0,0,0,2}
d = {0,L1,2*L1,cos(A)*L1,L2,L2 }
R = {0,0,0,0,0,0}
Alpha = {Pi/2,0,0,0,0,0}
gamma = {0,0,0,A - pi/6,0,0}
Theta = {t1,t2 + pi/2,t3,t4,t5,0}
XX = {0,XX2,0.0,4,}
YY = {0,YY2,JY,YY4}
ZZ = {ZZ1,ZZ2,ZZ3,ZZ4}
XY = {0,0,0,0}
XZ = {0,0,0,0}
YZ = {0,0,0,0}
MX = {0,MX2,MX3,MX4}
MY = {0,0,0,0}
MZ = {0,0,0,0}
M = {0,M2,M3,M4}
IA = {IA1,0,0,0}
G = {0,0,-G3}
FX = {0,0,0,FX4}
"""


def written(tmp_path: Path, text: str) -> Path:
    """A file of this text."""
    path = tmp_path / "robot.par"
    path.write_text(text, encoding="utf-8")
    return path


def test_carlite_is_its_table(tmp_path: Path) -> None:
    """The file with the case's values gives the case's table, gravity and SYMORO's count."""
    chain = load_chain(FOLDER / "CarLite.par", CARLITE["geometry_values"])
    table = Chain.from_table(CARLITE["mdh"], (0.0, 0.0, CARLITE["geometry_values"]["G3"]))
    for mine, stored in zip(chain.joints, table.joints, strict=True):
        assert (mine.j, mine.ant, mine.sigma) == (stored.j, stored.ant, stored.sigma)
        for key in ("gamma", "b", "alpha", "d", "theta", "r"):
            assert getattr(mine, key) == pytest.approx(getattr(stored, key), abs=1e-12)
    np.testing.assert_array_equal(chain.gravity, table.gravity)
    listed = {*CARLITE["param_names"]}
    assert {*chain.parameter_names} - chain.absent == {n for n in listed if n in chain.parameter_names}
    assert base_parameters(chain).rank == CARLITE["n_base_inertial"] == 68
    assert base_parameters(chain, friction=True).rank == CARLITE["n_base_total"] == 88


def test_without_values_the_structure_stands_and_numbers_are_refused() -> None:
    """The rank needs no values; torques name the symbols that lack one; a misspelt one is pointed at."""
    chain = load_chain(FOLDER / "CarLite.par")
    assert chain.missing == ("LF", "EF", "LR", "ER")
    assert GravityAssumed((0.0, 0.0, -9.80665), ("G3",)) in chain.notes
    base = base_parameters(chain)
    assert base.rank == 68
    zero = np.zeros((1, 16))
    for call in (
        lambda c: c.inverse_dynamics(zero, zero, zero, {}),
        lambda c: c.regressor(zero, zero, zero),
        lambda c: c.jacobian(7, zero),
        lambda c: c.pose(7, zero),
    ):
        with pytest.raises(ValueError, match="LF, EF, LR, ER"):
            call(chain)
    with pytest.raises(ValueError, match="'LFF' was given: is 'LF' meant"):
        load_chain(FOLDER / "CarLite.par", {"LFF": 1.0}).pose(1, zero)
    full = chain.with_values({k: v for k, v in CARLITE["geometry_values"].items() if k in chain.missing})
    with pytest.raises(ValueError, match=r"no symbol G3 .*from_par"):
        chain.with_values({"G3": 9.81})  # gravity was settled when the file was read
    assert full.pose(7, zero)[0, :3, 3] == pytest.approx(
        Chain.from_table(CARLITE["mdh"]).pose(7, zero)[0, :3, 3], abs=1e-12
    )
    assert ValuesUnused(("spare",)) in load_chain(FOLDER / "CarLite.par", {"spare": 1}).notes


def test_a_loop_is_read_as_its_tree(tmp_path: Path) -> None:
    """Four bodies of six frames; the cut is noted; symbols of the cut frames are not asked for."""
    chain = load_chain(written(tmp_path, LOOP), {"L1": 0.5, "A": 0.3, "G3": 9.0, "JY": 2.5})
    assert [(k.ant, k.sigma) for k in chain.joints] == [(0, 0), (1, 0), (1, 0), (3, 0)]
    assert not chain.missing
    assert [k.d for k in chain.joints] == pytest.approx([0.0, 0.5, 1.0, 0.5 * np.cos(0.3)])
    assert chain.joints[3].gamma == pytest.approx(0.3 - np.pi / 6)
    assert chain.joints[1].theta == pytest.approx(np.pi / 2)
    assert chain.gravity.tolist() == [0.0, 0.0, -9.0]
    assert chain.notes == (LoopsCut(4, (5,)), LoadsLeftOut(("FX",)), GeometryMissing(("b",)))
    assert chain.given == {"XX4": 4.0, "YY3": 2.5}
    assert {"XX1", "XX3", "IA2", "M1"} <= chain.absent
    assert not {"XX4", "YY3", "ZZ1", "IA1", "FV1"} & chain.absent
    assert read_par(LOOP).name == "Bars"


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("0,1,1,3,", "0,1,1,4,", "line 9: ant of joint 4 is 4: a joint comes after its antecedent"),
        ("{0,0,0,0,0,2}", "{0,0,3,0,0,2}", "line 11: sigma of joint 3 is 3: 0, 1 or 2"),
        ("{0,0,0,0,0,2}", "{0,x,0,0,0,2}", "line 11: sigma of joint 2 must be a whole number"),
        ("R = {0,0,0,0,0,0}", "R = {0,0,0}", "line 13: r has 3 entries, 4 or 5 or 6"),
        ("R = {0,0,0,0,0,0}", "R = {0,0,0,0,0,0,0}", "line 13: r has 7 entries, 4 or 5 or 6"),
        ("2*L1,", "2*L1 +,", "line 12: d of joint 3: '2[*]L1 [+]': this is no arithmetic"),
        ("2*L1,", "open(1),", "line 12: d of joint 3: .*the function open is not known"),
        ("2*L1,", "1/0,", "line 12: d of joint 3"),
        ("t2 + pi/2", "2*t2", "line 16: theta of joint 2: '2[*]t2' is not the joint position t2 plus"),
        ("t3,t4", "t2,t4", "line 16: t2 is the position of joint 2 and of 3"),
        ("YY = {0,YY2,JY,YY4}", "YY = {0,YY2,JY,YY4", "line 18: 'YY = .*brace is never closed"),
        ("NL = 4", "NL = four", "line 5: NL must be a whole number"),
        ("NL = 4", "NL = 100000000", "line 8: ant has 6 entries, NL is 100000000"),
        ("NL = 4", "", "NL, the number of bodies, is missing"),
        ("(* Closed *)", "(* Closed", "a comment .* never closed"),
        ("G = {0,0,-G3}", "G = {0,-G3}", "line 28: G has 2 entries"),
        ("G = {0,0,-G3}", "is_floating = 1", "line 28: is_floating = 1: a moving base"),
        ("G = {0,0,-G3}", "W0 = {0,0,w}", "line 28: W0: the base must be at rest"),
        ("G = {0,0,-G3}", "M = {0,1,2,3}", "line 28: M is given twice, first in line 26"),
        ("G = {0,0,-G3}", "some words", "line 28: 'some words' cannot be read"),
    ],
)
def test_each_fault_is_named_with_its_line(tmp_path: Path, old: str, new: str, says: str) -> None:
    """What is wrong, where, in one message."""
    assert old in LOOP
    with pytest.raises(ParError, match=says):
        load_chain(written(tmp_path, LOOP.replace(old, new, 1)))


def test_all_faults_at_once(tmp_path: Path) -> None:
    """Three faults, three lines, in the order of the file."""
    bad = LOOP.replace("0,1,1,3,", "0,1,9,3,").replace("2*L1,", "import os,").replace("t1,", "sin(t1),")
    with pytest.raises(ParError) as caught:
        load_chain(written(tmp_path, bad))
    assert [fault.split(":")[0] for fault in caught.value.faults] == ["line 9", "line 12", "line 16"]
    assert isinstance(caught.value, ValueError)


def test_a_file_without_a_column_says_so(tmp_path: Path) -> None:
    """A column left out, or written with another name, is no reason to be silent."""
    chain = load_chain(written(tmp_path, LOOP.replace("R = {", "RR = {").replace("MX = {", "MXX = {")))
    assert GeometryMissing(("b", "r")) in chain.notes
    assert ParametersMissing(("MX",)) in chain.notes


def test_a_number_in_place_of_a_position_and_a_file_without_gravity(tmp_path: Path) -> None:
    """Both are read, with a note of what was assumed; values given later do not lose it."""
    chain = load_chain(written(tmp_path, LOOP.replace("{t1,", "{0.5,").replace("G = {0,0,-G3}", "")))
    noted = {ConstantPosition("theta", 1, "0.5"), GravityAssumed((0.0, 0.0, -9.80665))}
    assert noted <= {*chain.notes}
    assert chain.with_values({"L1": 0.5}).notes == chain.notes


def test_gravity_sideways_needs_its_value(tmp_path: Path) -> None:
    """Only an unknown third entry has a default; gravity given wins over the file's."""
    path = written(tmp_path, LOOP.replace("{0,0,-G3}", "{GX,0,0}"))
    with pytest.raises(ValueError, match="G needs the values of GX"):
        load_chain(path)
    assert load_chain(path, gravity=(1, 2, 3)).gravity.tolist() == [1.0, 2.0, 3.0]
    assert load_chain(path, {"GX": 4.0}).gravity.tolist() == [4.0, 0.0, 0.0]


@given(st.text(alphabet="LA12+-*/^()., pi_cosqrt'[]{}\":\n", max_size=40))
def test_expressions_are_numbers_or_refused(text: str) -> None:
    """Whatever is written, it is a finite number, a symbol that lacks a value, or a ValueError."""
    try:
        found = Expression.parse(text)
        values = dict.fromkeys(found.symbols, 0.7)
        assert np.isfinite(found.value(values))
    except ValueError:
        pass


@pytest.mark.parametrize(
    "text",
    ["__import__('os')", "(1).__class__", "[1]", "lambda: 1", "1 if 1 else 2", "f'{1}'", "a.b", "a[0]", "True",
     "'x'", "1j", "cos()", "atan2(1)", "cos(x=1)", "9**9**9**9", "(" * 500 + "1" + ")" * 500, "-" * 3000 + "1", ""],
)  # fmt: skip
def test_what_is_no_arithmetic_is_refused(text: str) -> None:
    """Nothing but arithmetic is read, and nothing of it is run."""
    with pytest.raises(ValueError, match=r"'|nothing|longer"):
        Expression.parse(text).value({})
