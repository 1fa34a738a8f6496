"""Rows of the equations in words: names, level of colour, reason of absence, notes of reading, residuals."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any

from lacet.identify.car.motion import BrakingLeftOut, FlatRoad, GroundLaserOffset
from lacet.identify.car.rows import ROWS, Absence, Row, RowAbsence
from lacet.identify.car.sources.completion import SteeringAngleUnused
from lacet.identify.signals.reconstruct import FewSamples, FewUsableSamples, Gaps, RunNote
from lacet.identify.validation.explainable_residual import ExplainableResidual
from lacet.identify.validation.score import FAILS, RowScore, fails, row_errors, row_ratios
from lacet.identify.validation.whiteness import Colour

_MOST_INTERVALS = 3
LEVELS = (FAILS, 1.6, 2.5, 6.0)
"""Residual ÷ floor above which a row is drawn at the next of five levels of colour."""

_KINDS = {"suspension": ("Susp", "suspension"), "tyre": ("Tyre", "tyre"), "spin": ("Spin", "wheel spin"),
          "corner": ("Corner", "suspension less tyre")}  # fmt: skip
CORNER_WORDS = {"fl": "front left", "fr": "front right", "rl": "rear left", "rr": "rear right"}
"""The corners in words."""
_CHASSIS = {
    "fx": "longitudinal force", "fy": "lateral force", "fz": "vertical force", "mx": "roll moment",
    "my": "pitch moment", "mz": "yaw moment",
}  # fmt: skip


def row_absence(why: RowAbsence) -> str:
    """Why a row cannot be formed."""
    first, *others = why.channels
    declared = f"the run's brakes are '{why.brakes}' (say brakes = 'off' where they were not touched)"
    match why.cause:
        case Absence.CHANNELS:
            beside = f"; and {row_absence(why.beside)}" if why.beside else ""
            return f"not measured: {', '.join(why.channels)}{beside}"
        case Absence.SHAFT_TORQUE:
            return (
                f"the half-shaft torque acts on this travel (the bench table turns the carrier) and neither it "
                f"({first}) nor the brake torque ({others[0]}) nor when the brakes act ({others[1]}) is measured; "
                f"{declared}"
            )
        case Absence.DRIVE_TORQUE:
            return f"the drive torque of this wheel is not measured ({first})"
        case Absence.BRAKE_TORQUE:
            return (
                f"neither the brake torque of this wheel ({first}) nor when the brakes act ({others[0]}) is measured; "
                f"{declared}"
            )
        case Absence.MEASURED_ELSEWHERE:
            return f"another run measures it; here {', '.join(why.channels)} would be assumed"
        case Absence.NO_KNOWN_LOAD:
            return (
                "without wheel loads every parameter is known up to one common factor: "
                f"give one of {', '.join(why.channels)} in [assumed] of the vehicle file, with its tolerance"
            )
        case Absence.BRAKES_ALWAYS:
            return f"the brakes act all the time ({first}) and the torques on this wheel are not all measured"


def run_notes(notes: Iterable[RunNote]) -> list[str]:
    """Notes on how a run was read, one line each; channels with the same gaps share a line."""
    notes = list(notes)
    alike: dict[str, list[str]] = {}
    for note in notes:
        if isinstance(note, Gaps):
            alike.setdefault(_intervals(note.intervals), []).append(note.channel)
    out: list[str] = []
    for note in notes:
        if not isinstance(note, Gaps):
            out.append(_run_note(note))
        elif names := alike.pop(_intervals(note.intervals), None):
            out.append(f"left out {_intervals(note.intervals)}: no usable samples of {', '.join(names)}")
    return out


def said_of_runs(result: Mapping[str, Any]) -> list[str]:
    """What a user reads of the runs of a fit's result, one line each, faults first."""
    return [*result.get("warnings", []), *result.get("notes", [])]


def colour_words(score: RowScore) -> str:
    """Comparison of a row's residual with the noise floor, in words; an empty string where it was not compared."""
    match score.colour:
        case None:
            return ""
        case Colour.LIKE_NOISE:
            return "like noise"
        case Colour.LOUDER:
            return "louder than noise"
        case Colour.COLOURED:
            return f"coloured: {score.peak:.2g} Hz"
        case Colour.TOO_SHORT:
            return "too short to tell"


def explainable(found: ExplainableResidual) -> str:
    """The part of a row's residual that smooth functions of the measured states explain."""
    if not found.something and not found.depends_on_history:
        what = "nothing left to find that follows the measured states"
        return (
            f"{what}; the residual has more noise than the sensor sheet states"
            if found.rms > FAILS * found.floor
            else what
        )
    out = (
        f"{100 * found.part:.0f} % of the residual ({found.part_rms:.3g} {found.unit} RMS) follows the measured states"
        if found.something
        else "the residual does not follow the present states"
    )
    if found.depends_on_history:
        out += f"; {100 * found.history:.0f} % ({found.history_rms:.3g} {found.unit}) depends on their history"
    return out


def _run_note(note: RunNote) -> str:
    match note:
        case FewSamples(channel, samples):
            return f"{channel} has only {samples} samples and was left out"
        case FewUsableSamples(channel, least):
            return f"{channel} has fewer than {least} usable samples and was left out"
        case FlatRoad():
            return "fewer than three ground lasers: a flat road and the attitude give the road's normal"
        case SteeringAngleUnused():
            return (
                "steering.angle is recorded and not used, as its ratio to the front wheels' steer is not known: give "
                "steering_ratio in [assumed] of the vehicle file, or the table [steering]. Yaw rate, speed and slip "
                "angles stand in for it"
            )
        case GroundLaserOffset(ahead):
            return (
                f"a ground laser stands {1e3 * abs(ahead):.0f} mm {'ahead of' if ahead > 0 else 'behind'} its wheel's "
                "centre: on a rough road it sees bumps earlier or later than the tyre, and tyre rows fail as if tyres "
                "had damping. Mount lasers above the wheels, or identify from smooth roads"
            )
        case BrakingLeftOut(seconds, rows, channel, pressure):
            return (
                f"left out {seconds:.1f} s of {', '.join(rows)}: the brakes act ({channel} above {pressure / 1e5:g} "
                "bar) and the torques on these wheels are not all measured"
            )
        case _:
            raise TypeError(f"a note without words: {note!r}")


def _intervals(holes: tuple[tuple[float, float], ...]) -> str:
    """Gaps with their times, the first few."""
    some = ", ".join(f"{start:.2f} to {stop:.2f} s" for start, stop in holes[:_MOST_INTERVALS])
    more = len(holes) - _MOST_INTERVALS
    return some + (f" and {more} more intervals" if more > 0 else "")


def row_label(row: Row) -> dict[str, str]:
    """Names of a row on the page: `label` for a small field, `about` in words, `unit`."""
    if row.kind == "chassis":
        return {"label": row.place.capitalize(), "about": f"chassis, {_CHASSIS[row.place]}", "unit": row.unit}
    if row.kind == "body":
        return {"label": row.place.capitalize(), "about": f"body, {row.place}", "unit": row.unit}
    label, about = _KINDS[row.kind]
    return {"label": label, "about": f"{about}, {CORNER_WORDS[row.place]}", "unit": row.unit}


ERROR_MEANINGS = {
    "error": "Error ÷ floor of a row: √(Σ (measured − modelled)² ÷ Σ floor²), both sums over the samples of all runs "
    "used. The floor is the RMS that the sensors' noise alone would leave. 1 is the floor.",
    "worst": "Worst run: the largest RMS of measured − modelled ÷ floor of the row in any run, used or held out.",
    "pooled": "Error ÷ floor of a model: root mean square, over the rows, of their error ÷ floor. 1 is the floor.",
}
"""What the numbers of the page are, with their formulas."""
NOISE_ALONE = 2.0
"""RMS variation of a measured row ÷ its noise floor below which its variance explained says nothing: most of the
variance is noise, which no model explains."""


def error_summary(used: Mapping[str, Mapping[str, Any]], held: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Each row's error for the page: over all runs used (over those held out where none has it), and in its worst run.

    `fails` : whether it fails in any run that is judged; `level` and `worst_level` of colour, 0 to 4.
    """
    every = {**used, **held}
    over = row_errors(held) | row_errors(used)
    judged = {
        run: {row: score for row, score in scores.items() if score.get("judged", True)} for run, scores in every.items()
    }
    single = row_errors(judged)
    out: list[dict[str, Any]] = []
    for row, error in over.items():
        worst = single.get(row, error)
        unit = next(scores[row]["unit"] for scores in every.values() if row in scores)
        out.append(
            {
                "row": row, "unit": unit, "rms": error.rms, "floor": error.floor, "ratio": error.ratio,
                "level": _level(error.ratio), "worst_run": worst.worst_run, "worst": worst.worst,
                "worst_level": _level(worst.worst), "fails": fails(worst.worst),
            }
        )  # fmt: skip
    return sorted(out, key=lambda one: ROWS.index(Row.parse(one["row"])))


def failing_in_one_run(runs: Mapping[str, Mapping[str, Any]], explained: Collection[str]) -> str:
    """The row farthest above its floor in a single run, where it fails there and not over all runs; else empty.

    `runs` : run → row → its score, as stored; `explained` : rows of which something is said elsewhere.
    """
    over_all = row_ratios(runs)
    found = [
        (score["ratio"], run, row, score.get("colour", "no colour"))
        for run, scores in runs.items()
        for row, score in scores.items()
        if fails(score["ratio"]) and score.get("judged", True) and not fails(over_all[row]) and row not in explained
    ]
    if len(runs) < 2 or not found:
        return ""
    ratio, run, row, colour = max(found)
    return (
        f"in {run} alone {row} is at {ratio:.2f} of its floor ({colour}), over all runs at {over_all[row]:.2f}: too "
        "little for its cause to be found here; lacet compare draws it"
    )


def with_verdict(score: Mapping[str, Any]) -> dict[str, Any]:
    """A row's score with its verdict for the page: whether the row `fails`, and its `level` of colour, 0 to 4.

    `noise_alone` : whether what is measured is hardly more than noise.
    """
    ratio = float(score["ratio"])
    return {
        **score,
        "fails": fails(ratio) and bool(score.get("judged", True)),
        "level": _level(ratio),
        "noise_alone": score["rms"] ** 2 < (NOISE_ALONE * score["floor"]) ** 2 * (1.0 - score["vaf"] / 100.0),
    }


def ratio_text(ratio: float) -> str:
    """Error ÷ noise floor as the page shows it: two decimals below 10, one below 100."""
    return f"{ratio:.{2 if ratio < 9.995 else 1 if ratio < 99.95 else 0}f}"


def _level(ratio: float) -> int:
    return sum(ratio > limit for limit in LEVELS)
