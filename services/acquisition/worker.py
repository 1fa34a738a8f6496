"""Worker: it assembles runs from the bus, requests missing blocks, and processes complete runs."""

from __future__ import annotations

import json
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event
from typing import Any

from lacet.daq.bus.listener import BusListener, Message
from lacet.daq.bus.session import Keys, chunk
from lacet.daq.errors import LacetError
from lacet.daq.formats.log import LogWriteError
from lacet.daq.formats.result import plain
from lacet.daq.formats.wire import WireError, start_from_bytes
from lacet.services.acquisition.assembly import Assembly, Phase
from lacet.services.acquisition.claims import Claims
from lacet.services.acquisition.run_state import RunState, free_log, read_states, write_text

RESULT = ".result.json"
"""End of the name of a run's result, in place of the log's ``.mcap``."""
INCOMPLETE = ".incomplete.mcap"
"""End of the name of a log that lacks blocks; the run's own name is kept for the whole one."""
PATIENCE = 10.0
"""Silence of a reachable bus after which a recorder is asked for a sign of life [s]."""
DEADLINE = 30.0
"""Longest time on a reachable bus without any of the blocks asked for [s]."""
SIGN = 3.0
"""Time for a sign of life, once asked for [s]."""
ROOM = 5.0
"""Time between attempts to write to a full disk [s]."""
MOST_RUNS = 64
"""Most runs in reception at once."""
MOST_RUNS_OF_A_CAR = 8
"""Most runs of one car in reception at once."""
MOST_UNKNOWN = 256
"""Most runs that were heard of, but whose start record has not come yet."""
AGAIN = 2.0
"""Time after which a start record, or an acknowledgement, is sent for again [s]."""
TURN = 0.2
"""Longest time for messages before the runs have their turn [s]."""

OnRun = Callable[[Path], dict[str, Any]]
"""Processing of an assembled run: path of its log → entries of the result."""


@dataclass(frozen=True)
class RunResult:
    """Outcome of one run at a worker.

    Attributes
    ----------
    path : the log.
    complete : whether the log holds everything that the recorder published, checksums included.
    missing : channel → ranges (first, last) of missing block numbers.
    notes : plain sentences: what is missing and why.
    work : the result of `OnRun`, or ``{"error": …}``.
    worker : the worker that worked on it; empty for this one.
    """

    run_id: str
    car: str
    path: Path
    complete: bool
    missing: dict[str, list[tuple[int, int]]]
    notes: list[str]
    work: dict[str, Any]
    worker: str = ""

    @property
    def keys(self) -> Keys:
        """Keys of the run."""
        return Keys(self.car, self.run_id)

    def payload(self) -> dict[str, Any]:
        """Content of the run's result file."""
        return {
            "run_id": self.run_id,
            "car": self.car,
            "log": self.path.name,
            "complete": self.complete,
            "missing": {name: [list(span) for span in spans] for name, spans in self.missing.items()},
            "notes": self.notes,
            "result": self.work,
        }


class Worker:
    """Worker that receives runs from the bus, assembles and processes each, and publishes the results.

    Whatever a run sends, it cannot end the worker or touch the log of another; see `MOST_RUNS` for how many are taken.

    Parameters
    ----------
    folder : folder of logs and results; may be empty. Runs in it whose result is missing are processed first.
    name : this worker's name on the bus.
    on_run : processing of an assembled run, in a thread of its own.
    patience, deadline : see `PATIENCE`, `DEADLINE` [s].
    unreachable : time after which a run is closed though the bus cannot be reached [s].
    notify : called with plain sentences for the user.
    """

    def __init__(
        self,
        listener: BusListener,
        folder: Path,
        name: str,
        on_run: OnRun,
        *,
        patience: float = PATIENCE,
        deadline: float = DEADLINE,
        unreachable: float = 3600.0,
        notify: Callable[[str], None] = print,
    ):
        self._listener = listener
        self._folder = folder
        self._name = name
        self._on_run = on_run
        self._patience = patience
        self._deadline = deadline
        self._unreachable = unreachable
        self._notify = notify
        self._runs: dict[Keys, Assembly] = {}
        self._unknown: dict[Keys, float] = {}
        self._said: set[str] = set()
        self._acknowledged: dict[Keys, float] = {}
        self._away = 0.0
        self._full_until = 0.0
        self._claims = Claims(listener, name)
        self._waiting: dict[Keys, RunResult] = {}
        self._busy: Keys | None = None
        self._jobs: queue.SimpleQueue[RunResult] = queue.SimpleQueue()
        self._finished: queue.SimpleQueue[RunResult] = queue.SimpleQueue()
        self._unwritten: list[RunResult] = []
        folder.mkdir(parents=True, exist_ok=True)
        self._states = {state.keys: state for state in read_states(folder)}

    def run(self, stop: Event, once: bool = False) -> list[RunResult]:
        """Work until `stop` is set, or after one run when `once`."""
        results: list[RunResult] = []
        threading.Thread(target=self._work, name="worker-fit", daemon=True).start()
        for state in self._states.values():
            if not state.worked:
                self._notify(f"run {state.run}: its log is here, its result is not yet")
                path = self._folder / state.log
                self._waiting[state.keys] = RunResult(state.run, state.car, path, True, {}, list(state.notes), {})
        last = time.monotonic()
        while not stop.is_set() and not (once and results):
            until = time.monotonic() + TURN
            while (message := self._listener.get(0.05)) is not None:
                self._guarded(message.keys, self._take, message)
                if message.kind == "answered" or time.monotonic() > until:
                    break
            now = time.monotonic()
            # A worker that was stopped itself has heard nothing, which says nothing of the recorder.
            passed, last = min(now - last, 2.0 * TURN), now
            connected = self._listener.connected
            self._away = 0.0 if connected else self._away + passed
            for assembly in list(self._runs.values()):
                self._guarded(assembly.keys, self._turn, assembly, passed if connected else 0.0)
            results += self._written()
            if self._busy is None and (keys := self._claims.next(self._waiting)) is not None:
                self._busy = keys
                self._jobs.put(self._waiting.pop(keys))
        for assembly in [a for a in self._runs.values() if stop.is_set() and a.phase is not Phase.INCOMPLETE]:
            if (closed := self._guarded(assembly.keys, self._incomplete, assembly, "the worker was ended")) is not None:
                results.append(closed)
        return results

    def _guarded(self, keys: Keys, do: Callable[..., Any], *args: Any) -> Any:
        """The value of a call for one run; its faults, whatever they are, end the reception of that run only."""
        try:
            return do(*args)
        except (OSError, LogWriteError) as error:
            self._full(error)
        except Exception as error:
            self._notify(f"run {keys.run} of {keys.car}: given up ({type(error).__name__}: {str(error)[:200]})")
            if (assembly := self._runs.pop(keys, None)) is not None:
                assembly.close()
        return None

    def _full(self, error: OSError | LogWriteError) -> None:
        """The disk takes nothing more: nothing is acknowledged, and it is tried again."""
        self._full_until = time.monotonic() + ROOM
        self._say(f"THE DISK CANNOT BE WRITTEN ({error}): runs wait at their recorders until it can")

    def _say(self, text: str) -> None:
        """Say something once."""
        if text not in self._said and len(self._said) < 1000:
            self._said.add(text)
            self._notify(text)

    # -- messages -----------------------------------------------------------------------------------------------------

    def _take(self, message: Message) -> None:
        keys = message.keys
        if message.kind in ("claimed", "unclaimed", "working", "idle"):
            self._claims.take(message)
            return
        if message.kind == "result":
            self._take_result(message)
            return
        if keys in self._states:
            if message.kind not in ("gone", "blocks", "answered"):
                self._acknowledge(self._states[keys])
            return
        assembly = self._runs.get(keys)
        if assembly is None:
            self._take_unknown(message)
            return
        if assembly.phase is Phase.INCOMPLETE:
            if not (message.kind == "start" and message.requested):
                self._ask_start(message)
                return
            assembly.reopen()
            self._notify(f"run {keys.run}: its recorder is heard again")
            self._listener.ask(keys, "manifest")
        if message.kind == "manifest" and not message.requested:
            # Anyone may have sent it: the run's holder is asked, and its answer counts.
            self._listener.ask(keys, "manifest")
        elif message.kind == "alive":
            self._listener.ask(keys, "manifest")
        assembly.take(message)

    def _take_result(self, message: Message) -> None:
        """The result of another worker, for a run that waits here: it is not worked on again."""
        if message.name == chunk(self._name) or (waiting := self._waiting.get(message.keys)) is None:
            return
        try:
            content = json.loads(message.payload)
            if content["digest"] != self._states[message.keys].digest or not isinstance(content["result"], dict):
                return
        except (ValueError, TypeError, KeyError, RecursionError):  # of nobody who has the run
            return
        del self._waiting[message.keys]
        self._notify(f"run {message.keys.run}: worker {message.name} has worked on it")
        self._finished.put(replace(waiting, work=content["result"], worker=message.name))

    def _take_unknown(self, message: Message) -> None:
        """A run is opened by its start record, which its holder is asked for."""
        if message.kind == "start" and message.requested:
            self._open(message.keys, message.payload)
        else:
            self._ask_start(message)

    def _ask_start(self, message: Message) -> None:
        """Ask for the start record of a run that is heard of, not too often."""
        keys, now = message.keys, time.monotonic()
        if message.kind in ("gone", "answered", "blocks") or now - self._unknown.get(keys, -AGAIN) < AGAIN:
            return
        self._unknown = {key: at for key, at in self._unknown.items() if now - at < AGAIN}
        if len(self._unknown) < MOST_UNKNOWN:
            self._unknown[keys] = now
            if message.kind != "alive":  # the listener has asked
                self._listener.ask(keys, "start")

    def _open(self, keys: Keys, payload: bytes) -> None:
        try:
            start = start_from_bytes(payload)
        except WireError as error:
            self._say(f"run {keys.run} of {keys.car}: a start record that cannot be read: {error}")
            return
        if chunk(start.run_id) != keys.run:
            self._say(f"run {keys.run} of {keys.car}: a start record of another run")
            return
        of_car = [run for run in self._runs.values() if run.keys.car == keys.car]
        for runs, most in ((of_car, MOST_RUNS_OF_A_CAR), (list(self._runs.values()), MOST_RUNS)):
            closed = [run for run in runs if run.phase is Phase.INCOMPLETE]
            if len(runs) >= most and not closed:
                self._say(f"car {keys.car}: a further run was not taken, {most} are open")
                return
            if len(runs) >= most:
                self._runs.pop(closed[0].keys, closed[0]).close()
        self._runs[keys] = Assembly(keys, start, self._folder)
        self._unknown.pop(keys, None)
        self._notify(f"run {keys.run}: listening")
        self._listener.ask(keys, "manifest")

    def _acknowledge(self, state: RunState) -> None:
        """Acknowledge a run that is here, again when it is still offered."""
        now = time.monotonic()
        if now - self._acknowledged.get(state.keys, -AGAIN) >= AGAIN:
            self._acknowledged[state.keys] = now
            what = {"run_id": state.run, "complete": True, "notes": list(state.notes), "digest": state.digest}
            self._listener.acknowledge(state.keys, self._name, what)

    # -- runs ---------------------------------------------------------------------------------------------------------

    def _turn(self, assembly: Assembly, passed: float) -> None:
        """What is to be done for a run now, `passed` seconds after the last time on a reachable bus."""
        if assembly.phase is Phase.INCOMPLETE:
            return
        if self._away > self._unreachable:
            self._incomplete(assembly, "its router could not be reached any more", work=True)
            return
        before, assembly.silent = assembly.silent, assembly.silent + passed
        if assembly.no_room:
            assembly.no_room, assembly.silent = False, 0.0
            self._full(OSError("no room for blocks"))
        if time.monotonic() < self._full_until:
            assembly.silent = 0.0
            return
        if assembly.phase is Phase.RECORDING:
            if before < self._patience <= assembly.silent:
                self._listener.ask(assembly.keys, "start")
                self._listener.ask(assembly.keys, "manifest")
            if assembly.silent > self._patience + SIGN:
                self._incomplete(assembly, "its recorder is gone, without a manifest", work=True)
            return
        assembly.pause -= passed
        if assembly.pause <= 0.0 and not assembly.waits():
            self._fetch(assembly)

    def _fetch(self, assembly: Assembly) -> None:
        """Request the next missing blocks; without any, the run is whole."""
        wanted = assembly.request()
        if wanted is None:
            digest = assembly.digest()
            if digest is not None:
                self._complete(assembly, digest)
        elif assembly.silent > self._deadline:
            self._incomplete(assembly, "what is missing is not kept any more", work=True)
        else:
            assembly.asked, assembly.asked_at = wanted[:2], time.monotonic()
            assembly.pause = min(2.0, assembly.silent / 2.0)
            self._listener.ask_blocks(assembly.keys, *wanted)

    def _complete(self, assembly: Assembly, digest: str) -> None:
        path = free_log(self._folder, assembly.keys.run)
        assembly.write(path, complete=True)
        keys = assembly.keys
        state = RunState(keys.car, keys.run, path.name, digest, tuple(assembly.notes))
        state.save(self._folder)
        path.with_name(keys.run + INCOMPLETE).unlink(missing_ok=True)
        del self._runs[keys]
        self._states[keys] = state
        self._acknowledge(state)
        assembly.close()
        for note in assembly.notes:
            self._notify(f"run {keys.run}: {note}")
        self._notify(f"run {keys.run}: complete, {assembly.fetched} blocks fetched, written to {path}")
        self._waiting[keys] = RunResult(keys.run, keys.car, path, True, {}, list(assembly.notes), {})

    def _incomplete(self, assembly: Assembly, why: str, work: bool = False) -> RunResult:
        """Close a run without all of it, for now: it is reopened when its recorder is heard again."""
        missing, keys = assembly.missing(), assembly.keys
        path = self._folder / f"{keys.run}{INCOMPLETE}"
        assembly.write(path, complete=False)
        assembly.phase = Phase.INCOMPLETE
        notes = [*assembly.notes, why]
        if assembly.manifest is None:
            notes.append("without a manifest: what was recorded after the last block is not here")
        notes += [
            f"{name}: missing blocks {', '.join(f'{a}' if a == b else f'{a} to {b}' for a, b in spans)}"
            for name, spans in missing.items()
        ]
        for note in notes:
            self._notify(f"run {keys.run}: {note}")
        self._notify(
            f"run {keys.run}: NOT complete, {assembly.fetched} blocks fetched, written to {path}; it goes on when its "
            "recorder is heard again, or with `lacet publish` of its log"
        )
        result = RunResult(keys.run, keys.car, path, False, missing, notes, {})
        if work:
            self._jobs.put(result)
        return result

    # -- results ------------------------------------------------------------------------------------------------------

    def _work(self) -> None:
        """The thread that processes runs, one after the other."""
        while True:
            result = self._jobs.get()
            try:
                work = self._on_run(result.path)
            except LacetError as error:
                work = {"error": str(error)}
            except Exception as error:
                work = {"error": f"{type(error).__name__}: {error}"}
            self._finished.put(replace(result, work=work))

    def _written(self) -> list[RunResult]:
        """Results that were finished and are written and published now."""
        while not self._finished.empty():
            self._unwritten.append(self._finished.get())
        out: list[RunResult] = []
        if time.monotonic() < self._full_until:
            return out
        for result in list(self._unwritten):
            state = self._states.get(result.keys)
            proof = {} if state is None else {"digest": state.digest}
            content = {"worker": result.worker or self._name, **result.payload(), **proof}
            text = json.dumps(plain(content), indent=1, ensure_ascii=False) + "\n"
            if not result.complete and state is not None:  # the whole run has come in the meantime
                self._unwritten.remove(result)
                continue
            stem = state.log.removesuffix(".mcap") if state is not None else result.run_id
            try:
                write_text(self._folder / f"{stem}{RESULT}", text)
                if state is not None:
                    self._states[result.keys] = state.done()
                    self._states[result.keys].save(self._folder)
            except OSError as error:
                self._full(error)
                break
            if "error" in result.work:
                self._notify(f"run {result.run_id}: {result.work['error']}")
            if not result.worker:
                self._listener.publish_result(result.keys, self._name, text)
            if result.keys == self._busy:
                self._busy = None
                self._claims.release()
            self._unwritten.remove(result)
            out.append(result)
        return out
