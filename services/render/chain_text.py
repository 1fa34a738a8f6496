"""Notes of a chain in words: the assumptions made when it was read."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from lacet.identify.multibody.chain_notes import (
    ChainNote,
    ConstantPosition,
    FramesInserted,
    GeometryMissing,
    GravityAssumed,
    LinksJoined,
    LoadsLeftOut,
    LoopsCut,
    NearlyRight,
    ParametersMissing,
    ValuesUnused,
)


def chain_notes(notes: Iterable[ChainNote]) -> list[str]:
    """The notes of a chain (`Chain.notes`), a sentence each."""
    return [_sentence(note) for note in notes]


def _sentence(note: ChainNote) -> str:
    match note:
        case LoopsCut(bodies, joints):
            return (
                f"{len(joints)} closed loop(s): the equivalent tree of bodies 1…{bodies} is taken, cut at joint(s) "
                f"{', '.join(str(j) for j in joints)}. Torques and base parameters are the tree's: those of the closed "
                "robot follow with its constraints (a loop can only group more)"
            )
        case LoadsLeftOut(names):
            return f"external forces ({', '.join(names)}) are left out: torques are those of free bodies"
        case GeometryMissing(names):
            return f"the file has no {', '.join(names)}: taken as 0"
        case ParametersMissing(names):
            return f"the file has no {', '.join(names)}: every body is taken to have them"
        case ConstantPosition(key, joint, text):
            return f"{key} of joint {joint} is the number {text}: taken as what stands beside the joint position"
        case GravityAssumed(gravity, ()):
            return f"the file has no G: gravity is {_vector(gravity)}"
        case GravityAssumed(gravity, symbols):
            return f"{', '.join(symbols)} has no value: gravity is {_vector(gravity)}"
        case ValuesUnused(names):
            return f"values were given for unknown symbols: {', '.join(names)}"
        case LinksJoined(names):
            return f"link(s) {', '.join(names)} on fixed joints are part of the body that carries them"
        case FramesInserted(numbers):
            return (
                f"axes are nearly parallel: fixed frame(s) {', '.join(str(j) for j in numbers)} were inserted; states "
                "have a column for each"
            )
        case NearlyRight(places, most):
            return (
                f"angles of {', '.join(places)} are up to {most:.1g} rad off a quarter turn: taken as they are; "
                f"rounding={10.0 ** math.ceil(math.log10(most)):.0e} takes them as quarter turns"
            )


def _vector(values: Sequence[float]) -> str:
    return f"({', '.join(f'{v:g}' for v in values)}) m/s² in the ground frame"
