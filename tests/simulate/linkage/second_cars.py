"""Second cars of the tests: the variants, some with other rubber or no dampers, built once."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np

from lacet.simulate import make_manoeuvre, run
from lacet.simulate.linkage.cars import SECOND_CARS, SecondCar
from lacet.simulate.linkage.mechanism import Mechanism
from lacet.simulate.linkage.motion import LinkageMotion
from lacet.simulate.linkage.parts import Linkage
from lacet.simulate.linkage.statics import Statics

ALL = tuple(SECOND_CARS)
RIGID = tuple(name for name in ALL if SECOND_CARS[name].get("rigid"))


class Stiffened(SecondCar):
    """A car whose rods and bushings are `FACTOR` times as stiff."""

    FACTOR = 100.0

    @functools.cached_property
    def linkage(self) -> Linkage:
        own = SecondCar(self.sizes, self.live_axle, self.rigid, self.engine_mounts).linkage
        more = self.FACTOR
        tied = {name: tie.component for tie in own.ties for name in tie.bushings}
        bushings = tuple(
            replace(
                b,
                stiffness=tuple(
                    more * k if b.held[i] or i == tied.get(b.name) else k for i, k in enumerate(b.stiffness)
                ),
            )
            for b in own.bushings
        )
        return replace(own, rods=tuple(replace(r, stiffness=more * r.stiffness) for r in own.rods), bushings=bushings)


class Undamped(SecondCar):
    """A car in which nothing is damped."""

    @functools.cached_property
    def linkage(self) -> Linkage:
        own = SecondCar(self.sizes, self.live_axle, self.rigid, self.engine_mounts).linkage
        return replace(
            own,
            rods=tuple(replace(r, damping=0.0) for r in own.rods),
            dampers=(),
            bushings=tuple(replace(b, damping=(0.0, 0.0, 0.0)) for b in own.bushings),
            torsions=tuple(replace(t, damping=0.0) for t in own.torsions),
            rubbers=tuple(replace(r, damping=0.0) for r in own.rubbers),
        )


def mechanism(name: str, kind: type[SecondCar] = SecondCar) -> Mechanism:
    """A mechanism of a variant, at its design position."""
    out = Mechanism(kind.named(name))
    out.refresh()
    return out


@functools.cache
def statics(name: str, kind: type[SecondCar] = SecondCar) -> Statics:
    """Statics of a variant; what is solved is in the mechanism's data."""
    return Statics(mechanism(name, kind))


@functools.cache
def drive(name: str, manoeuvre: str, **settings: float) -> LinkageMotion:
    """A short motion of a variant, computed once."""
    return run(SecondCar.named(name), make_manoeuvre(manoeuvre, **{"duration": 0.4, **settings}), settle=0.3)


def shaken(name: str, seed: int = 1) -> Mechanism:
    """A mechanism away from its design position with random velocities, its loops closed."""
    out = mechanism(name)
    rng = np.random.default_rng(seed)
    out.lib.mj_integratePos(out.model, out.data.qpos, 0.01 * rng.standard_normal(out.model.nv), 1.0)
    out.data.qvel[:] = rng.standard_normal(out.model.nv)
    out.data.qvel[out.rack_dof] = 0.0
    out.loops.close()
    out.refresh()
    return out
