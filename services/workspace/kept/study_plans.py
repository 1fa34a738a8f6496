"""Plans of the jobs on a study: the stages between what is kept and what is wanted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from lacet.identify.progress import Stage
from lacet.identify.validation.noise_floor import DEFAULT_DRAWS
from lacet.identify.validation.score import fails, worst_row
from lacet.services.progress import AnyStage, ServiceStage, Stretch
from lacet.services.timing.usual import PLANNED_RUNS, stretch
from lacet.services.workspace.kept.kept_values import KeptValues
from lacet.services.workspace.study import Version

Wanted = tuple[str, Version]
"""A kind of value (`KeptValues.has`) of a version, a drawing of a report, or the next run."""

SELDOM = 0.5
"""Part of its usual time that a stage counts for which only a ranking with a finding goes through."""
EXPECTED_EFFECTS = 1
"""Number of effects that a search is expected to add before its first ranking is there."""


class StudyPlan:
    """The stretches of a job on a study, in the order of its work; what is kept, or named twice, takes no time."""

    def __init__(self, values: KeptValues):
        self._values, self._study = values, values.runs.study
        self.stretches: list[Stretch] = []
        self._used, self._held = len(self._study.used), len(self._study.held)
        self._read = dict(zip((False, True), values.runs.present, strict=True))
        self._known: set[tuple[str, int, bool]] = set()

    def want(self, wanted: Sequence[Wanted]) -> StudyPlan:
        """The same plan with what these values need."""
        for kind, version in wanted:
            self._one(kind, version)
        return self

    def search(self, version: Version, effects: int) -> StudyPlan:
        """The same plan with a ranking of a version, and so many effects added, each with a ranking after it."""
        self._one("ranking", version)
        for k in range(effects):
            # Numbers below zero: versions that nothing is known of.
            later = Version(-1 - k, {}, "")
            self._one("result", later)
            self._one("ranking", later)
        return self

    @property
    def further(self) -> Mapping[AnyStage, tuple[Stretch, ...]]:
        """Stretches ahead when a ranking comes to a stage that only some rankings have, or have several times."""
        return {stage: tuple(stretch(one, self._used) for one in (stage, *after)) for stage, after in _FURTHER.items()}

    def _one(self, kind: str, version: Version) -> None:
        match kind:
            case "fit":
                self._fit(version)
            case "result":
                self._fit(version)
                self._compared(version)
            case "compared":
                self._compared(version)
            case "forces":
                self._compared(version)
                if self._held and self._missing(kind, version, held=True):
                    self._fit(version)
                    self._runs(held=True)
                    self._add(ServiceStage.WHEEL_FORCES, self._held)
            case "shares":
                for held in (False, True):
                    if self._missing(kind, version, held):
                        self._runs(held)
                        self._fit(version)
                        self._add(ServiceStage.CONTRIBUTIONS, self._number(held))
            case "phases":
                for held in (False, True):
                    if self._missing(kind, version, held):
                        self._runs(held)
                        self._add(ServiceStage.MANOEUVRE_PHASES, self._number(held))
            case "dampers":
                if self._missing(kind, version):
                    self._fit(version)
            case "pictures":
                self._one("forces", version)
                if self._missing(kind, version):
                    self._compared(version)
                    self._fit(version)
                    self._add(ServiceStage.DRAWING_RUN, self._used + self._held)
            case "where":
                self._compared(version)
                self._one("phases", version)
                if self._missing(kind, version):
                    self._floor(version)
                    for stage in _WHERE:
                        self._add(stage, self._used)
            case "first failure":
                self._add(ServiceStage.DRAWING_FIRST_FAILURE, 1)
            case "present failure":
                self._add(ServiceStage.DRAWING_PRESENT_FAILURE, 1)
            case "next":
                self._floor(version)
                self._add(ServiceStage.PRESENT_INFORMATION, self._used)
                self._add(ServiceStage.SIMULATING_RUN, PLANNED_RUNS)
                self._add(ServiceStage.RUN_INFORMATION, PLANNED_RUNS)
            case _:
                if self._missing("ranking", version):
                    self._floor(version)
                    for stage in _RANKING:
                        self._add(stage, self._used)
                    for stage, likely in _FOUND if _fails(version) else _NOT_FOUND:
                        self.stretches.append(stretch(stage, self._used, likely=likely))

    def _compared(self, version: Version) -> None:
        for held in (False, True):
            if self._number(held) and self._missing("compared", version, held):
                self._fit(version)
                self._runs(held)
                self._add(ServiceStage.COMPARING, self._number(held))

    def _floor(self, version: Version) -> None:
        self._fit(version)
        if self._missing("floor", version):
            self._add(Stage.NOISE_FLOOR, self._used * self._study.draws / DEFAULT_DRAWS)

    def _fit(self, version: Version) -> None:
        self._runs(held=False)
        if self._missing("fit", version):
            self._add(ServiceStage.FITTING, self._used)
            self._add(Stage.NOISE_CORRECTION, self._used)

    def _runs(self, held: bool) -> None:
        if not self._read[held]:
            self._read[held] = True
            self._add(ServiceStage.READING_RUN, self._number(held), "held out" if held else "used")

    def _missing(self, kind: str, version: Version, held: bool = False) -> bool:
        """Whether a value is neither kept nor made by the plan already; it is from now on."""
        place = (kind, version.number, held)
        if place in self._known:
            return False
        self._known.add(place)
        return version.number < 0 or not self._values.has(kind, version, held)

    def _number(self, held: bool) -> int:
        return self._held if held else self._used

    def _add(self, stage: ServiceStage | Stage, parts: float, subject: str = "") -> None:
        self.stretches.append(stretch(stage, parts, subject))


def _fails(version: Version) -> bool:
    """Whether rows of a version fail in the runs used; False for one of which nothing is known."""
    scores = version.result.get("rows", {}).get("used", {})
    return fails(worst_row(scores)[1])


_WHERE = (
    Stage.STATES_FOLLOWED, Stage.RESIDUAL_SPECTRA, Stage.STATES_FOLLOWED, Stage.EXPLAINABLE_RESIDUAL,
    Stage.RESTORING_FORCES,
)  # fmt: skip
_TESTS = (Stage.TRIAL_COLUMNS, Stage.REGRESSOR_NOISE, Stage.SCORE_TESTS)
_RANKING = (Stage.SENSOR_TOLERANCES, *_TESTS)
_REFIT = (Stage.FLOOR_BESIDE_EFFECT, *_TESTS)
_ROUND = (Stage.FORWARD_SELECTION, Stage.FIT_WITH_EFFECTS, *_REFIT)
_FINDING = (Stage.LACK_OF_FIT, Stage.PARAMETER_CONSTANCY)
_NOT_FOUND = tuple((stage, SELDOM) for stage in (*_ROUND, *_FINDING))
_FOUND = (
    # The first search goes through more steps, and tries more constants, than those beside what it found.
    (Stage.FORWARD_SELECTION, 4.0), *((stage, 1.0) for stage in (Stage.FIT_WITH_EFFECTS, *_REFIT)),
    (Stage.FORWARD_SELECTION, 3.0), *((stage, 1.0) for stage in (Stage.FIT_WITH_EFFECTS, *_REFIT)),
    (Stage.FORWARD_SELECTION, 1.0), *((stage, SELDOM) for stage in (
        Stage.RELINEARISATION, Stage.FLOOR_AT_LATENCIES, *_TESTS, Stage.FLOOR_AT_TOLERANCES, *_TESTS)),
    (Stage.LACK_OF_FIT, 1.0), (Stage.PARAMETER_CONSTANCY, 3.0), (Stage.ENCOMPASSING, 1.0),
)  # fmt: skip
"""Stages of a ranking after its first tests, and the part of their usual time that is planned for: where nothing fails,
and where rows do, so that several effects may be found. Source: two studies that lacked three and five effects."""
_FURTHER: Mapping[AnyStage, tuple[AnyStage, ...]] = {
    Stage.FORWARD_SELECTION: (Stage.FIT_WITH_EFFECTS, *_REFIT),
    Stage.FIT_WITH_EFFECTS: _REFIT,
    Stage.RELINEARISATION: (Stage.FLOOR_AT_LATENCIES, *_TESTS),
    Stage.FLOOR_AT_TOLERANCES: _TESTS,
    Stage.ENCOMPASSING: (Stage.FIT_WITH_EFFECTS, *_REFIT, Stage.SYMBOLIC_LAWS),
    Stage.SYMBOLIC_LAWS: _REFIT,
}
"""Stage of a search → stages that follow it, as a rule."""
