"""A run in several files: nothing is lost at a seam, and every command reads them as the one run that they are."""

from __future__ import annotations

import re
import shutil
import threading
from pathlib import Path

import numpy as np
import pytest

from lacet.daq.errors import UsageError
from lacet.daq.formats.log import LogReader, LogWriter, StartRecord, recover
from lacet.daq.formats.open_run import open_run
from lacet.daq.formats.run_files import files_of_run, first_files
from lacet.daq.rig import Rig
from lacet.identify.effects.catalogue import base_model
from lacet.identify.regression.model import Model
from lacet.identify.regression.wls import fit
from lacet.services.acquisition.host_clock import HostClock
from lacet.services.acquisition.recorder import Recorder
from lacet.services.acquisition.run_log import RunLog, Split
from lacet.services.acquisition.stream_decoder import Decoder
from lacet.services.cache.keys import run_digest
from lacet.services.workspace.decode import decode_log
from lacet.services.workspace.loading import load
from tests.support.correvit_wire import CorrevitWire
from tests.support.processes import ROOT

from .test_log_medium import RIG, T0

CAPTURE = ROOT / "replay_logs" / "anti-roll-bars" / "sinus.mcap"


def split_log(whole: Path, out: Path, split: Split) -> list[Path]:
    """The log recorded again in several files, by a clock that shows the messages' times."""
    reader = LogReader(whole)
    now = [reader.start.started_ns]
    clock = HostClock(wall=lambda: now[0], monotonic=lambda: now[0])
    axes = {name: s.axes for s in Rig.parse(reader.start.rig_text, "rig").sensors for name in s.channels}
    log = RunLog(LogWriter(out, reader.start, axes=axes), axes, lambda text: None, clock, split=split)
    log.start()
    for log_ns, item in reader.messages():
        now[0] = max(now[0], log_ns)
        log.store(item)
        log.tick(dict)
    log.close("stopped", {})
    assert log.error is None
    return log.paths


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Path]]:
    """A run in one file, and in files of 5 s."""
    folder = tmp_path_factory.mktemp("run")
    decode_log(CAPTURE, folder / "run.mcap")
    (folder / "split").mkdir()
    return folder / "run.mcap", split_log(folder / "run.mcap", folder / "split" / "run.mcap", Split(seconds=5.0))


def test_a_split_run_has_the_bytes_of_an_unsplit_one(run: tuple[Path, list[Path]]):
    whole, files = run
    assert [file.name for file in files] == ["run.mcap", "run-2.mcap", "run-3.mcap", "run-4.mcap"]
    one, several = LogReader(whole), LogReader(files[0])
    assert several.damage == []
    assert several.start == one.start
    assert list(several.block_messages()) == list(one.block_messages())
    for source in one.sources():
        a, b = one.frames(source), several.frames(source)
        np.testing.assert_array_equal(a.t_ns, b.t_ns)
        np.testing.assert_array_equal(a.data, b.data)
    assert one.manifest is not None
    assert several.manifest is not None
    # Number and checksum of all messages of each channel and bus: they are numbered on over the seams.
    assert several.manifest.channels == one.manifest.channels
    assert several.manifest.sources == one.manifest.sources
    assert several.stop is not None
    assert one.stop is not None
    assert several.stop.counts == one.stop.counts


def test_every_reading_gives_the_same_run(run: tuple[Path, list[Path]], tmp_path: Path):
    whole, files = run
    one, several = LogReader(whole), LogReader(files[2])  # whichever is named
    a, b = one.blocks(), several.blocks()
    assert a.keys() == b.keys()
    first, last = one.span("can0")
    assert several.span("can0") == (first, last)
    between = first + 4_900_000_000, first + 5_100_000_000  # over a seam
    for name, block in one.blocks(["wheel.fl.force"], between).items():
        np.testing.assert_array_equal(several.blocks([name], between)[name].t_ns, block.t_ns)
        assert len(block) > 10
    read, expected = open_run(files[2]), open_run(whole)
    assert read.problems == expected.problems
    assert read.name == "run"
    for name, signal in expected.signals.items():
        np.testing.assert_array_equal(read.signals[name].t, signal.t)
        np.testing.assert_array_equal(read.signals[name].values, signal.values)
    decode_log(files[0], tmp_path / "again.mcap")
    assert LogReader(tmp_path / "again.mcap").start.extra == one.start.extra
    assert list(LogReader(tmp_path / "again.mcap").block_messages()) == list(one.block_messages())
    assert recover(files[0], tmp_path / "recovered.mcap") == []
    assert list(LogReader(tmp_path / "recovered.mcap").block_messages()) == list(one.block_messages())
    assert run_digest(files[0]) != run_digest(whole)  # of all files: one that changes is seen


def test_its_fit_is_that_of_the_unsplit_run(run: tuple[Path, list[Path]]):
    whole, files = run
    fits = []
    for given in ([whole], files):  # as a shell gives run*.mcap
        loaded = load(given)
        assert len(loaded.prepared) == 1
        fits.append(fit(Model.of(base_model(loaded.vehicle, loaded.reference)), loaded.prepared))
    np.testing.assert_array_equal(fits[0].theta, fits[1].theta)
    np.testing.assert_array_equal(fits[0].covariance, fits[1].covariance)


@pytest.mark.parametrize(
    ("lose", "told"),
    [
        (0, "file 1 of the run is missing"),
        (1, "file 2 of the run is missing"),
        (3, "the run goes on in run-4.mcap, which is missing"),
    ],
)
def test_a_file_that_is_missing_is_told(run: tuple[Path, list[Path]], tmp_path: Path, lose: int, told: str):
    files = [Path(shutil.copy(file, tmp_path)) for file in run[1]]
    files.pop(lose).unlink()
    found = LogReader(files[0])
    assert any(told in line for line in found.damage)
    assert len(found.files) == 3
    if lose < 3:
        (line,) = [line for line in found.damage if "are missing" in line]  # one hole of all topics
        assert re.match(r"/raw/\w+, .*: \d+( to \d+)? of ", line)


def test_a_file_of_another_run_is_never_taken_for_a_part(run: tuple[Path, list[Path]], tmp_path: Path):
    whole, files = run
    for name, source in {"run.mcap": whole, "run-2.mcap": whole, "run-3.mcap": CAPTURE, "run-x.mcap": files[1]}.items():
        shutil.copy(source, tmp_path / name)
    assert files_of_run(tmp_path / "run.mcap") == {1: tmp_path / "run.mcap"}
    assert files_of_run(tmp_path / "run-2.mcap") == {1: tmp_path / "run-2.mcap"}
    given = [tmp_path / name for name in ("run.mcap", "run-2.mcap", "run-3.mcap")]
    assert first_files(given) == given
    assert first_files([files[1], *given, files[2]]) == [files[1], *given]  # the third stands in the second's run


class Seconds(HostClock):
    """A clock that is ten times as fast."""

    def now_ns(self) -> int:
        return T0 + 10 * (super().now_ns() - T0)


@pytest.mark.parametrize(("split", "least"), [(Split(seconds=3.0), 3), (Split(size=12_000.0), 2)], ids=["time", "size"])
def test_a_recording_that_is_split_loses_nothing(tmp_path: Path, split: Split, least: int):
    wire, rig = CorrevitWire(), Rig.parse(RIG)
    (tmp_path / "run-2.mcap").write_bytes(b"somebody's file")  # is passed over, and kept
    log = LogWriter(tmp_path / "run.mcap", StartRecord("r", T0, "", rig.text))
    told: list[str] = []
    recorder = Recorder([wire], Decoder(rig), log, notify=told.append, clock=Seconds(), split=split)
    summary = recorder.run(threading.Event(), duration=1.2)
    assert len(summary.files) >= least
    assert [file.name for file in summary.files[:2]] == ["run.mcap", "run-3.mcap"]
    whole = LogReader(tmp_path / "run.mcap")
    assert whole.damage == []
    assert whole.files == dict(enumerate(summary.files, 1))
    assert len(whole.frames("can0")) == wire.sent
    assert len(whole.blocks()["correvit.speed"]) == wire.sent
    assert summary.losses == {}
    assert whole.manifest is not None
    assert whole.manifest.channels == summary.tallies
    assert sum("recording goes on in" in line for line in told) == len(summary.files) - 1
    assert (tmp_path / "run-2.mcap").read_bytes() == b"somebody's file"


@pytest.mark.parametrize(
    ("text", "split"),
    [
        ("10min", Split(seconds=600.0)),
        ("90 s", Split(seconds=90.0)),
        ("1h", Split(seconds=3600.0)),
        ("1GB", Split(size=1e9)),
        ("1.5GB", Split(size=1.5e9)),
        ("500MB", Split(size=5e8)),
    ],
)
def test_what_a_split_can_be(text: str, split: Split):
    assert Split.parse(text) == split


@pytest.mark.parametrize("text", ["10", "min", "0s", "0.5s", "1kB", "0.1MB", "10 minutes", "-1h"])
def test_what_a_split_cannot_be_is_refused_with_an_example(text: str):
    with pytest.raises(UsageError, match="for example 10min or 1GB"):
        Split.parse(text)
