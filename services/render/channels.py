"""Sentences about faults of single channels: what was found, what it should be, and what to do."""

from __future__ import annotations

from collections.abc import Mapping

from lacet.daq.channels import COLUMNS
from lacet.identify.validation.channels.exchanged_pairs import ExchangedPair
from lacet.identify.validation.channels.late_instruments import LateInstruments
from lacet.identify.validation.channels.recorded_faults import RecordedFault
from lacet.identify.validation.channels.recorded_values import Copies, StandStill
from lacet.identify.validation.channels.single_faults import ColumnFault, EquationFault, Fault, Suspects
from lacet.identify.validation.channels.sizes import LeansAlike, NegativeDistance, OtherSize, SteersAgainst, TooQuiet
from lacet.identify.validation.channels.unusable_values import NoiseAlone, RangeEnd, SentinelValue, Unusable
from lacet.identify.validation.channels.wrong_places import AboutContact, Misplaced, OtherLengths, WrongPlace
from lacet.identify.validation.exchanged_wheels import Wires
from lacet.services.render.identifiability import listed
from lacet.services.render.intervals import with_interval


def sentence(found: RecordedFault) -> str:
    """A fault that the recorded values of a channel show, in one line."""
    match found:
        case StandStill() | SentinelValue() | RangeEnd() | NoiseAlone():
            return _unusable(found)
        case Copies((first, *others)):
            one = len(others) == 1
            return (
                f"{', '.join(others)} {'is' if one else 'are'} {first} again, sample by sample: "
                f"{'one of them was' if one else 'all but one were'} written from the wrong channel. Export the table "
                "anew, or leave out those that are wrong"
            )
        case TooQuiet(column, variation, noise, others):
            unit = COLUMNS[column][0].unit
            return (
                f"{column} varies by {variation:.2g} {unit} (1 σ), less than its own noise of {noise:.2g} {unit}, "
                f"where others of its kind vary by {others:.2g}: it is dead, or recorded in a larger unit"
            )
        case OtherSize(column, size, others):
            unit = COLUMNS[column][0].unit
            return (
                f"{column} is {size / others:.2g} times as large as others of its kind ({size:.3g} and {others:.3g} "
                f"{unit}): is it in another unit?"
            )
        case NegativeDistance(column, mean):
            return f"{column} is {mean:.3g} m, where a distance is positive: it has the wrong sign"
        case SteersAgainst(column, slope):
            which = f"{column} steers" if column else "one of camera.fl.steer and camera.fr.steer steers"
            return f"{which} against the other front wheel (slope {slope:.2f}): it has the wrong sign; left is positive"
        case LeansAlike((one, other), left, right):
            return (
                f"{one} and {other} are {left:.4f} and {right:.4f} rad: both wheels lean to the same side, where the "
                "two of an axle mirror each other. One has the wrong sign; a left wheel with its top inward is positive"
            )
        case _:
            raise AssertionError(found)


def _unusable(found: Unusable) -> str:
    """Samples that are no measurement, in one line."""
    match found:
        case SentinelValue(column, value, count, first):
            return (
                f"{column} is exactly {value:.6g} in {count} samples, the first at {first:.2f} s, far from all its "
                "other values and without one between: it stands for no value. Those samples are left out"
            )
        case RangeEnd(column, value, highest, times, seconds, first):
            return (
                f"{column} is at its {'highest' if highest else 'lowest'} value {value:.6g} {times} times, over "
                f"{seconds:.2f} s in all, the first at {first:.2f} s: its range is exceeded. Those samples are left out"
            )
        case NoiseAlone(column, value, variation, start, stop):
            unit = COLUMNS[column][0].unit
            return (
                f"{column} has noise alone, {value:.3g} ± {variation:.2g} {unit} (1 σ), from {start:.2f} to {stop:.2f} "
                "s while the same of the other wheels moves on: the instrument or its wire is dead. Those samples are "
                "left out"
            )
        case StandStill(values, start, stop, more, left_out):
            what = f"{start:.2f} to {stop:.2f} s" + (f", and {more} times more," if more else "")
            many = len(values) > 1
            remedy = (
                "Those samples are left out" if left_out
                else f"Leave the channel{'s' if many else ''}, or these seconds, out"
            )  # fmt: skip
            if many:
                each = ", ".join(f"{column} ({value:.6g})" for column, value in values.items())
                return (
                    f"{len(values)} columns stand still together from {what} while others of their kind move: {each}. "
                    f"What reads them, or its wire, was dead. {remedy}"
                )
            ((column, value),) = values.items()
            return (
                f"{column} stands still at {value:.6g} from {what} while others of its kind move: the instrument or "
                f"its wire is dead. {remedy}"
            )


def from_equations(found: EquationFault) -> str:
    """What the car's own equations say of channels, in one line."""
    if isinstance(found, Suspects):
        names = ", ".join(f"{column} ({100.0 * part:.0f} %)" for column, part in found.columns.items())
        return (
            f"{_runs(found.runs)}: the car's equations leave {found.misfit:.0f} times what noise explains, which no "
            "missing effect does. Check these channels first; their scale or delay would explain most of it: "
            f"{names}"
        )
    if isinstance(found, LateInstruments):
        return f"{_runs(found.runs)}: {_late(found)}"
    if isinstance(found, AboutContact):
        return (
            f"{_runs(found.runs)}: the wheels' moments are about the contact of tyre and road, and not about the wheel "
            f"centre ({_misfit(found)}). Take radius × force off: moment.x + R force.y, moment.y - R force.x"
        )
    if isinstance(found, ExchangedPair):
        what = "wheel loads" if found.wires is Wires.LOADS else "travels"
        return (
            f"{_runs(found.runs)}: the {what} of {' and '.join(found.corners)} are exchanged ({_misfit(found)}): "
            "exchange their names in the map or the rig file, or their wires"
        )
    if isinstance(found, OtherLengths):
        return (
            f"{_runs(found.runs)}: {_lengths(found)} ({_misfit(found)}). Measure again, between the middles of the "
            "wheels"
        )
    if isinstance(found, Misplaced):
        return f"{_runs(found.runs)}: {_misplaced(found)}"
    return f"{_runs(found.runs)}: {_fault(found)}"


def _misplaced(found: Misplaced) -> str:
    off = ", ".join(
        f"{with_interval(1e3 * value, 1e3 * found.half[axis], '+')} mm in {axis}" for axis, value in found.off.items()
    )
    said = f"the inertial unit is not where the rig says, but {off} from there ({_misfit(found)})"
    if (other := found.or_lengths) is not None:
        return (
            f"{said}; or {_lengths(other)} ({other.remaining:.3g} without that). These do much the same: measure both"
        )
    if found.remaining**2 - 1.0 > 0.5 * (found.misfit**2 - 1.0):
        return (
            f"{said}. Most of it remains, so that a length may be wrong in its place: check those of the vehicle file "
            "first"
        )
    return f"{said}. Inertias and heights are off with it: measure it again; lacet check estimates it"


def _lengths(found: OtherLengths) -> str:
    return ", ".join(
        f"{length.value} is {with_interval(found.file[length] + off, found.half[length])} m and not "
        f"{found.file[length]:.4g} m as the vehicle file says"
        for length, off in found.off.items()
    )


def _fault(found: ColumnFault) -> str:
    column, value, half = " or ".join((found.column, *found.ties)), found.value, found.half
    misfit = _misfit(found)
    match found.fault:
        case Fault.SIGN:
            needed = with_interval(value, half)
            if found.others:
                each = listed([column, *found.others])
                return f"{each} have the wrong sign: the car's equations need {needed} times the first ({misfit})"
            return f"{column} has the wrong sign: the car's equations need {needed} times it ({misfit})"
        case Fault.UNIT:
            return (
                f"{column} is recorded in {found.unit}: the car's equations need {with_interval(value, half)} times it "
                f"({misfit})"
            )
        case Fault.UNSTEADY:
            first, second = (f"{scale:.2g}" for scale in found.halves)
            return (
                f"{column} has no constant scale: the car's equations need {first} times it in the first half of these "
                f"seconds, and {second} times it in the second ({misfit}). It is dead, or was changed, in a part of "
                "them: leave that part out (--from, --to)"
            )
        case Fault.LATE:
            return (
                f"{column} is {_by(value, half)} than the rig says, other channels of its instrument are not ({misfit})"
            )


def _late(found: LateInstruments) -> str:
    each = [f"{one.name} is {_by(one.delay, one.half)}" for one in found.instruments]
    return (
        f"{listed(each)} than the rig says, in all its columns, beside the other instruments ({_misfit(found)}). "
        "Correct the latency in the rig file, or the log's times: lacet check RUNS --only latency --write-rig FILE"
    )


def _by(delay: float, half: float) -> str:
    return f"{with_interval(1e3 * abs(delay), 1e3 * half)} ms {'later' if delay > 0.0 else 'earlier'}"


def _misfit(found: ColumnFault | WrongPlace | LateInstruments | ExchangedPair) -> str:
    before, after = f"{found.misfit:.3g}", f"{found.remaining:.3g}"
    return f"the car's equations leave {before} times what noise explains, and {after} without that"


def _runs(runs: Mapping[str, tuple[float, float]]) -> str:
    """Runs with the seconds looked at."""
    return ", ".join(f"{name} ({abs(start):.1f} to {stop:.1f} s)" for name, (start, stop) in runs.items())
