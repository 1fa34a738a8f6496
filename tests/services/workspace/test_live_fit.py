"""Live fit: fed with the blocks of a log as the bus brings them, against `lacet identify` of the same seconds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from lacet.daq.blocks import Block
from lacet.daq.bus.listener import BusListener, Message
from lacet.daq.bus.session import LENGTH, Keys
from lacet.daq.errors import RunError, UsageError
from lacet.daq.formats.log import LogReader, LogWriter
from lacet.daq.formats.wire import block_from_bytes, block_to_bytes, start_to_bytes
from lacet.daq.run_limits import RunLimits
from lacet.identify.effects.catalogue import base_model
from lacet.identify.regression import recursive_fit
from lacet.identify.regression.model import Model
from lacet.identify.regression.wls import fit
from lacet.identify.validation.parameter_estimates import estimates
from lacet.identify.validation.score import compare
from lacet.services.acquisition import block_store, live_samples
from lacet.services.acquisition.assembly import recorded_axes
from lacet.services.acquisition.live_samples import ATTEMPTS, LEAST_FREE, LiveSamples, marks_set, sensor_states
from lacet.services.render.live_fit import still_needed
from lacet.services.workspace import live_fit, live_follow
from lacet.services.workspace.decode import decode_log
from lacet.services.workspace.live_fit import LiveFit, LiveFitEnded, LiveResult
from lacet.services.workspace.live_follow import LiveFollower, model_of_study
from lacet.services.workspace.loading import load
from lacet.services.workspace.study import Study
from tests.support.captures import SINUS, cut

KEYS = Keys("car", "run")
BATCH = 50_000_000
"""Duration of a block [ns]."""


class _Bus(BusListener):
    """A listener without a bus, which notes what is asked for."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, int, int]] = []
        self.queue: list[Message] = []

    def get(self, timeout: float) -> Message | None:
        return self.queue.pop(0) if self.queue else None

    def ask_blocks(self, keys: Keys, channel: str, first: int, last: int) -> None:
        self.asked.append((channel, first, last))


class _Recording:
    """A decoded log, whose blocks come to `samples`, or are given to `take`, second by second."""

    def __init__(self, log: Path, take: Callable[[Message], None] | None = None):
        self.reader = LogReader(log)
        self.begin = self.reader.start.started_ns
        self.bus = _Bus()
        self.samples = LiveSamples(self.bus)
        self.take = take or self.samples.take
        for kind, payload in (("alive", b""), ("start", start_to_bytes(self.reader.start))):
            self.take(Message(KEYS, kind, "", 0, payload))
        # In another order than a log's, as sensors are heard.
        self._blocks = {name: list(_batches(block)) for name, block in reversed(self.reader.blocks().items())}
        self._given = dict.fromkeys(self._blocks, 0)

    def go_on(self, seconds: float) -> None:
        """Bring what was recorded in the first seconds."""
        for name, blocks in self._blocks.items():
            while self._given[name] < len(blocks):
                number = self._given[name]
                if int(blocks[number].t_ns[-1]) - self.begin > 1e9 * seconds:
                    break
                self.take(Message(KEYS, "block", name, number, block_to_bytes(blocks[number], number, "")))
                self._given[name] += 1

    def written(self, path: Path) -> Path:
        """A log of what has come so far."""
        with LogWriter(path, self.reader.start) as log:
            for block in self.samples.blocks().values():
                log.write_block(block)
        return path


def _batches(block: Block) -> Iterator[Block]:
    edges = np.flatnonzero(np.diff(block.t_ns // BATCH, prepend=-1)).tolist()
    for a, b in zip(edges, [*edges[1:], len(block)], strict=True):
        device = None if block.device_ns is None else block.device_ns[a:b]
        yield Block(block.channel, block.t_ns[a:b], block.values[a:b], block.flags[a:b], device)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first 14.1 s of a capture, decoded."""
    folder = tmp_path_factory.mktemp("live")
    cut(SINUS, folder / "raw.mcap", 14.1)
    decode_log(folder / "raw.mcap", folder / "log.mcap")
    return folder / "log.mcap"


def expected(log: Path, seconds: int) -> tuple[dict[str, tuple[float, float]], dict[str, float]]:
    """Value and half interval of each parameter, and error ÷ floor of each row, as `lacet identify --to` has them."""
    loaded = load([log], limits=RunLimits(end=str(seconds)))
    fitted = fit(Model.of(base_model(loaded.vehicle, loaded.reference)), loaded.prepared)
    values = {one.name: (one.value, one.half_sheet) for one in estimates(fitted, None, fitted.runs)}
    return values, {str(row): score.ratio for row, score in compare(fitted, fitted.runs[0]).scores.items()}


def apart(found: LiveResult, wanted: dict[str, tuple[float, float]]) -> float:
    """Largest difference of values in half intervals, and of these as a part of them."""
    return max(
        max(abs(one.value - wanted[one.name][0]), abs(one.half_sheet - wanted[one.name][1])) / wanted[one.name][1]
        for one in found.estimates
        if one.half_sheet > 0.0
    )


@dataclass(frozen=True)
class _Followed:
    """A recording that was followed: its fits after 9, 10 and 14 s, with logs of what had come, and one begun late."""

    car: _Recording
    results: list[LiveResult]
    logs: list[Path]
    late: LiveResult


@pytest.fixture(scope="module")
def followed(log: Path, tmp_path_factory: pytest.TempPathFactory) -> _Followed:
    """A run that is fitted from scratch at 9 s and, beside the sums, at 10 s; then as sums that go on."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (("QUICK", 0.0), ("LONGEST", 10.0), ("STEP", 2.0)):
            patch.setattr(live_fit, name, value)
        # Any change of a value asks for a fit from scratch.
        for name, value in (("GROWTH", 1e9), ("LEAST_GROWTH", 1.0), ("MOVED", 0.0)):
            patch.setattr(live_fit, name, value)
        patch.setattr(recursive_fit, "CHUNK", 1.0)
        for name, value in (("STRETCH", 10), ("HELD", 2)):
            patch.setattr(block_store, name, value)
        car = _Recording(log)
        live, late = (LiveFit(car.reader.start, model_of_study(None), 0.02) for _ in range(2))
        car.go_on(2.0)
        with pytest.raises(RunError, match="overlap"):
            live.update(car.samples, live.seconds_there(car.samples))
        results, logs = list[LiveResult](), list[Path]()
        for seconds in (9, 10, 14):
            car.go_on(seconds + 0.06)
            assert live.seconds_there(car.samples) == seconds
            logs.append(car.written(tmp_path_factory.mktemp("written") / "same.mcap"))
            if seconds == 14:
                begun_late = late.update(car.samples, seconds)
            results.append(live.update(car.samples, seconds))
            live.wait()
    return _Followed(car, results, logs, begun_late)


def test_it_is_identify_of_the_same_seconds(followed: _Followed):
    found = followed.results[0]
    values, ratios = expected(followed.logs[0], 9)
    assert (found.from_scratch, found.since, found.seconds) == (True, 9.0, 9.0)
    assert apart(found, values) < 1e-6
    assert {str(row): score.ratio for row, score in found.scores.items()} == pytest.approx(ratios, rel=1e-6)
    assert followed.car.bus.asked == []


def test_sums_go_on_from_it_and_hardly_differ(followed: _Followed):
    """The sums of 9 s go on for one more; a fit from scratch differs by its own draws of simulated noise, too."""
    found = followed.results[1]
    assert (found.from_scratch, found.since, found.seconds) == (False, 9.0, 10.0)
    values, ratios = expected(followed.logs[1], 10)
    close = [
        abs(one.value - values[one.name][0]) / values[one.name][1] for one in found.estimates if one.half_sheet > 0.0
    ]
    assert max(close) < 0.5
    assert np.median(close) < 0.05
    assert {str(row): score.ratio for row, score in found.scores.items()} == pytest.approx(ratios, rel=0.1)


def test_values_that_move_ask_for_a_fit_from_scratch(followed: _Followed):
    assert [found.since for found in followed.results] == [9.0, 9.0, 10.0]


def test_one_that_comes_late_adds_the_seconds_beyond_the_longest_in_steps(followed: _Followed):
    """Device clocks that are fitted to other samples differ by microseconds; what is not needed is not kept."""
    found, last = followed.late, followed.results[2]
    for one in (found, last):
        assert (one.from_scratch, one.since, one.seconds) == (False, 10.0, 14.0)
    assert apart(found, {one.name: (one.value, one.half_sheet) for one in last.estimates}) < 1e-3
    car = followed.car
    assert min(int(block.t_ns[0]) for block in car.samples.blocks().values()) > car.begin + 200_000_000


def test_a_model_with_a_sensor_fault_is_fitted_up_to_a_length(log: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(live_fit, "LONGEST", 5.0)
    car = _Recording(log)
    car.go_on(6.06)
    live = LiveFit(car.reader.start, model_of_study(None, ("sensor_latency.laser",)), 0.02)
    with pytest.raises(LiveFitEnded, match="a model with a sensor fault is fitted to 5 s at most"):
        live.update(car.samples, 6)


def test_it_ends_with_a_line_before_the_disk_is_full(log: Path, monkeypatch: pytest.MonkeyPatch):
    """The samples are dropped, no more are stored, and what was known stays."""
    for name, value in (("STRETCH", 20), ("HELD", 6)):
        monkeypatch.setattr(block_store, name, value)
    monkeypatch.setattr(live_follow, "MESSAGES", 1_000_000)
    monkeypatch.setattr(live_samples, "free_bytes", lambda: LEAST_FREE - 1)
    bus = _Bus()
    car, follower = _Recording(log, bus.queue.append), LiveFollower(bus, model_of_study(None), 0.02)
    car.go_on(6.06)
    first = follower.turn(0.0)
    assert first is not None
    assert (first["seconds"], first["why"]) == (6.0, "")
    car.go_on(7.06)
    last = follower.turn(0.0)
    assert last is not None
    assert "the recording goes on: less than 1.0 GB are free" in last["line"]
    assert (last["seconds"], last["parameters"]) == (6.0, first["parameters"])
    car.go_on(8.0)
    assert follower.turn(0.0) is None
    assert follower.state()["line"] == last["line"]
    assert follower.samples.blocks() == {}


def test_a_run_that_is_over_is_fitted_from_scratch_once_more(
    log: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    """Where sums went on it is the fit of the run's log; a run that is too long keeps what was known."""
    monkeypatch.setattr(live_follow, "MESSAGES", 1_000_000)
    monkeypatch.setattr(live_fit, "QUICK", 0.0)
    bus = _Bus()
    car, follower = _Recording(log, bus.queue.append), LiveFollower(bus, model_of_study(None), 0.02)
    for seconds in (9.06, 10.06):
        car.go_on(seconds)
        last = follower.turn(0.0)
    assert last is not None
    assert (last["from_scratch"], follower.turn(0.0)) == (False, None)
    car.go_on(10.5)
    car.take(Message(KEYS, "gone", "", 0, b""))
    monkeypatch.setattr(live_fit, "LONGEST", 9.0)
    assert follower.turn(0.0) is None
    monkeypatch.undo()
    follower._finished = False
    found = follower.turn(0.0)
    assert found is not None
    assert (found["from_scratch"], found["recording"], found["seconds"]) == (True, False, 10.0)
    assert "from scratch, as lacet identify --to 10" in found["line"]
    assert found["behind"] < 1.0
    assert follower.turn(0.0) is None
    car.samples = follower.samples
    values, _ = expected(car.written(tmp_path / "over.mcap"), 10)
    for one in found["parameters"]:
        value, half = values[one["name"]]
        assert abs(one["value"] - value) < 1e-6 * half
        assert one["half95_sheet"] == pytest.approx(half, rel=1e-6)


def test_what_was_missed_is_asked_for(log: Path):
    """One that comes late asks for all blocks before; what is no block changes nothing."""
    car = _Recording(log)
    name = "imu.accel"
    blocks = [block_to_bytes(block, number, "") for number, block in enumerate(_batches(car.reader.blocks()[name]))]
    car.samples.take(Message(KEYS, "block", name, 7, blocks[7]))
    car.samples.take(Message(KEYS, "block", name, 9, blocks[8]))  # another number than its own
    car.samples.take(Message(Keys("car", "other"), "block", name, 8, blocks[8]))
    for payload in (b"", b"\xff", b"[" * 100_000):
        car.samples.take(Message(KEYS, "ledger", "", 0, payload))
        car.samples.take(Message(KEYS, "blocks", name, 0, payload, True))
    assert car.bus.asked == [(name, 0, 6)]
    assert not car.samples.whole
    body = b"".join(LENGTH.pack(len(one)) + one for one in blocks[:7])
    car.samples.take(Message(KEYS, "blocks", name, 0, body, True))
    car.samples.take(Message(KEYS, "answered", name, 0, b"", True))
    assert car.samples.whole
    found, whole = car.samples.blocks()[name], car.reader.blocks()[name]
    np.testing.assert_array_equal(found.values, whole.values[: len(found)])
    assert sensor_states({"sensors": {"imu": {"state": "stuck"}, "x": 7}}) == [
        {"name": "imu", "state": "stuck", "detail": ""}
    ]
    assert marks_set({"marks": [{"t_ns": 3_000_000_000, "text": "a\x1b"}, 7, {}]}, 0) == [{"text": "a", "seconds": 3.0}]


@pytest.mark.parametrize("cut_off", [0, 3])
def test_an_answer_that_was_cut_off_is_asked_for_again(log: Path, cut_off: int):
    """Wholly, or after three blocks; what never comes is asked for a few times only."""
    car, name = _Recording(log), "imu.accel"
    blocks = [block_to_bytes(block, number, "") for number, block in enumerate(_batches(car.reader.blocks()[name]))]
    car.samples.take(Message(KEYS, "block", name, 7, blocks[7]))
    for first, last in ((0, cut_off), (cut_off, 5)):
        body = b"".join(LENGTH.pack(len(one)) + one for one in blocks[first:last])
        car.samples.take(Message(KEYS, "blocks", name, first, body, True))
        car.samples.take(Message(KEYS, "answered", name, first, b"", True))
        assert not car.samples.whole
    for _ in range(ATTEMPTS):
        car.samples.take(Message(KEYS, "answered", name, 5, b"", True))
    assert car.bus.asked == [(name, 0, 6), (name, cut_off, 6), *[(name, 5, 6)] * ATTEMPTS]
    assert car.samples.whole
    # Blocks between two that are not there, and others than those asked for, are no sign that these will come.
    car.samples.take(Message(KEYS, "block", name, 13, blocks[13]))
    body = b"".join(LENGTH.pack(len(one)) + one for one in (b"", *blocks[9:12], b"", blocks[13], blocks[14]))
    for k in range(1 + ATTEMPTS):
        assert not car.samples.whole
        other = LENGTH.pack(len(blocks[20 + k])) + blocks[20 + k]
        car.samples.take(Message(KEYS, "blocks", name, 20 + k, other, True))
        car.samples.take(Message(KEYS, "blocks", name, 8, body, True))
        car.samples.take(Message(KEYS, "answered", name, 8, b"", True))
    assert car.samples.whole
    there = (*blocks[:5], blocks[7], *blocks[9:12], *blocks[13:15], *blocks[20 : 21 + ATTEMPTS])
    assert len(car.samples.blocks()[name]) == sum(len(block_from_bytes(one)[0]) for one in there)


def test_what_sensors_sent_before_they_fell_silent_is_asked_for(log: Path, monkeypatch: pytest.MonkeyPatch):
    """Channel by channel, as long as an answer has what was asked for; what is not there, a few times only."""
    monkeypatch.setattr("lacet.services.acquisition.live_samples.REQUEST", 5)
    car = _Recording(log)
    names = list(recorded_axes(car.reader.start))
    for _ in range(2):
        car.samples.take(Message(KEYS, "ledger", "", 0, b"{}"))
    assert car.bus.asked == [(names[0], 0, 4)]
    sent = {name: list(_batches(block)) for name, block in car.reader.blocks().items()}
    while not car.samples.whole:
        name, first, last = car.bus.asked[-1]
        part = list(enumerate(sent.get(name, [])))[first : last + 1]
        bodies = [block_to_bytes(block, number, "") for number, block in part]
        body = b"".join(LENGTH.pack(len(one)) + one for one in bodies)
        car.samples.take(Message(KEYS, "blocks", name, first, body, True))
        car.samples.take(Message(KEYS, "answered", name, first, b"", True))
    assert max(Counter(car.bus.asked).values()) <= ATTEMPTS
    found = car.samples.blocks()
    for name, block in car.reader.blocks().items():
        np.testing.assert_array_equal(found[name].values, block.values)
    assert car.samples.latest_ns == max(int(block.t_ns[-1]) for block in found.values())


def test_a_recording_whose_sensors_are_silent_is_heard(log: Path):
    """One that comes when nothing is sent any more does not say that there is no recording."""
    bus = _Bus()
    follower = LiveFollower(bus, model_of_study(None), 0.02)
    assert follower.turn(0.0) is None
    assert follower.state()["line"] == "no recording is heard yet"
    _Recording(log, bus.queue.append)
    assert follower.turn(0.0) is None
    assert follower.state()["line"] == "a recording is heard, but none of its sensors"


def test_a_later_run_takes_the_place_of_the_last(log: Path):
    """An earlier one is offered meanwhile, as runs are that no worker has."""
    car = _Recording(log)
    car.go_on(1.0)
    samples, begin = car.samples, car.begin
    for name, moved in (("earlier", -60), ("later", 60)):
        start = replace(car.reader.start, run_id=name, started_ns=begin + moved * 1_000_000_000)
        for kind, payload in (("alive", b""), ("start", start_to_bytes(start))):
            samples.take(Message(Keys("car", name), kind, "", 0, payload))
        assert samples.start is not None
        assert (samples.keys == KEYS) == (name == "earlier")
        assert samples.recording
        assert bool(samples.blocks()) == (name == "earlier")
    samples.take(Message(Keys("car", "later"), "gone", "", 0, b""))
    assert not samples.recording


def test_the_model_is_the_present_one_of_the_study(log: Path, tmp_path: Path):
    loaded = load([log], limits=RunLimits(end="4"))
    study = Study.create(tmp_path / "study", [log], [], loaded.rig, loaded.vehicle)
    empty = model_of_study(study.folder)(loaded.vehicle, "contact")
    assert empty == Model.of(base_model(loaded.vehicle, "contact"))
    study.record({}, "base model", {}).record({"anti_roll_bar.front": {}}, "added", {})
    found = model_of_study(study.folder, ("anti_roll_bar.rear",))(loaded.vehicle, "contact")
    assert [effect.key for effect in found.effects if not effect.base] == ["anti_roll_bar.front", "anti_roll_bar.rear"]
    with pytest.raises(UsageError, match="did you mean"):
        model_of_study(study.folder, ("anti_roll_bar.raer",))(loaded.vehicle, "contact")


def test_what_is_still_needed_is_said():
    assert still_needed(0.0, 0.01, 0.02) == "enough"
    assert still_needed(12.3, 0.01, 0.02) == "12 s more"
    assert still_needed(200.0, 0.01, 0.02) == "3 min more"
    assert still_needed(4e4, 0.01, 0.02) == "hours more"
    never = float("inf")
    assert still_needed(never, 0.038, 0.02) == "not by more of the same: ± 3.8 % at best"
    assert still_needed(never, 0.02031, 0.02) == "not by more of the same: ± 2.031 % at best"
    assert "over 100 %" in still_needed(never, 1.2, 0.02)
