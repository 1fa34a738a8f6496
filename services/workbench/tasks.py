"""Jobs of the workbench: each does what a command does, with progress, and can be cancelled."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from lacet.daq.errors import UsageError
from lacet.daq.formats.open_run import open_run
from lacet.daq.formats.result import plain
from lacet.daq.run import Run
from lacet.identify.validation.noise_floor import LEAST_DRAWS
from lacet.services.planning.separation import next_run
from lacet.services.progress import planned
from lacet.services.render.verdicts import change_sentence
from lacet.services.workbench.effect_previews import candidate, prepare
from lacet.services.workbench.help_pages import bring_examples
from lacet.services.workbench.jobs import Do, JobProgress
from lacet.services.workbench.run_files import FOLDER, RAW, RunFiles, find_run
from lacet.services.workbench.session_cache import SessionCache
from lacet.services.workspace.decode import decode_log, decoding_plan
from lacet.services.workspace.loading import find_rig, find_vehicle
from lacet.services.workspace.report import write_report
from lacet.services.workspace.results import diagnosis_result, study_result
from lacet.services.workspace.session import MOST_EFFECTS, Session
from lacet.services.workspace.study import Study

REPORT, MARKDOWN, PICTURE = "report.html", "report.md", "report.png"
"""Files of the report in the study's folder: whole, its first page with tables, and that page's picture."""
WITHIN = 27.0
"""Time in which the search for the next run ends [s]: the page answers within half a minute, and goes on from the
motions it has when it is asked again."""
Found = TypeVar("Found")


class Tasks:
    """Functions of the jobs on the study of a cache; `draws` : noise-floor simulations of a new study."""

    def __init__(self, cache: SessionCache, files: RunFiles, draws: int):
        self.cache, self.files, self.draws = cache, files, draws

    def by_name(self) -> dict[str, Do]:
        """Every job by its name."""
        own: dict[str, Do] = {
            "choose": self.choose, "compare": self.compare, "where": self.where, "diagnose": self.diagnose,
            "preview": self.preview, "add": self.add, "remove": self.remove, "undo": self.undo, "goto": self.goto,
            "next": self.next, "report": self.report, "decode": self.decode, "examples": self.examples,
        }  # fmt: skip
        return {name: self._alone(task) for name, task in own.items()}

    def _alone(self, task: Do) -> Do:
        def run(args: Mapping[str, Any], teller: JobProgress) -> Any:
            with self.cache.computing():
                return plain(task(args, teller))

        return run

    # -- the runs -----------------------------------------------------------------------------------------------------

    def choose(self, args: Mapping[str, Any], teller: JobProgress) -> dict[str, Any]:
        """Create the study with these runs, or refit its present model to them."""
        used = [find_run(self.cache, name) for name in _names(args, "used")]
        held = [find_run(self.cache, name) for name in _names(args, "held")]
        if not used:
            raise UsageError("choose at least one run to identify with")
        if twice := self.files.twins(used, held):
            one, other = twice
            raise UsageError(
                f"{one} and {other} hold the same samples: a run held out would be one the fit has seen, or one run "
                "would count twice. Leave one of them out"
            )
        if not self.cache.exists:
            return self._make(used, held, teller)
        study = self.cache.study
        version = study.version()
        session = self.cache.session(study.with_runs(used, held), teller.progress)
        after = session.record(version.effects, f"runs chosen anew: {_named(used)}; held out {_named(held) or 'none'}")
        return self._shown(session, after.number, teller)

    def _make(self, used: list[Path], held: list[Path], teller: JobProgress) -> dict[str, Any]:
        folder = self.cache.folder
        there = {name: (folder / name).is_file() for name in ("rig.toml", "vehicle.toml")}
        first = open_run(used[0])
        rig = _dropped(find_rig, first, folder / "rig.toml")
        vehicle = _dropped(find_vehicle, first, folder / "vehicle.toml")
        (folder / "study.json").unlink(missing_ok=True)  # of a study whose creation was interrupted: it has no version
        study = Study.create(folder, used, held, rig, vehicle, draws=self.draws)
        try:
            session = self.cache.session(study, teller.progress)
            version = session.record({}, "base model")
        except BaseException:  # an incomplete study would prevent the next attempt
            (folder / "study.json").unlink(missing_ok=True)
            for name, before in there.items():
                if not before:
                    (folder / name).unlink(missing_ok=True)
            raise
        return self._shown(session, version.number, teller)

    def decode(self, args: Mapping[str, Any], teller: JobProgress) -> dict[str, Any]:
        """Decode a raw capture in the study's folder of captures into a run."""
        name = str(args.get("file", ""))
        raw = self.cache.folder / RAW / Path(name).name
        if not raw.is_file():
            raise UsageError(f"there is no capture '{name}' in {RAW}")
        out = self.cache.folder / FOLDER / f"{raw.stem}.mcap"
        if out.exists() and not args.get("again"):
            raise UsageError(f"{out.name} is there already")
        out.parent.mkdir(exist_ok=True)
        teller.progress(planned(decoding_plan()))
        return decode_log(raw, out, progress=teller.progress)

    def examples(self, args: Mapping[str, Any], teller: JobProgress) -> dict[str, Any]:
        """Bring in the runs of the guided tour."""
        return bring_examples(self.cache, teller)

    # -- analyses -----------------------------------------------------------------------------------------------------

    def compare(self, args: Mapping[str, Any], teller: JobProgress) -> Mapping[str, Any]:
        """Compare a version with its runs."""
        return self.cache.compare(_number(args), teller.progress).payload

    def where(self, args: Mapping[str, Any], teller: JobProgress) -> Mapping[str, Any]:
        """Analyse where a version fails."""
        number = self.cache.version(_number(args))[1].number
        self.cache.where(number, teller.progress)
        self.cache.compare(number, teller.progress)
        return self.cache.found_where(number)[1]

    def diagnose(self, args: Mapping[str, Any], teller: JobProgress) -> dict[str, Any]:
        """Rank the effects that may be missing; with `auto` add the best until none is missing."""
        study = self.cache.study
        if study.draws < LEAST_DRAWS:
            raise UsageError(f"the study simulates {study.draws} runs of noise; at least {LEAST_DRAWS} are needed")
        session = self.cache.session(study, teller.progress)
        auto = bool(args.get("auto"))
        found = session.add_missing(
            MOST_EFFECTS if auto else 0,
            lambda diagnosis: self.cache.keep_diagnosis(session.study.current, session.study, diagnosis),
        )  # fmt: skip
        steps = [diagnosis_result(diagnosis) for diagnosis in found.diagnoses]
        if best := steps[-1]["best"]:
            prepare(self.cache, candidate(self.cache, None, best), teller.progress)
        self.cache.compare(session.study.current, teller.progress)
        return {**steps[-1], "version": session.study.current, "auto": auto, "added": found.changes, "steps": steps}

    def preview(self, args: Mapping[str, Any], teller: JobProgress) -> dict[str, Any]:
        """Fit a version's model with one more effect, to see what it would do."""
        found = prepare(self.cache, candidate(self.cache, _number(args), _effect(args)), teller.progress)
        return {"effect": _effect(args), "row": found.row, "run": found.run}

    def next(self, args: Mapping[str, Any], teller: JobProgress) -> dict[str, Any]:
        """Recommend the run to drive next."""
        until = time.monotonic() + WITHIN
        study = self.cache.study
        session = self.cache.session(study, teller.progress)
        diagnosis = self.cache.diagnosis(study.current)
        version = study.version()
        with session.planned(*[("ranking", version)] * (diagnosis is None), ("next", version)):
            if diagnosis is None:
                diagnosis = session.diagnose()
                self.cache.keep_diagnosis(study.current, study, diagnosis)
            within = until - time.monotonic()  # the runs may have had to be read first
            found = next_run(session, diagnosis, _names(args, "effects"), _names(args, "without"), within)
        return {"next": found}

    def report(self, args: Mapping[str, Any], teller: JobProgress) -> dict[str, Any]:
        """Write the report into the study's folder."""
        file = self.cache.folder / REPORT
        session = self.cache.session(self.cache.study, teller.progress)
        write_report(session, file.with_name(MARKDOWN))
        write_report(session, file)
        return {"report": REPORT, "bytes": file.stat().st_size}

    # -- the model ----------------------------------------------------------------------------------------------------

    def add(self, args: Mapping[str, Any], teller: JobProgress) -> dict[str, Any]:
        """Add an effect to the present version."""
        key = _effect(args)
        shape = args.get("shape")
        if shape is not None and not (
            isinstance(shape, dict) and all(isinstance(v, int | float) for v in shape.values())
        ):
            raise UsageError("shape: numbers by name")
        return self._changed(key, teller, lambda session: session.add(key, shape or None), "Added")

    def remove(self, args: Mapping[str, Any], teller: JobProgress) -> dict[str, Any]:
        """Remove an effect from the present version."""
        key = _effect(args)
        return self._changed(key, teller, lambda session: session.remove(key), "Removed")

    def _changed(self, key: str, teller: JobProgress, change: Any, what: str) -> dict[str, Any]:
        study = self.cache.study
        session = self.cache.session(study, teller.progress)
        before = study.version()
        after = change(session)
        item = session.change(key, before, after)
        self._shown(session, after.number, teller)
        return {"version": after.number, **item, "says": change_sentence(item, what)}

    def undo(self, args: Mapping[str, Any], teller: JobProgress) -> dict[str, object]:
        """Return to the version that the present one was made from."""
        study = self.cache.study
        parent = study.version().parent
        if parent < 1:
            raise UsageError("the present version is the first: there is nothing to undo")
        return study_result(study.go_to(parent))

    def goto(self, args: Mapping[str, Any], teller: JobProgress) -> dict[str, object]:
        """Make another version the present one."""
        number = _number(args)
        if number is None:
            raise UsageError("name a version")
        return study_result(self.cache.study.go_to(number))

    def _shown(self, session: Session, number: int, teller: JobProgress) -> dict[str, Any]:
        """The new version's comparison, computed at once, as the page will ask for it."""
        self.cache.compare(number, teller.progress)
        return {"version": number, "warnings": session.study.version(number).result.get("warnings", [])}


def _dropped(find: Callable[[Run, Path | None], Found], run: Run, file: Path) -> Found:
    """A rig or vehicle, from a file that was dropped on the page where there is one."""
    try:
        return find(run, file if file.is_file() else None)
    except UsageError as error:  # the page has no such options
        raise UsageError(str(error).replace(f"give --{file.stem} FILE", f"drop its {file.name} here")) from None


def _names(args: Mapping[str, Any], key: str) -> Sequence[str]:
    found = args.get(key) or []
    if not isinstance(found, list) or not all(isinstance(name, str) for name in found):
        raise UsageError(f"{key}: a list of names")
    return found


def _number(args: Mapping[str, Any]) -> int | None:
    found = args.get("version")
    if found is not None and (not isinstance(found, int) or isinstance(found, bool)):
        raise UsageError("version: a whole number")
    return found


def _effect(args: Mapping[str, Any]) -> str:
    found = args.get("effect")
    if not isinstance(found, str) or not found:
        raise UsageError("effect: name one of the catalogue or of the study's own")
    return found


def _named(paths: Sequence[Path]) -> str:
    return ", ".join(path.stem for path in paths)
