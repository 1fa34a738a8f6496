"""Sentences of the plausibility checks of a run."""

from __future__ import annotations

from lacet.daq.channels import CHANNELS
from lacet.identify.validation.clocks import ClockDifference
from lacet.identify.validation.exchanged_wheels import ExchangedWires, Wires
from lacet.identify.validation.plausibility import Doubt, Symptom


def sentence(doubt: Doubt) -> str:
    """An implausible channel (unit, sign or axes) and its likely cause, in one line."""
    value, other = doubt.value, doubt.other
    names = ", ".join(doubt.subject)
    match doubt.symptom:
        case Symptom.GRAVITY_SIZE:
            return f"imu.accel is {value:.3g} m/s², where gravity alone is 9.81{_unit(doubt)}"
        case Symptom.GRAVITY_DIRECTION:
            return (
                f"imu.accel is {value:.3g} m/s² upwards, where gravity is +9.81: check its signs and axes, and "
                "the sensor's orientation in the rig"
            )
        case Symptom.WEIGHT_SIGN:
            return f"the wheel forces' z add up to {value:.3g} N: they are positive when the wheels carry the car"
        case Symptom.WEIGHT_SIZE:
            return f"the wheel forces' z add up to {value:.3g} N, a car of {other:.2g} kg: are they in {doubt.guess}?"
        case Symptom.WHEEL_LOAD_SIGN:
            return f"{names} mostly pulls at the road: z is positive when a wheel carries the car"
        case Symptom.DISTANCE_SIZE | Symptom.ANGLE_SIZE:
            unit = "m" if doubt.symptom is Symptom.DISTANCE_SIZE else "rad"
            verb = "is" if len(doubt.subject) == 1 else "are"
            return f"{names} {verb} up to {value:.3g} {unit}: in {doubt.guess}?"
        case Symptom.SPEED_SIZE:
            return f"{_speed(doubt)} is {value:.3g} m/s where the wheels roll at {other:.3g}{_unit(doubt)}"
        case Symptom.WHEEL_SPEED_SIZE:
            sign = ": one of the two has the wrong sign" if value * other < 0.0 else ""
            why = _unit(doubt) or sign
            return f"{names} times the tyre's radius: {value:.3g} m/s where {_speed(doubt)} is {other:.3g}{why}"
        case Symptom.ATTITUDE_SIGN:
            angle, axis = doubt.subject
            axes = ", in body axes" if doubt.in_body_axes else ""
            return f"imu.attitude {angle} turns against imu.rate {axis}{axes}: one of them has the wrong sign"
        case Symptom.ATTITUDE_EXCHANGED:
            return "imu.attitude roll turns as imu.rate y says, and pitch as imu.rate x: roll and pitch are exchanged"
        case Symptom.ATTITUDE_SIZE:
            angle, axis = doubt.subject
            return f"imu.attitude {angle} turns {value:.3g} times as fast as imu.rate {axis} says{_unit(doubt)}"
        case _:
            return _compared(doubt)


def of_clocks(one: ClockDifference) -> str:
    """A difference of clocks, and what to do about it."""
    late, other, alike = f"the stamps of the {one.late}", f"those of the {one.other}", f"correlation {one.alike:.2f}"
    rest = "and look at the rest with 'lacet check --only latency'"
    if one.jump is not None:
        since, lag = one.jump
        return (
            f"from {since:.0f} s on {late} are {lag:.2f} s later than {other}, and before by {one.lag:.2f} s ({alike} "
            "so): a log lost samples there, or a clock jumped. Cut the log there, and import the parts as runs of "
            "their own"
        )
    if one.drift:
        return (
            f"{late} get later than {other} by {1e3 * one.drift:.1f} ms each second, from {one.lag:.2f} s at the run's "
            f"beginning ({alike} so): one of their clocks runs fast or slow. Give the names of its log a drift in the "
            f"map, {rest}"
        )
    return (
        f"{late} are about {one.lag:.2f} s later than {other} ({alike} at that lag; in a periodic manoeuvre it may be "
        "whole periods more): their clocks differ. Give the one that is late a delay in the map, or a latency in the "
        f"rig, {rest}"
    )


def _speed(doubt: Doubt) -> str:
    """The road speed as it is named: of a sensor of two axes the one forwards."""
    return f"{doubt.speed} x" if CHANNELS[doubt.speed].width > 1 else doubt.speed


def _compared(doubt: Doubt) -> str:
    """Sentences of one channel compared with another."""
    match doubt.symptom:
        case Symptom.SPEED_SIDE_SIGN:
            return (
                "correvit.speed y has the sign opposite to what acceleration, yaw rate and attitude leave for it: to "
                "the left it is positive"
            )
        case Symptom.HUB_LOADS:
            return (
                f"all wheel loads lack a mass of {doubt.value:.3g} kg in their wheel's own acceleration: they are the "
                "hub's, inside rim and tyre, and not the contact's (wheel_reference = \"hub\")"
            )
        case Symptom.CONTACT_LOADS:
            return (
                f"no wheel load lacks a mass in its wheel's own acceleration ({doubt.value:.1f} kg): they are the "
                "contact's, and not the hub's (wheel_reference = \"contact\")"
            )
        case Symptom.CORNERING_SIGN:
            return (
                "imu.accel y has the sign opposite to imu.rate z times the speed: in a left turn both are positive. "
                "Check signs and axes, and the sensors' orientation in the rig"
            )
        case Symptom.CORNERING_SIZE:
            return (
                f"imu.accel y is {doubt.value:.3g} times imu.rate z times the speed, which should be alike"
                f"{_unit(doubt)}"
            )
        case Symptom.FORCE_SIGN:
            (axis,) = doubt.subject
            return (
                f"the wheel forces' {axis} have the sign opposite to imu.accel {axis}: they should be mass times "
                "acceleration"
            )
        case Symptom.INERTIAL_UNIT_TURNED:
            return (
                "the wheel forces' x and y go with imu.accel y and x: is the inertial unit turned by 90°? Check its "
                "orientation in the rig"
            )
        case Symptom.LEANING:
            (axle,) = doubt.subject
            return (
                f"the body leans into the turn at the {axle} axle: its travels look exchanged, left and right, or "
                "imu.accel y has the wrong sign"
            )
        case Symptom.TRAVEL_SIGN:
            return (
                "the suspension travels have the sign opposite to imu.rate x and y: compression is positive, and so "
                "are the rates with the right side and the nose down"
            )
        case Symptom.TRAVEL_SIZE:
            where = " and ".join(doubt.subject)
            return (
                f"the body rolls {doubt.value:.2g} times as far (imu.rate x) as the suspension travels say ({where}): "
                "their unit or scale"
            )
        case Symptom.ROLL_RATE_SIGN | Symptom.PITCH_RATE_SIGN:
            return _tilting(doubt)
        case Symptom.STEER_SIGN:
            steer = ", ".join(doubt.subject) or "camera steer"
            return f"{steer} has the sign opposite to imu.rate z: both are positive to the left"
        case Symptom.STEER_SIZE:
            return f"the car turns {doubt.value:.2g} times as fast as its camera steer says: is steer in {doubt.guess}?"
        case _:
            raise AssertionError(doubt.symptom)


def of_wires(found: ExchangedWires) -> str:
    """Sentence of wheels whose loads follow other wheels' tyres: what is exchanged, and the remedy."""
    pairs = ", ".join(f"the loads of {wheel} follow the tyre at {corner}" for wheel, corner in found.followed.items())
    mend = "Mend the wires or the order of 'corners' in the rig's {} sensor, and decode the raw log again"
    match found.wires:
        case Wires.LOADS:
            return f"wheels look exchanged ({pairs}). Their loads are left out. {mend.format('wheel')}"
        case Wires.DISTANCES:
            return (
                f"lasers or travels of wheels look exchanged ({pairs}, and the loads move the body as they should). "
                f"They are left out. {mend.format('laser or travel')}"
            )
        case _:
            return (
                f"wheels look exchanged ({pairs}): their loads, or their lasers or travels. The loads are left out. "
                f"{mend.format('load, or laser,')}"
            )


def _tilting(doubt: Doubt) -> str:
    """A rate against the travels, everywhere or at some axles or sides."""
    rolls = doubt.symptom is Symptom.ROLL_RATE_SIGN
    axis, ends = ("x", "left and right") if rolls else ("y", "front and rear")
    against = f"imu.rate {axis} has the sign opposite to the suspension travels' difference of {ends}"
    if not doubt.subject:
        return f"{against}: the rate or the travels have the wrong sign, or those of {ends} are exchanged"
    where = " and ".join(f"at the {place} axle" if rolls else f"on the {place}" for place in doubt.subject)
    return f"{against} {where} alone: the two travels look exchanged, or have the wrong sign"


def _unit(doubt: Doubt) -> str:
    """The unit that would explain it, as a question."""
    what = "the rate" if doubt.guess == "°/s" and doubt.symptom is not Symptom.WHEEL_SPEED_SIZE else "it"
    or_rate = (
        ", or the rate in rad/s as if in °/s"
        if doubt.guess == "degrees" and doubt.symptom is Symptom.ATTITUDE_SIZE
        else ""
    )
    return f": is {what} in {doubt.guess}{or_rate}?" if doubt.guess else ""
