"""Failure analysis of a model in sentences and tables."""

from __future__ import annotations

from collections.abc import Mapping

from lacet.identify.car.rows import Row
from lacet.identify.validation.failure_analysis import FailureAnalysis
from lacet.identify.validation.residual_map import InPhase
from lacet.identify.validation.score import fails
from lacet.services.render.tables import Table

TOO_SHORT = "  (runs too short to tell)"


def failure_sentences(found: FailureAnalysis) -> str:
    """Rows, phases and states in which the model fails, in a few sentences."""
    row = found.worst[0]
    ratio = found.ratios.get(row, float("nan"))
    if found.failing:
        count = sum(fails(r) for r in found.ratios.values())
        out = f"{count} of {len(found.ratios)} rows fail; {row} most, {ratio:.1f} times its noise floor"
        when = max(found.in_phase, key=lambda phase: _ratio(found.in_phase[phase], row))
        out += f" ({_ratio(found.in_phase[when], row):.1f} times in the phase '{when}')."
    else:
        out = f"No row fails; {row} is farthest from its noise floor, {ratio:.2f} times."
    strongest = [f for f in found.follows.get(row, []) if f.p <= 0.05]
    if strongest:
        f = strongest[0]
        out += f" Its residual follows {f.state}: {100 * f.part:.0f} % ({f.rms:.3g} {f.row_unit} RMS)."
    rows = [r for r, x in found.explainable.items() if x.something or x.depends_on_history]
    if not found.explainable:
        out += " The runs are too short to say how much is left to explain."
    elif rows:
        total = {r: max(found.explainable[r].part_rms, found.explainable[r].history_rms) for r in rows}
        out += f" Left to explain in {', '.join(f'{r} ({total[r]:.3g} {found.explainable[r].unit})' for r in rows)}."
    else:
        out += " Nothing is left to find that follows the measured states."
    hidden = [r for r in rows if found.explainable[r].depends_on_history]
    if hidden:
        out += f" Something that is not measured moves too: {', '.join(hidden)} depends on history."
    return out


def _ratio(rows: Mapping[Row, InPhase], row: Row) -> float:
    return rows[row].ratio if row in rows else 0.0


def phase_table(found: FailureAnalysis, most: int = 6) -> Table:
    """Residual ÷ floor of the worst rows in each phase."""
    rows = sorted(found.ratios, key=lambda r: -found.ratios[r])
    rows = [*found.worst[:most], *(r for r in rows if r not in found.worst)][:most]
    lines = [
        [
            phase,
            f"{max(x.seconds for x in own.values()):.1f}",
            *(f"{own[r].ratio:.2f}" if r in own else "-" for r in rows),
        ]
        for phase, own in found.in_phase.items()
    ]
    lines.append(["all phases", "", *(f"{found.ratios[r]:.2f}" for r in rows)])
    return Table(["phase", "seconds", *rows], lines)


def follows_table(found: FailureAnalysis, most: int = 3) -> Table:
    """The states that the residual of each of the worst rows depends on."""
    lines = [
        [row if k == 0 else "", f.state, f"{100 * f.part:.0f} %", f"{f.rms:.3g} {f.row_unit}", f"{f.p:.2g}"]
        for row in found.worst
        for k, f in enumerate(found.follows.get(row, [])[:most])
    ]
    return Table(["row", "state", "part", "RMS", "p"], lines, text_columns=2, note="" if lines else TOO_SHORT)


def explainable_table(found: FailureAnalysis) -> Table:
    """Explainable residual, row by row."""
    lines = [
        [
            row, f"{x.rms:.3g}", f"{x.floor:.3g}", x.unit, f"{100 * x.part:.0f} %",
            f"{100 * x.low:.0f} to {100 * x.high:.0f}", f"{x.part_rms:.3g}", f"{x.p_all:.2g}",
            f"{100 * x.history:.0f} %", f"{x.history_p_all:.2g}",
        ]
        for row, x in found.explainable.items()
    ]  # fmt: skip
    head = ["row", "residual", "floor", "", "follows states", "95 %", "RMS", "p", "history", "p"]
    return Table(head, lines, note="" if lines else TOO_SHORT)
