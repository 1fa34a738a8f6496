"""For each family: how it is hidden in the simulated car, in which runs, and what its residual is drawn against."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field

from lacet.simulate import Hidden

CAR = RIG = "peugeot-406"
DURATION = 12.0
"""Of a run that does not say otherwise [s]."""
SEED = 7
SLALOM = "sweep amplitude=0.025 low=0.2 high=2 duration=24"
STEERING = "sinus amplitude=0.03"
BUMPY = "rough grade=C"
BRAKING = "braking deceleration=5"
COASTING = "liftoff"


@dataclass(frozen=True)
class Case:
    """How one family's picture is made.

    Attributes
    ----------
    state : what the residual is drawn against: a state of `validation.states`, or one of `residuals.FURTHER`.
    run : the run drawn, a manoeuvre with settings; `beside` : a second run, fitted together with it.
    rows : pattern of rows among which the one that stands out most is drawn.
    hidden : name of the simulator's effect, ``""`` where nothing is hidden; `size` of it [its unit], of a law with
        several parameters that of each; `shape` constants.
    only_there : whether the second run lacks it.
    loop : whether the path is drawn instead of points and their mean, for what has a memory.
    how : ``hidden``: simulated with the effect; ``law``: the simulator has no such effect, the catalogue's law stands
        in for it; ``share``: of the base model, what the family itself explains; ``none``: no picture, `why`.
    """

    state: str = ""
    run: str = ""
    rows: str = "*"
    hidden: str = ""
    size: float = 0.0
    shape: Mapping[str, float] = field(default_factory=dict[str, float])
    beside: str = ""
    only_there: bool = False
    loop: bool = False
    how: str = "hidden"
    why: str = ""

    @property
    def runs(self) -> tuple[str, ...]:
        """The run drawn and the one beside it."""
        return tuple(run for run in (self.run, self.beside) if run)

    @property
    def effects(self) -> tuple[Hidden, ...]:
        """What is hidden in the run drawn."""
        return (Hidden(self.hidden, self.size, shape=self.shape),) if self.hidden and self.how == "hidden" else ()

    @property
    def digest(self) -> str:
        """Changes when the picture would."""
        return hashlib.sha256(f"{self} {CAR} {DURATION} {SEED}".encode()).hexdigest()[:12]

    @property
    def option(self) -> str:
        """As `lacet simulate --hide` takes it."""
        constants = "".join(f",{name}={value:g}" for name, value in self.shape.items())
        return f"{self.hidden}={self.size:g}{constants}"


def _suspension(
    hidden: str, size: float, state: str, run: str = SLALOM, beside: str = BUMPY, loop: bool = False, **shape: float
) -> Case:
    return Case(state, run, "suspension.f*", f"{hidden}.front", size, shape, beside, loop=loop)


def _share(state: str, rows: str, run: str = BUMPY, beside: str = STEERING) -> Case:
    return Case(state, run, rows, beside=beside, how="share")


def _plain(state: str, rows: str, run: str, beside: str, hidden: str = "", size: float = 0.0) -> Case:
    return Case(state, run, rows, hidden, size, beside=beside)


_ON_LINKAGES = "Of axles with bench tables alone: [on the second car](benchmarks/second-car.md#what-a-diagnosis-names)."

CASES: dict[str, Case] = {
    "anti_roll_bar": _suspension(
        "anti_roll_bar", 15e3, "travel difference across the axle", "rough grade=C duration=24", "kerb"
    ),
    "axle_damping": Case(
        "rate difference across the axle", "rough grade=C duration=24", "suspension.f*", "axle_damping.front", -400.0,
        beside="kerb", how="law",
    ),
    "coulomb": _suspension("coulomb", 120.0, "travel rate", STEERING, v0=0.01),
    "damper_asymmetry": _suspension("damper_asymmetry", -600.0, "travel rate"),
    "damper_digressive": _suspension("damper_digressive", -2000.0, "travel rate"),
    "damper_saturation": Case(
        "travel rate", SLALOM, "suspension.f*", "damper_saturation.front", 2000.0, {"v0": 0.1}, BUMPY, how="law"
    ),
    "damper_knee": Case(
        "travel rate", SLALOM, "suspension.f*", "damper_knee.front", -1000.0, {"v0": 0.06}, BUMPY, how="law"
    ),
    **{
        f"damper_knee_{way}": Case(
            "travel rate", SLALOM, "suspension.f*", f"damper_knee_{way}.front", -1500.0, {"v0": 0.06}, BUMPY, how="law"
        )
        for way in ("bump", "rebound")
    },
    "damper_hysteresis": _suspension("damper_hysteresis", 200.0, "travel", STEERING, loop=True, length=0.003),
    "damper_mount": _suspension("series_damper", 15e3, "travel rate", loop=True, c=1500.0),
    "damper_stroke": _suspension("damper_stroke", 2e4, "travel × travel rate"),
    "damper_stroke_symmetric": Case(
        "travel rate", SLALOM, "suspension.f*", "damper_stroke_symmetric.front", 4e4, beside=BUMPY, how="law"
    ),
    "helper_spring": _suspension("helper_spring", 1e4, "travel", gap=0.005),
    "spring_quadratic": _suspension("spring_quadratic", 1e5, "travel"),
    "spring_cubic": _suspension("spring_cubic", 5e6, "travel"),
    "bump_stop": _suspension("bump_stop", 3e4, "travel", gap=0.02),
    "rebound_stop": _suspension("rebound_stop", 3e4, "travel", gap=0.02),
    "tyre_damping": Case("deflection rate", BUMPY, "tyre.f*", "tyre_damping.front", 800.0, beside=STEERING),
    "tyre_progression": Case(
        "tyre deflection", "sinus amplitude=0.045", "tyre.f*", "tyre_progression.front", 3e6, beside=BUMPY
    ),
    "aero_drag": Case("speed squared", BRAKING, "chassis.fx", "aero_drag", 0.8, {"height": 0.3}, COASTING),
    "aero_lift": Case("speed squared", BRAKING, "chassis.*", "aero_lift.front", 0.6, beside=BUMPY),
    "aero_side": Case(
        "speed × lateral speed", "sinus amplitude=0.03 speed=36", "chassis.*", "aero_side", 5.0, {"x": -1.2},
        "sinus amplitude=0.06 speed=14",
    ),
    "chassis_torsion": Case("roll acceleration", SLALOM, "chassis.*", "chassis_torsion", 1e5, beside=BUMPY),
    "engine_mount": Case(
        "7 Hz mass less body, acceleration", BUMPY, "chassis.*", "engine_mount", 250.0,
        {"frequency": 7.0}, STEERING,
    ),
    "payload": Case(
        "pitch acceleration", BUMPY, "chassis.fz", "payload", 100.0, beside=STEERING, only_there=True
    ),
    "anti_dive": Case("longitudinal wheel force", COASTING, "suspension.f*", "anti_dive.front", 0.1, beside=BUMPY),
    "jacking": Case("lateral wheel force", STEERING, "suspension.f*", "jacking.front", 0.08, beside=BUMPY),
    "camber_change": Case("lateral wheel force", STEERING, "suspension.f*", "camber_change.front", 0.3, beside=BUMPY),
    "toe_change": Case(
        "lateral wheel force", "sinus amplitude=0.06", "suspension.f*", "toe_change.front", -0.9, beside=BUMPY
    ),
    "pitch_change": Case("heave", BUMPY, "chassis.fx", "pitch_change.front", 1.0, beside=STEERING),
    "sensor_crosstalk": Case(
        "longitudinal acceleration", BRAKING, "chassis.fz", "sensor_crosstalk.wheel.force", 0.03,
        {"x": 0.0, "y": 0.0, "zx": 1.0}, BUMPY,
    ),
    "sensor_drift": Case(
        "time", "sinus amplitude=0.015 duration=120", "suspension.fl", "sensor_drift.wheel.fl.force.z", 20.0,
        beside=BUMPY,
    ),
    "sensor_gain": Case("travel", SLALOM, "tyre.fl", "sensor_gain.hub.fl", 0.05, beside=BUMPY),
    "sensor_latency": Case("deflection rate", BUMPY, "tyre.*", "sensor_latency.laser", 0.004, beside=STEERING),
    "sensor_misalignment": Case(
        "lateral acceleration", STEERING, "chassis.fx", "sensor_misalignment.imu.yaw", 0.03, beside=BRAKING
    ),
    "sensor_position": Case(
        "yaw acceleration", "sinus amplitude=0.03 frequency=1.5", "chassis.*", "sensor_position.imu.x", 0.15,
        beside=BUMPY,
    ),
    "laser_tilt": Case("pitch angle", BRAKING, "tyre.*", "laser_tilt.pitch", 0.03, beside=BUMPY),
    "rolling_resistance": _plain("speed", "chassis.fx", COASTING, STEERING, "rolling_resistance.front", 0.01),
    "camber_thrust": _plain("camber", "suspension.f*", STEERING, BUMPY, "camber_thrust.front", 1.0),
    "steer_compliance": _plain("steer", "suspension.f*", STEERING, BUMPY, "steer_compliance.front", 5e-6),
    "road_grade": _plain("longitudinal acceleration", "chassis.fx", COASTING, STEERING, "slope.grade", 0.05),
    "pneumatic_trail": _plain("lateral acceleration", "chassis.mz", STEERING, BUMPY),
    "wheel_gyroscopics": _plain("yaw rate", "chassis.mx", STEERING, BUMPY),
    "wheel_torque": _plain("longitudinal acceleration", "chassis.my", COASTING, STEERING),
    "tyre_side_compliance": Case(
        how="none", why="The simulated tyre does not give way sideways, so that there is nothing to draw."
    ),
    "lateral_compliance": Case(how="none", why=_ON_LINKAGES),
    "longitudinal_compliance": Case(how="none", why=_ON_LINKAGES),
    **dict.fromkeys(
        ("half_track_table", "half_wheelbase_table", "camber_table", "toe_table"), Case(how="none", why=_ON_LINKAGES)
    ),
    "body": _share("lateral acceleration", "chassis.fy", STEERING, BUMPY),
    "spring": _share("travel", "suspension.fl"),
    "damper": _share("travel rate", "suspension.fl"),
    "offset": _share("travel", "suspension.fl"),
    "outboard_mass": _share("vertical wheel acceleration", "tyre.fl"),
    "tyre_stiffness": _share("tyre deflection", "tyre.fl"),
}  # fmt: skip
"""By family."""

AT_HUB = ("outboard_mass",)
"""Families that are there only where the loads are measured at the hub."""
