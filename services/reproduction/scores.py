"""Scores of the reproduced fits: estimates compared with true values, line by line beside the paper's own numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lacet.daq.channels import CORNERS
from lacet.services.render.intervals import half_width, to_interval, with_interval
from lacet.services.render.tables import table
from lacet.services.reproduction.published_tables import SPIN_ROWS, TITLES, Line
from lacet.services.reproduction.second_car_truth import second_car_values

MET, MISSED, WITHOUT = "met", "missed", "not identifiable"


@dataclass(frozen=True)
class Scored:
    """One line of a table with lacet's estimate, in the unit and axes of the paper.

    `truth` : value of the simulated car; `estimate`, `half95` : lacet's, None where it is not identifiable; `allowed` :
    the larger of the paper's own error and lacet's half-width; `remark` : the reason when the `verdict` is not `MET`.
    """

    line: Line
    truth: float
    estimate: float | None
    half95: float | None
    allowed: float | None
    verdict: str
    remark: str

    @property
    def within(self) -> bool | None:
        """Whether the truth is in lacet's interval, whatever the paper's error; None where it is not identifiable."""
        return None if self.error is None or self.half95 is None else abs(self.error) <= self.half95

    @property
    def error(self) -> float | None:
        """Error of lacet's estimate [unit]."""
        return None if self.estimate is None else self.estimate - self.truth

    def result(self) -> dict[str, Any]:
        """The line as plain data (``docs/json.md``, ``paper``)."""
        line = self.line
        return {
            "table": line.table,
            "parameter": line.name,
            "key": line.key,
            "unit": line.unit,
            "truth": self.truth,
            "paper": {"apriori": line.apriori, "estimated": line.estimated, "error": line.error, "sxr": line.sxr},
            "estimate": self.estimate,
            "half95": self.half95,
            "error": self.error,
            "allowed": self.allowed,
            "verdict": self.verdict,
            "within": self.within,
            "remark": self.remark,
        }


def score(line: Line, truth: Mapping[str, Any], fit: Mapping[str, Any], simulation: bool) -> Scored:
    """The score of a line, from a run of a truth file and a fit's result.

    In the paper's simulation the error may be as large as the paper's own; in the experiment, whose true values were
    unknown, lacet's interval alone counts. Spin inertia must come from the wheel's own row, as in the paper.
    """
    real = line.scale * true_value(line.key, truth)
    found = _found(line.key, fit)
    why = _left_out(SPIN_ROWS.get(line.key, ""), fit)
    if why or found is None:
        why = why or _why(line.key, fit)
        if found is not None:
            value, half = found
            why += f"; from the chassis rows alone {with_interval(value, half)} {line.unit}"
        return Scored(line, real, None, None, None, WITHOUT, why)
    estimate, half = line.scale * found[0], abs(line.scale) * found[1]
    allowed = max(half, _papers_error(line, real)) if simulation else half
    error = abs(estimate - real)
    verdict = MET if error <= allowed else MISSED
    remark = f"{error / half:.1f} times our half-width" if verdict == MISSED else ""
    return Scored(line, real, estimate, half, allowed, verdict, remark)


def _papers_error(line: Line, truth: float) -> float:
    """The paper's own error [unit], of a value other than its own in proportion; 0 where it printed none."""
    if line.error is None:
        return 0.0
    return abs(line.error * truth / line.apriori) if line.apriori else abs(line.error)


def true_value(key: str, truth: Mapping[str, Any]) -> float:
    """True value by lacet's name, SI and body axes, from a run of a truth file. Raises KeyError."""
    if "design" in truth:
        return second_car_values(truth)[key]
    car = truth["car"]
    whole = car["whole"]
    tensor = whole["tensor"]
    values = {"mass": whole["mass"], **dict(zip(("cog.x", "cog.y", "cog.z"), whole["com"], strict=True))}
    for i, a in enumerate("xyz"):
        for j, b in enumerate("xyz"):
            values[f"I{a}{b}"] = tensor[i][j]
    for corner in CORNERS:
        own = car["corners"].get(corner) or car["front" if corner[0] == "f" else "rear"]
        spin = next(name for name, row in SPIN_ROWS.items() if row == f"spin.{corner}")
        values |= {
            f"spring.{corner}.k": own["stiffness"],
            f"damper.{corner}.c": own["damping"],
            f"offset.{corner}.f0": car["suspension_offsets"][corner],
            f"tyre_stiffness.{corner}.kt": own["tyre_stiffness"],
            spin: own["inboard_spin"] + own["outboard_spin"],
        }
    for effect in truth["hidden"]:
        kind, _, _ = str(effect["name"]).partition(".")
        parameter = "f" if kind == "coulomb" else "k"
        values[f"{effect['name']}.{parameter}"] = effect["size"]
    return float(values[key])


def _found(key: str, fit: Mapping[str, Any]) -> tuple[float, float] | None:
    for item in fit["whole_vehicle"] or ():
        if item["name"] == key and item["identifiable"]:
            return item["value"], item["half95"]
    for item in fit["parameters"]:
        if item["name"] == key and item["group"] == key:
            return item["value"], item["half95"]
    return None


def _why(key: str, fit: Mapping[str, Any]) -> str:
    for item in fit["not_identifiable"]:
        if item["name"] == key:
            return item["why"]
    for item in fit["parameters"]:
        if item["name"] == key:
            return f"only together with others: {item['group']}"
    return "these runs do not determine it"


def _left_out(row: str, fit: Mapping[str, Any]) -> str:
    """Why no run has a row; empty where one has it."""
    reasons = {run: why for run, why in fit["rows_left_out"].items() if run.endswith(f": {row}")} if row else {}
    return next(iter(reasons.values())) if reasons and len(reasons) == len(fit["rows"]["used"]) else ""


def print_tables(lines: Sequence[Scored], simulation: bool, own_car: bool = False) -> str:
    """The tables of lacet's estimates beside the paper's, as text; of another car beside the paper's errors alone."""
    parts: list[str] = []
    for which in sorted({s.line.table for s in lines}):
        rows = [(_cells_of_other_car if own_car else _cells)(s, simulation) for s in lines if s.line.table == which]
        if own_car:
            head = [
                "parameter",
                "unit",
                "truth",
                "paper's error",
                "sxr %",
                "lacet",
                "error",
                "95 %",
                "verdict",
                "in 95 %",
            ]
        elif simulation:
            head = ["parameter", "unit", "a priori", "paper", "error", "sxr %", "lacet", "error", "95 %", "verdict"]
        else:
            head = ["parameter", "unit", "paper = truth", "sxr %", "lacet", "error", "95 %", "verdict"]
        text = f"Table {which}: {TITLES[which]}\n{table(head, rows, text_columns=2)}"
        notes: dict[str, list[str]] = {}
        for s in (s for s in lines if s.line.table == which):
            for note in filter(None, ("" if own_car else s.line.note, s.remark)):
                notes.setdefault(note, []).append(s.line.name)
        parts.append("\n".join([text, *(f"  {', '.join(names)}: {note}" for note, names in notes.items())]))
    return "\n\n".join(parts)


def _cells(s: Scored, simulation: bool) -> list[str]:
    line = s.line
    ours = ["-", "-", "-"]
    if s.estimate is not None and s.half95 is not None:
        ours = [to_interval(s.estimate, s.half95), _error(s.error, s.truth), f"± {half_width(s.half95)}"]
    sxr = "-" if line.sxr is None else f"{line.sxr:g}"
    truth = f"{s.truth + 0.0:.7g}"
    if not simulation:
        return [line.name, line.unit, truth, sxr, *ours, s.verdict]
    paper = "-" if line.estimated is None else f"{line.estimated:g}" if line.offset else f"{line.estimated:.8g}"
    return [line.name, line.unit, truth, paper, _error(line.error, line.apriori), sxr, *ours, s.verdict]


def _cells_of_other_car(s: Scored, simulation: bool) -> list[str]:
    """Cells of a line of another car: its truth, the paper's error in the simulation, and both rules."""
    name, unit, *_, sxr, estimate, error, half, verdict = _cells(s, simulation)
    paper = _error(s.line.error, s.line.apriori) if simulation else "-"
    within = "-" if s.within is None else "yes" if s.within else "no"
    return [name, unit, f"{s.truth + 0.0:.7g}", paper, sxr, estimate, error, half, verdict, within]


def _error(error: float | None, truth: float | None) -> str:
    """Error in % of the true value, or in its unit where that is zero."""
    if error is None:
        return "-"
    return f"{100 * error / abs(truth):+.3f} %" if truth else f"{error:+.3g}"
