"""Follower of a recording: takes its samples from the bus and fits the present model to them each second."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from lacet.daq.bus.listener import BusListener
from lacet.daq.errors import LacetError
from lacet.daq.formats.result import plain
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.catalogue import base_model, catalogue, find_effect
from lacet.identify.regression.model import Model
from lacet.identify.validation.score import fails
from lacet.services.acquisition.live_samples import LiveSamples, marks_set, sensor_states
from lacet.services.render.identifiability import unidentified
from lacet.services.render.live_fit import state_line, still_needed
from lacet.services.render.live_line import lost_text
from lacet.services.render.value_names import parameter_name
from lacet.services.workspace.live_fit import LiveFit, LiveFitEnded, LiveResult, ModelOf
from lacet.services.workspace.study import Study

TARGET = 2.0
"""Half of the 95 % interval, the sensor sheet included, that is enough [% of the value]. Source: a choice."""
MESSAGES = 2000
"""Most messages that are taken in a turn."""


def model_of_study(folder: Path | None, added: tuple[str, ...] = ()) -> ModelOf:
    """The present model of a study, and effects added to it; of none, or one without versions, the base model."""
    study = None if folder is None else Study.open(folder)

    def model(vehicle: Vehicle, reference: str) -> Model:
        if study is not None and study.versions():
            known, effects = study.effects(reference), study.model(study.version(), reference).effects
        else:
            known, effects = catalogue(vehicle, reference), tuple(base_model(vehicle, reference))
        return Model.of([*effects, *(find_effect(key, known) for key in added)])

    return model


class LiveFollower:
    """What is known of the recording that a listener hears, second by second.

    Parameters
    ----------
    listener : to the bus.
    model_of : the model that is fitted.
    target : half of the 95 % interval with the sensor sheet ÷ value that is enough.
    """

    def __init__(self, listener: BusListener, model_of: ModelOf, target: float):
        self._listener, self._model_of, self._target = listener, model_of, target
        self.samples = LiveSamples(listener)
        self._fit: LiveFit | None = None
        self._run = ""
        self._seconds = 0
        self._finished = False
        self._heard = 0.0
        self._result: LiveResult | None = None
        self._why = "no recording is heard yet"
        self.over = False
        """Whether a run was heard and its recorder is gone."""

    def turn(self, timeout: float) -> dict[str, Any] | None:
        """Process what comes within `timeout` [s]; the state at the next whole second, None where there is none yet.

        Of a run that is over the last one is a fit from scratch (`LiveFit.whole`).
        """
        message = self._listener.get(timeout)
        for _ in range(MESSAGES):
            if message is None:
                break
            self.samples.take(message)
            message = self._listener.get(0.0)
        self._heard = time.monotonic()
        samples = self.samples
        self.over = bool(samples.start) and not samples.recording
        if samples.start is None:
            return None
        if not samples.latest_ns:
            self._why = "a recording is heard, but none of its sensors"
            return None
        if samples.start.run_id != self._run:
            self._begin()
        if self._fit is None or (not samples.whole and not self._seconds):
            return None
        seconds = self._fit.seconds_there(samples)
        if seconds <= self._seconds:
            return self._whole()
        self._seconds, self._finished = seconds, False
        try:
            self._result, self._why = self._fit.update(samples, seconds), ""
        except LiveFitEnded as ended:
            self._why = str(ended)
            self._fit = None
            samples.drop()
        except LacetError as error:
            self._why = " ".join(str(error).split())[:300]
        return self.state()

    def _whole(self) -> dict[str, Any] | None:
        """The state with the fit from scratch of a run that is over, once; None where it goes on or has no such fit."""
        if not self.over or self._finished or self._fit is None or self._result is None:
            return None
        self._finished = True
        try:
            found = self._fit.whole(self.samples, self._seconds)
        except LacetError:
            return None  # what was known last stays
        if found is None:
            return None
        self._result = found
        return self.state()

    def _begin(self) -> None:
        assert self.samples.start is not None
        self._run, self._seconds, self._result, self._fit = self.samples.start.run_id, 0, None, None
        try:
            self._fit = LiveFit(self.samples.start, self._model_of, self._target)
        except LacetError as error:
            self._why = " ".join(str(error).split())[:300]

    def state(self) -> dict[str, Any]:
        """What is known at present, as plain data (``docs/json.md``, ``live``)."""
        samples, found = self.samples, self._result
        begun = samples.start.started_ns if samples.start else 0
        ledger = samples.ledger
        losses = ledger.get("losses")
        out = nothing_known(self._target, self._why) | {
            "run_id": self._run,
            "recording": samples.recording,
            "sensors": sensor_states(ledger),
            "losses": lost_text(losses) if isinstance(losses, dict) else "",
            "marks": marks_set(ledger, begun),
        }
        if found is not None:
            out |= fit_state(found, self._target)
            # The newest sample heard, and the time that has gone by since, in which others may have come.
            waited = time.monotonic() - self._heard if samples.recording else 0.0
            out["behind"] = 1e-9 * (samples.latest_ns - begun) + waited - found.seconds
        out["line"] = state_line(out)
        return dict(plain(out))


def nothing_known(target: float, why: str) -> dict[str, Any]:
    """The state without a recording, in the form of `LiveFollower.state`; `why` : the reason."""
    return {
        "run_id": "", "recording": False, "target": target, "why": why, "line": why, "sensors": [], "losses": "",
        "marks": [], "seconds": None, "behind": None, "from_scratch": False, "since": None, "took": None, "rows": [],
        "parameters": [], "enough": 0, "not_identifiable": [],
    }  # fmt: skip


def over(last: dict[str, Any]) -> dict[str, Any]:
    """What was known of a recording last, once nothing more is heard."""
    return {**last, "recording": False, "line": f"nothing more is heard; {last['line']}"}


def fit_state(found: LiveResult, target: float) -> dict[str, Any]:
    """A result of the live fit as plain data; `target` as in `LiveFollower`."""
    parameters: list[dict[str, Any]] = []
    for one, half, least, seconds in zip(
        found.estimates, found.enough.half, found.enough.least, found.enough.seconds, strict=True
    ):
        if one.identifiable:
            words, symbol = parameter_name(one.name, one.effect)
            parameters.append(
                {
                    "name": one.name, "words": words, "symbol": symbol, "effect": one.effect, "value": one.value,
                    "unit": one.unit, "half95_sheet": one.half_sheet, "relative": half, "least": least,
                    "seconds_needed": seconds, "answer": still_needed(float(seconds), float(least), target),
                }
            )  # fmt: skip
    return {
        "seconds": found.seconds,
        "from_scratch": found.from_scratch,
        "since": found.since,
        "took": found.took,
        "rows": [
            {
                "row": str(row), "unit": row.unit, "rms": score.rms, "floor": score.floor, "ratio": score.ratio,
                "fails": fails(score.ratio),
            }
            for row, score in found.scores.items()
        ],
        "parameters": sorted(parameters, key=lambda one: one["relative"]),
        "enough": sum(one["seconds_needed"] == 0.0 for one in parameters),
        "not_identifiable": [
            {"name": one.name, "why": unidentified(one.why)} for one in found.estimates if not one.identifiable
        ],
    }  # fmt: skip
