"""Live fit: fed with the blocks of a log as the bus brings them, against `lacet identify` of the same seconds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lacet.daq.blocks import Block
from lacet.daq.bus.listener import BusListener, Message
from lacet.daq.bus.session import LENGTH, Keys
from lacet.daq.errors import RunError, UsageError
from lacet.daq.formats.log import LogReader, LogWriter
from lacet.daq.formats.wire import block_to_bytes, start_to_bytes
from lacet.daq.run_limits import RunLimits
from lacet.identify.effects.catalogue import base_model
from lacet.identify.regression.model import Model
from lacet.identify.regression.wls import fit
from lacet.identify.validation.parameter_estimates import estimates
from lacet.identify.validation.score import compare
from lacet.services.acquisition.live_samples import LiveSamples, marks_set, sensor_states
from lacet.services.render.live_fit import still_needed
from lacet.services.workspace import live_fit
from lacet.services.workspace.decode import decode_log
from lacet.services.workspace.live_fit import LiveFit, LiveResult
from lacet.services.workspace.live_follow import model_of_study
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

    def ask_blocks(self, keys: Keys, channel: str, first: int, last: int) -> None:
        self.asked.append((channel, first, last))


class _Recording:
    """A decoded log, whose blocks come to `samples` second by second."""

    def __init__(self, log: Path):
        self.reader = LogReader(log)
        self.begin = self.reader.start.started_ns
        self.bus = _Bus()
        self.samples = LiveSamples(self.bus)
        for kind, payload in (("alive", b""), ("start", start_to_bytes(self.reader.start))):
            self.samples.take(Message(KEYS, kind, "", 0, payload))
        self._blocks = {name: list(_batches(block)) for name, block in self.reader.blocks().items()}
        self._given = dict.fromkeys(self._blocks, 0)

    def go_on(self, seconds: float) -> None:
        """Bring what was recorded in the first seconds."""
        for name, blocks in self._blocks.items():
            while self._given[name] < len(blocks):
                number = self._given[name]
                if int(blocks[number].t_ns[-1]) - self.begin > 1e9 * seconds:
                    break
                self.samples.take(Message(KEYS, "block", name, number, block_to_bytes(blocks[number], number, "")))
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
    """The first 11 s of a capture, decoded."""
    folder = tmp_path_factory.mktemp("live")
    cut(SINUS, folder / "raw.mcap", 11.0)
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


def test_it_is_identify_of_the_same_seconds(log: Path, tmp_path: Path):
    car = _Recording(log)
    live = LiveFit(car.reader.start, model_of_study(None), 0.02)
    try:
        car.go_on(2.0)
        with pytest.raises(RunError, match="overlap"):
            live.update(car.samples, live.seconds_there(car.samples))
        car.go_on(9.06)
        seconds = live.seconds_there(car.samples)
        assert seconds == 9
        found = live.update(car.samples, seconds)
    finally:
        live.close()
    values, ratios = expected(car.written(tmp_path / "same.mcap"), seconds)
    assert found.from_scratch
    assert apart(found, values) < 1e-6
    assert {str(row): score.ratio for row, score in found.scores.items()} == pytest.approx(ratios, rel=1e-6)
    assert car.bus.asked == []


def test_sums_go_on_from_it_and_hardly_differ(log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The sums of 9 s go on for two more; a fit from scratch differs by its own draws of simulated noise, too."""
    monkeypatch.setattr(live_fit, "QUICK", 0.0)
    car = _Recording(log)
    live = LiveFit(car.reader.start, model_of_study(None), 0.02)
    try:
        car.go_on(9.06)
        live.update(car.samples, 9)
        car.go_on(10.06)
        live.update(car.samples, 10)
        car.go_on(11.0)
        seconds = live.seconds_there(car.samples)
        found = live.update(car.samples, seconds)
    finally:
        live.close()
    assert (found.from_scratch, found.since, found.seconds) == (False, 9.0, float(seconds))
    values, ratios = expected(car.written(tmp_path / "same.mcap"), seconds)
    close = [
        abs(one.value - values[one.name][0]) / values[one.name][1] for one in found.estimates if one.half_sheet > 0.0
    ]
    assert max(close) < 0.5
    assert np.median(close) < 0.05
    assert {str(row): score.ratio for row, score in found.scores.items()} == pytest.approx(ratios, rel=0.1)


def test_values_that_move_ask_for_a_fit_from_scratch(log: Path, monkeypatch: pytest.MonkeyPatch):
    for name, value in (("QUICK", 0.0), ("GROWTH", 1e9), ("LEAST_GROWTH", 1.0), ("MOVED", 0.0)):
        monkeypatch.setattr(live_fit, name, value)
    car = _Recording(log)
    live = LiveFit(car.reader.start, model_of_study(None), 0.02)
    try:
        for seconds in (9, 10):
            car.go_on(seconds + 0.06)
            live.update(car.samples, seconds)
        live.wait()
        found = live.update(car.samples, 10)
    finally:
        live.close()
    assert found.since == 10.0


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
    assert still_needed(0.0, 0.01) == "enough"
    assert still_needed(12.3, 0.01) == "12 s more"
    assert still_needed(200.0, 0.01) == "3 min more"
    assert still_needed(4e4, 0.01) == "hours more"
    assert still_needed(float("inf"), 0.038).startswith("not by more of the same: ± 3.8 % at best")
