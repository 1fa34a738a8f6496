"""Effects that cannot be missing from a model, because the measured loads or the base model already hold them.

They are listed beside the catalogue so that nobody looks for them; none has columns, parameters or places.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ExcludedEffect:
    """A physical effect that is on the measured side of the equations or in the base model.

    Attributes
    ----------
    name : family name, as an effect of the catalogue has one.
    about : the effect in one line.
    law : its action, in one sentence.
    measured_by : why it cannot be missing: the measurement that holds it, or the body of the model that has it.
    source : publication of the law.
    signature : its pattern in the residual: none, with the reason.
    shown_by : the manoeuvre that excites it: none.
    """

    name: str
    about: str
    law: str
    measured_by: str
    source: str
    signature: str = "none: it is in the measured loads"
    shown_by: str = "no run: nothing is missing"


EXCLUDED: tuple[ExcludedEffect, ...] = (
    ExcludedEffect(
        name="road_grade",
        about="grade and bank of the road",
        law="A road that climbs or leans.",
        measured_by="the inertial unit measures specific force, gravity included, in the axes of the body; the "
        "ground lasers measure the road under the tyres",
        source="Titterton and Weston (2004), Strapdown Inertial Navigation Technology, chapter 3",
        signature="none: it is in the specific force",
    ),
    ExcludedEffect(
        name="rolling_resistance",
        about="rolling resistance of the tyres",
        law="A tyre that resists rolling: a longitudinal force, or a moment about the spin axis, at the contact.",
        measured_by="the dynamometers measure its force and moment (Fx, My): both are on the measured side of every "
        "row",
        source="Gillespie (1992), Fundamentals of Vehicle Dynamics, chapter 4",
    ),
    ExcludedEffect(
        name="steer_compliance",
        about="compliance of the steering and of toe under load",
        law="A carrier that turns under lateral force or braking moment.",
        measured_by="the cameras measure steer and camber of every wheel as they are, compliance included",
        source="Reimpell et al. (2001), The Automotive Chassis, chapters 3 and 4",
        signature="none: it is in the measured steer and camber angles",
    ),
    ExcludedEffect(
        name="camber_thrust",
        about="camber thrust of the tyres",
        law="A lateral force of a tyre that leans.",
        measured_by="the dynamometers measure the lateral force Fy, whatever makes it",
        source="Pacejka (2012), Tire and Vehicle Dynamics, chapter 4",
    ),
    ExcludedEffect(
        name="pneumatic_trail",
        about="pneumatic trail and self-aligning moment of the tyres",
        law="A lateral force that acts behind the wheel centre.",
        measured_by="the dynamometers measure the moment Mz about the wheel centre, whatever makes it",
        source="Pacejka (2012), Tire and Vehicle Dynamics, chapter 3",
    ),
    ExcludedEffect(
        name="tyre_side_compliance",
        about="lateral compliance of the tyres",
        law="A contact patch that moves sideways under load.",
        measured_by="the dynamometers measure the moment Mx about the wheel centre, with the lever as it is",
        source="Pacejka (2012), Tire and Vehicle Dynamics, chapter 4",
    ),
    ExcludedEffect(
        name="wheel_gyroscopics",
        about="gyroscopic moments and spin inertia of the wheels",
        law="Wheels that spin while the car yaws, rolls and steers.",
        measured_by="the wheels are bodies of the tree: their angular momentum is in every row, with the measured "
        "wheel speeds",
        source="Khalil and Dombre (2002), Modeling, Identification and Control of Robots, chapter 9",
        signature="none: it is in the base model",
    ),
    ExcludedEffect(
        name="wheel_torque",
        about="drive and brake torque",
        law="Torques of engine and brakes on the wheels.",
        measured_by="they are internal to the car and in no chassis row; suspension and spin rows take them from "
        "shaft.*.torque and brake.*.torque, or eliminate them, or are left out where that cannot be (lacet "
        "info --rows)",
        source="Gillespie (1992), Fundamentals of Vehicle Dynamics, chapters 2 and 3",
        signature="none: rows they enter are formed only where they are measured or eliminated",
    ),
)
"""All excluded effects, in the order of the catalogue's listing."""
EXCLUDED_NAMES = frozenset(one.name for one in EXCLUDED)
"""Names that no effect of the catalogue may have."""
