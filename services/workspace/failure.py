"""Where a study's model fails: found from its runs, kept as data for people, pictures and JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from lacet.daq.errors import UsageError, nearest
from lacet.daq.formats.result import plain
from lacet.identify.car.manoeuvre_phases import Phases, phases_of
from lacet.identify.progress import Progress, Stage, Step
from lacet.identify.regression.prepared_run import Drive
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.explainable_residual import Left, left_to_explain
from lacet.identify.validation.projected_noise import refitted_draws
from lacet.identify.validation.residual_map import Against, Follows, InPhase, against_states, by_phase, followed_states
from lacet.identify.validation.restoring_force import Surface, restoring_surfaces
from lacet.identify.validation.score import FAILS, Comparison
from lacet.identify.validation.spectra import RowSpectrum, row_spectrum
from lacet.identify.validation.states import ClearStates
from lacet.services.render import tables
from lacet.services.workspace.session import Work
from lacet.services.workspace.study import Version

SHOWN_STATES = 6


@dataclass(frozen=True)
class Where:
    """Where a version of a model fails.

    `parts`, `phases` of all runs asked for, those used first; `worst` rows that fail, farthest from their floor first
    (by `ratios`, over the runs used asked for), or the farthest alone when none does; `in_phase` over `parts`; the
    other findings are from all runs used.
    """

    version: Version
    fitted: Fit
    parts: tuple[Comparison, ...]
    phases: tuple[Phases, ...]
    ratios: Mapping[str, float]
    worst: tuple[str, ...]
    in_phase: Mapping[str, Mapping[str, InPhase]]
    left: Mapping[str, Left]
    follows: Mapping[str, Sequence[Follows]]
    spectra: Mapping[str, RowSpectrum]
    surfaces: Mapping[str, Surface]
    clear: ClearStates

    @property
    def failing(self) -> bool:
        """Whether any row fails."""
        return any(ratio > FAILS for ratio in self.ratios.values())

    def against(self, row: str, every: bool = False) -> dict[str, Against]:
        """A row's residual against the states it follows most, or against every state."""
        names = None if every else [f.state for f in self.follows.get(row, [])][:SHOWN_STATES]
        return against_states(self.fitted.drives, self.fitted.residual, row, names, None if every else self.clear)


def find_where(work: Work, version: Version, progress: Progress | None = None, row: str = "", run: str = "") -> Where:
    """Look where a version fails, in all rows and runs or in those asked for.

    Raises UsageError for a row or run that there is not.
    """
    progress = progress or work.progress
    fitted = work.fitted(version)
    if row and row not in fitted.rows:
        raise UsageError(f"no row {row} in these runs{nearest(row, fitted.rows)}: {', '.join(fitted.rows)}")
    pairs = _pairs(work, version)
    if run:
        names = [part.name for part, _ in pairs]
        if run not in names:
            raise UsageError(f"no run {run} in this study{nearest(run, names)}: {', '.join(names)}")
        pairs = [(part, drive) for part, drive in pairs if part.name == run]
    parts = tuple(part for part, _ in pairs)
    phases = tuple(phases_of(drive.motion) for _, drive in pairs)
    ratios = _ratios(parts, fitted.rows)
    order = sorted(ratios, key=lambda name: -ratios[name])
    worst = tuple(name for name in order if ratios[name] > FAILS) or tuple(order[:1])
    if row:
        worst = (row,)
    floor = work.floor(version, progress)
    progress(Step(Stage.STATES_FOLLOWED))
    clear = ClearStates(fitted.drives)
    draws = refitted_draws(fitted, floor)
    progress(Step(Stage.RESIDUAL_SPECTRA))
    found = {name: row_spectrum(fitted, floor, name, clear) for name in worst}
    follows = followed_states(fitted, floor, worst, clear, draws, progress)
    progress(Step(Stage.EXPLAINABLE_RESIDUAL))
    left = left_to_explain(fitted, floor, clear, draws=draws, progress=progress)
    progress(Step(Stage.RESTORING_FORCES))
    return Where(
        version=version, fitted=fitted, parts=parts, phases=phases, ratios=ratios, worst=worst,
        in_phase=by_phase(parts, phases), left=left, follows=follows,
        spectra={name: s for name, s in found.items() if s is not None}, surfaces=restoring_surfaces(fitted),
        clear=clear,
    )  # fmt: skip


def _pairs(work: Work, version: Version) -> list[tuple[Comparison, Drive]]:
    used = zip(work.comparisons(version, held=False), work.loaded.drives, strict=True)
    return [*used, *zip(work.comparisons(version, held=True), work.held, strict=True)]


def _ratios(parts: Sequence[Comparison], rows: Sequence[str]) -> dict[str, float]:
    """Row → RMS of residual ÷ floor over the runs used, over those held out where no other was asked for."""
    chosen = [part for part in parts if part.used] or list(parts)
    out: dict[str, float] = {}
    for row in rows:
        found = [(part.scores[row].ratio ** 2, part.t[row].size) for part in chosen if row in part.scores]
        if found:
            out[row] = (sum(r * n for r, n in found) / sum(n for _, n in found)) ** 0.5
    return out


def where_result(found: Where) -> dict[str, Any]:
    """As plain data (``docs/json.md``, ``where``)."""
    return plain(
        {
            "version": found.version.number,
            "effects": found.version.effects,
            "fails": found.failing,
            "rows": dict(found.ratios),
            "worst": list(found.worst),
            "phases": {
                part.name: [asdict(interval) for interval in split.intervals]
                for part, split in zip(found.parts, found.phases, strict=True)
            },
            "by_phase": {phase: {r: asdict(x) for r, x in rows.items()} for phase, rows in found.in_phase.items()},
            "follows": {
                row: [
                    {"state": f.state, "unit": f.unit, "part": f.part, "p": f.p, "rms": f.rms, "row_unit": f.row_unit}
                    for f in states
                ]
                for row, states in found.follows.items()
            },
            "against": {
                row: {
                    name: {
                        "unit": a.mean.unit, "put_back": a.put_back, "state": a.mean.centre, "mean": a.mean.mean,
                        "low": a.mean.low, "high": a.mean.high, "count": a.mean.count,
                    }
                    for name, a in found.against(row).items()
                }
                for row in found.worst
            },
            "coherence": {
                row: {
                    "level": s.level, "segments": s.segments,
                    "above": [{"state": n, "squared": c, "frequency": f} for n, c, f in s.strongest],
                }
                for row, s in found.spectra.items()
            },
            "surfaces": {
                corner: {
                    "travel": s.travel, "rate": s.rate, "residual": s.residual, "force": s.force, "count": s.count,
                    "blocks": s.blocks, "scatter": s.scatter,
                }
                for corner, s in found.surfaces.items()
            },
            "left": {
                row: {**asdict(x), "something": x.something, "depends_on_history": x.depends_on_history, "says": x.says}
                for row, x in found.left.items()
            },
        }
    )  # fmt: skip


def says(found: Where) -> str:
    """The finding in a few plain sentences."""
    row = found.worst[0]
    ratio = found.ratios.get(row, float("nan"))
    if found.failing:
        count = sum(r > FAILS for r in found.ratios.values())
        out = f"{count} of {len(found.ratios)} rows fail; {row} most, {ratio:.1f} times its noise floor"
        when = max(found.in_phase, key=lambda phase: _ratio(found.in_phase[phase], row))
        out += f" ({_ratio(found.in_phase[when], row):.1f} times in the phase '{when}')."
    else:
        out = f"No row fails; {row} is farthest from its noise floor, {ratio:.2f} times."
    strongest = [f for f in found.follows.get(row, []) if f.p <= 0.05]
    if strongest:
        f = strongest[0]
        out += f" Its residual follows {f.state}: {100 * f.part:.0f} % ({f.rms:.3g} {f.row_unit} RMS)."
    rows = [r for r, x in found.left.items() if x.something or x.depends_on_history]
    if not found.left:
        out += " The runs are too short to say how much is left to explain."
    elif rows:
        total = {r: max(found.left[r].part_rms, found.left[r].history_rms) for r in rows}
        out += f" Left to explain in {', '.join(f'{r} ({total[r]:.3g} {found.left[r].unit})' for r in rows)}."
    else:
        out += " Nothing is left to find that follows the measured states."
    hidden = [r for r in rows if found.left[r].depends_on_history]
    if hidden:
        out += f" Something that is not measured moves too: {', '.join(hidden)} depends on history."
    return out


def _ratio(rows: Mapping[str, InPhase], row: str) -> float:
    return rows[row].ratio if row in rows else 0.0


def phase_table(found: Where, most: int = 6) -> str:
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
    return tables.table(["phase", "seconds", *rows], lines)


def follows_table(found: Where, most: int = 3) -> str:
    """The states that each of the worst rows follows."""
    lines = [
        [row if k == 0 else "", f.state, f"{100 * f.part:.0f} %", f"{f.rms:.3g} {f.row_unit}", f"{f.p:.2g}"]
        for row in found.worst
        for k, f in enumerate(found.follows.get(row, [])[:most])
    ]
    return tables.table(["row", "state", "part", "RMS", "p"], lines, left=2) if lines else "  (runs too short to tell)"


def left_table(found: Where) -> str:
    """How much is left to explain, row by row."""
    lines = [
        [
            row, f"{x.rms:.3g}", f"{x.floor:.3g}", x.unit, f"{100 * x.part:.0f} %",
            f"{100 * x.low:.0f} to {100 * x.high:.0f}", f"{x.part_rms:.3g}", f"{x.p_all:.2g}",
            f"{100 * x.history:.0f} %", f"{x.history_p_all:.2g}",
        ]
        for row, x in found.left.items()
    ]  # fmt: skip
    head = ["row", "residual", "floor", "", "follows states", "95 %", "RMS", "p", "history", "p"]
    return tables.table(head, lines) if lines else "  (runs too short to tell)"
