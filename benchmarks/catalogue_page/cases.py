"""For each family: how it is hidden in the simulated car, in which runs, and what its residual is drawn against."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from simulate import Hidden

CAR = RIG = "peugeot-406"
DURATION = 12.0
STEERING = "sinus amplitude=0.04"
BUMPY = "rough grade=C"
KERBS = "kerb"
BRAKING = "braking deceleration=5"
COASTING = "liftoff"


@dataclass(frozen=True)
class Case:
    """How one family's picture is made.

    Attributes
    ----------
    state : what the residual is drawn against: a state of `identify.states`, or one of `residuals.FURTHER`.
    run : the run drawn, a manoeuvre with settings; `beside` : a second run, fitted together with it.
    rows : pattern of rows among which the one that stands out most is drawn.
    hidden : name of the simulator's effect, ``""`` where nothing is hidden; `size` of it [its unit], `shape` constants.
    only_there : whether the second run lacks it.
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
    def option(self) -> str:
        """As `lacet simulate --hide` takes it."""
        constants = "".join(f",{name}={value:g}" for name, value in self.shape.items())
        return f"{self.hidden}={self.size:g}{constants}"


def _suspension(
    hidden: str, size: float, state: str, run: str = BUMPY, beside: str = STEERING, **shape: float
) -> Case:
    return Case(state, run, "suspension.f*", f"{hidden}.front", size, shape, beside)


def _share(state: str, rows: str, run: str = BUMPY, beside: str = STEERING) -> Case:
    return Case(state, run, rows, beside=beside, how="share")


def _plain(state: str, rows: str, run: str, beside: str, hidden: str = "", size: float = 0.0) -> Case:
    return Case(state, run, rows, hidden, size, beside=beside)


CASES: dict[str, Case] = {
    "anti_roll_bar": _suspension("anti_roll_bar", 15e3, "travel difference across the axle", STEERING, BUMPY),
    "coulomb": _suspension("coulomb", 120.0, "travel rate", STEERING, BUMPY, v0=0.01),
    "damper_asymmetry": _suspension("damper_asymmetry", -500.0, "travel rate"),
    "damper_digressive": _suspension("damper_digressive", -2500.0, "travel rate"),
    "damper_saturation": Case(
        "travel rate", BUMPY, "suspension.f*", "damper_saturation.front", 2000.0, {"v0": 0.1}, STEERING, how="law"
    ),
    "damper_hysteresis": _suspension("damper_hysteresis", 200.0, "travel", STEERING, BUMPY, length=0.003),
    "damper_stroke": _suspension("damper_stroke", 3e4, "travel × travel rate"),
    "helper_spring": _suspension("helper_spring", 2e4, "travel", gap=0.005),
    "spring_quadratic": _suspension("spring_quadratic", 4e5, "travel"),
    "spring_cubic": _suspension("spring_cubic", 2e7, "travel"),
    "bump_stop": _suspension("bump_stop", 1e5, "travel", gap=0.015),
    "rebound_stop": _suspension("rebound_stop", 1e5, "travel", gap=0.015),
    "tyre_damping": Case("deflection rate", BUMPY, "tyre.f*", "tyre_damping.front", 200.0, beside=STEERING),
    "tyre_progression": Case("tyre deflection", BUMPY, "tyre.f*", "tyre_progression.front", 2e6, beside=STEERING),
    "aero_drag": Case("speed squared", BRAKING, "chassis.fx", "aero_drag", 0.8, {"height": 0.3}, COASTING),
    "aero_lift": Case("speed squared", BRAKING, "chassis.*", "aero_lift.front", 0.6, beside=BUMPY),
    "aero_side": Case(
        "speed × lateral speed", "sinus amplitude=0.03 speed=38", "chassis.*", "aero_side", 3.0, {"x": -1.2}, BUMPY
    ),
    "chassis_torsion": Case("roll acceleration", KERBS, "chassis.*", "chassis_torsion", 1e5, beside=STEERING),
    "engine_mount": Case("vertical acceleration", BUMPY, "chassis.*", "engine_mount", 250.0, beside=STEERING),
    "payload": Case(
        "vertical acceleration", BUMPY, "chassis.fz", "payload", 100.0, beside=STEERING, only_there=True
    ),
    "anti_dive": Case("longitudinal wheel force", COASTING, "suspension.f*", "anti_dive.front", 0.1, beside=BUMPY),
    "jacking": Case("lateral wheel force", STEERING, "suspension.f*", "jacking.front", 0.08, beside=BUMPY),
    "camber_change": Case("lateral wheel force", STEERING, "suspension.f*", "camber_change.front", 0.3, beside=BUMPY),
    "toe_change": Case("lateral wheel force", STEERING, "suspension.f*", "toe_change.front", 0.8, beside=BUMPY),
    "sensor_crosstalk": Case(
        "longitudinal acceleration", BRAKING, "chassis.fz", "sensor_crosstalk.wheel.force", 0.03,
        {"x": 0.0, "y": 0.0, "zx": 1.0}, BUMPY,
    ),
    "sensor_drift": Case("time", STEERING, "suspension.fl", "sensor_drift.wheel.fl.force.z", 600.0, beside=BUMPY),
    "sensor_gain": Case("travel", BUMPY, "tyre.fl", "sensor_gain.hub.fl", 0.05, beside=STEERING),
    "sensor_latency": Case("deflection rate", BUMPY, "tyre.*", "sensor_latency.laser", 0.004, beside=STEERING),
    "sensor_misalignment": Case(
        "lateral acceleration", STEERING, "chassis.fx", "sensor_misalignment.imu.yaw", 0.03, beside=BRAKING
    ),
    "sensor_position": Case(
        "yaw acceleration", "sinus amplitude=0.03 frequency=1.5", "chassis.*", "sensor_position.imu.x", 0.15,
        beside=BUMPY,
    ),
    "laser_tilt": Case("longitudinal acceleration", BRAKING, "tyre.*", "laser_tilt.pitch", 0.03, beside=BUMPY),
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
    "body": _share("vertical acceleration", "chassis.fz"),
    "spring": _share("travel", "suspension.fl"),
    "damper": _share("travel rate", "suspension.fl"),
    "offset": _share("travel", "suspension.fl"),
    "outboard_mass": _share("vertical wheel acceleration", "tyre.fl"),
    "tyre_stiffness": _share("tyre deflection", "tyre.fl"),
}  # fmt: skip
"""By family."""
