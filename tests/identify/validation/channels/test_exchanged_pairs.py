"""Wheels whose loads or travels are exchanged, by the equations alone: no ground laser says which tyre a load is of."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lacet.daq.rig import Rig
from lacet.daq.run import Run
from lacet.daq.vehicle import Vehicle
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.validation.channels.exchanged_pairs import ExchangedPair
from lacet.identify.validation.channels.single_faults import column_faults
from lacet.identify.validation.exchanged_wheels import DISTANCES, LOADS, Wires
from lacet.services.render.channels import from_equations
from tests.support.tables import CAR, piece

RIG, VEHICLE = Rig.load(CAR / "rig.toml"), Vehicle.load(CAR / "vehicle.toml")


def exchanged(run: Run, kinds: frozenset[str], one: str, other: str) -> Run:
    """The run with the channels of two wheels the other way round, but those of ground lasers."""
    there = {one: other, other: one}
    signals = {}
    for name, signal in run.signals.items():
        kind, corner, *rest = name.split(".")
        if kind in kinds and corner in there and "ground" not in rest:
            corner = there[corner]
        signals[".".join((kind, corner, *rest))] = signal
    return replace(run, signals=signals)


@pytest.mark.parametrize(
    ("wires", "pair", "zero"),
    [(Wires.LOADS, ("rl", "rr"), 0.0), (Wires.DISTANCES, ("fr", "rl"), 0.0), (Wires.DISTANCES, ("fl", "fr"), 0.02)],
    ids=["loads", "travels", "travels with a zero"],
)
def test_two_wheels_the_other_way_round_are_named(wires: Wires, pair: tuple[str, str], zero: float) -> None:
    kinds = {Wires.LOADS: LOADS, Wires.DISTANCES: DISTANCES}[wires]
    run = exchanged(piece("sine", 2.0, 14.0), kinds, *pair)
    if zero:
        travel = run.signals["laser.rr.hub"]
        run = replace(run, signals={**run.signals, "laser.rr.hub": replace(travel, values=travel.values + zero)})
    else:
        run = replace(run, signals={name: one for name, one in run.signals.items() if "ground" not in name})
    (found,) = column_faults([PreparedRun.of(run, VEHICLE, RIG)])
    assert isinstance(found, ExchangedPair)
    assert (found.corners, found.wires) == (pair, wires)
    assert found.remaining < 1.0 < found.misfit
    assert f"of {pair[0]} and {pair[1]} are exchanged" in from_equations(found)
