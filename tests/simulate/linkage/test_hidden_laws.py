"""Hidden effects of a second car: their forces against power, and against what the law says in plain numbers."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.daq.channels import CORNERS
from lacet.simulate import KINDS, Hidden, make_manoeuvre, run
from lacet.simulate.hidden import suspension_law
from lacet.simulate.linkage.cars import SecondCar
from lacet.simulate.linkage.engine import LinkageEngine
from lacet.simulate.linkage.hidden_laws import ALONG_DAMPERS, ALONG_SPRINGS, OF_AIR, OF_TYRES, laws_of
from lacet.simulate.linkage.mechanism import Mechanism
from lacet.simulate.road import FLAT
from tests.simulate.linkage.second_cars import shaken

CAR = SecondCar.named("second")
SHAPES = {"gap": 0.001, "v0": 0.01, "length": 0.01}


def hidden(kind: str, size: float, where: str = "rl") -> Hidden:
    """An effect whose constants are small enough for a shaken car."""
    shape = {name: value for name, value in SHAPES.items() if name in KINDS[kind].shape}
    return Hidden(f"{kind}.{where}", size, shape=shape)


def force(mechanism: Mechanism) -> np.ndarray:
    """(nv,) generalised force of the elements and the weight at the data's state."""
    mechanism.clear()
    mechanism.elements.apply(np.zeros(mechanism.elements.states))
    return mechanism.applied()


@pytest.mark.parametrize("kind", [*ALONG_SPRINGS, *ALONG_DAMPERS])
def test_power_of_a_law_is_its_force_times_the_rate_of_compression(kind: str) -> None:
    """By the distance of the part's ends along the motion; at rest in the design position no law has a force."""
    effect = hidden(kind, 1e9 if kind == "spring_cubic" else 1e4)
    plain = shaken("second", 1 if kind == "rebound_stop" else 4)
    bent = Mechanism(CAR, laws_of([effect], CAR.name))
    bent.refresh()
    assert force(bent) == pytest.approx(force(Mechanism(CAR)), abs=1e-6)
    q, v = plain.data.qpos.copy(), plain.data.qvel.copy()
    bent.data.qpos[:], bent.data.qvel[:] = q, v
    bent.refresh()
    extra = force(bent) - force(plain)
    lines = (*CAR.linkage.springs, *CAR.linkage.dampers)
    part = "spring_rl" if kind in ALONG_SPRINGS else "damper_rl"
    (line,) = (one for one in lines if one.name == part)
    ends = [plain.lib.mj_name2id(plain.model, plain.lib.mjtObj.mjOBJ_SITE, f"{part}.{end}") for end in "ab"]

    def length(ahead: float) -> float:
        plain.data.qpos[:] = q
        plain.lib.mj_integratePos(plain.model, plain.data.qpos, v, ahead)
        plain.refresh()
        a, b = plain.data.site_xpos[ends]
        return float(np.linalg.norm(b - a))

    design = float(np.linalg.norm(np.subtract(line.b.at, line.a.at)))
    s, rate = design - length(0.0), -(length(1e-6) - length(-1e-6)) / 2e-6
    law = suspension_law(effect)
    assert law is not None
    assert extra @ v == pytest.approx(-law(s, rate) * rate, rel=1e-5, abs=1e-5)
    assert abs(extra @ v) > 1e-3


@pytest.mark.parametrize("text", ["aero_drag=0.5,height=0.4", "aero_lift.rear=0.4", "aero_side=2,x=-1"])
def test_the_air_loads_the_body(text: str) -> None:
    """Force and moment about the body's origin, driving straight ahead at 30 m/s and drifting 2 m/s to the left."""
    loads: list[np.ndarray] = []
    for effects in ((), (Hidden.parse(text),)):
        engine = LinkageEngine(CAR, FLAT, effects)
        engine.data.qvel[:2] = 30.0, 2.0
        engine.load(
            engine.data.qpos.tolist(), engine.data.qvel.tolist(), [0.0] * engine.states, 0.0, [0.0] * 4, [0.0] * 4, 1e-3
        )
        loads.append(engine.mechanism.applied()[:6])
    up = 0.4 - CAR.origin_height
    expected = {
        "aero_drag=0.5,height=0.4": [-450.0, 0, 0, 0, -450.0 * up, 0],
        "aero_lift.rear=0.4": [0, 0, 360.0, 0, 360.0 * CAR.wheelbase, 0],
        "aero_side=2,x=-1": [0, -120.0, 0, 0, 0, 120.0],
    }
    assert loads[1] - loads[0] == pytest.approx(expected[text], abs=1e-6)


def test_tyres_have_the_terms_that_are_hidden_in_them() -> None:
    """The load on a rear wheel along the road's normal, beyond stiffness times deflection."""
    rough = make_manoeuvre("rough", duration=0.15)
    size = 2e6
    motion = run(CAR, rough, [Hidden("tyre_progression.rear", size)], seed=1, settle=0.2)
    along = np.sum(motion.force * motion.normal[:, None], axis=-1)
    stiffness = np.array([CAR.axle(c).tyre_stiffness for c in CORNERS])
    beyond = along - stiffness * motion.deflection
    assert beyond[:, 2:] == pytest.approx(size * motion.deflection[:, 2:] ** 2, abs=1e-6)
    assert np.max(np.abs(beyond[:, :2])) < 1e-6
    assert np.min(beyond[:, 2:]) > 100.0


def test_what_can_be_hidden_are_kinds_of_the_first_car() -> None:
    assert {*ALONG_SPRINGS, *ALONG_DAMPERS, *OF_TYRES, *OF_AIR} <= set(KINDS)
    assert all(suspension_law(hidden(kind, 1.0)) is not None for kind in (*ALONG_SPRINGS, *ALONG_DAMPERS))
