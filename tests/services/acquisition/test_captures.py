"""The committed captures: whole, small, decoded the same whichever way, and leading to the expected results."""

from __future__ import annotations

import json
import subprocess
import sys
from collections import defaultdict
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lacet.daq.blocks import Block
from lacet.daq.channels import CHANNELS, STANDARD
from lacet.daq.formats.log import LogReader
from lacet.daq.formats.open_run import open_run
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.properties.whole_vehicle import NAMES, whole_vehicle
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.validation.noise_floor import floor_of
from lacet.identify.validation.score import compare, pooled_ratio
from lacet.services.acquisition.stream_decoder import Decoder, decode_frames
from lacet.services.commands.__main__ import main
from lacet.services.workspace.loading import load
from lacet.services.workspace.results import scores
from tests.support.places import HOME

LOGS = HOME / "replay_logs"
CAMPAIGNS = ("anti-roll-bars", "nothing-hidden")
CAPTURES = sorted(LOGS.glob("*/*.mcap"))
DURATION = 16.0
BATCH_NS = 70_000_000
FRAMES = {"can0": 12 * 500, "can1": 5 * 250, "serial0": 200, "udp0": 100}
"""Frames a second by bus: four wheels of three frames, four lasers and a Correvit, one record or datagram a sample."""


@cache
def expected(campaign: str) -> dict[str, Any]:
    """The committed expectations."""
    return json.loads((LOGS / campaign / "expected.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="session")
def decoded(tmp_path_factory: pytest.TempPathFactory) -> dict[Path, Path]:
    """The log that `lacet decode` makes of each capture."""
    folder = tmp_path_factory.mktemp("decoded")
    logs: dict[Path, Path] = {}
    for capture in CAPTURES:
        logs[capture] = folder / capture.parent.name / capture.name
        logs[capture].parent.mkdir(exist_ok=True)
        assert main(["decode", str(capture), "-o", str(logs[capture])]) == 0
    return logs


def same(a: Block, b: Block) -> bool:
    """Bit for bit."""
    if a.device_ns is None or b.device_ns is None:
        device = a.device_ns is b.device_ns
    else:
        device = np.array_equal(a.device_ns, b.device_ns)
    alike = np.array_equal(a.t_ns, b.t_ns) and np.array_equal(a.flags, b.flags)
    return bool(device and alike and np.array_equal(a.values, b.values, equal_nan=True))


def test_both_campaigns_are_there_and_small():
    assert {path.parent.name for path in CAPTURES} == set(CAMPAIGNS)
    for campaign in CAMPAIGNS:
        told = expected(campaign)
        assert sorted(told["used"] + told["held"]) == sorted(p.name for p in (LOGS / campaign).glob("*.mcap"))
    sizes = [path.stat().st_size for path in CAPTURES]
    assert max(sizes) < 5_000_000
    assert sum(sizes) < 40_000_000


@pytest.mark.parametrize("capture", CAPTURES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_a_capture_is_whole(capture: Path, decoded: dict[Path, Path]):
    raw, log = LogReader(capture), LogReader(decoded[capture])
    start, stop = raw.start, raw.stop
    assert stop is not None
    assert not raw.damage
    assert not any(any(causes.values()) for causes in stop.losses.values())
    assert (start.vehicle, start.wheel_reference) == ("peugeot-406", "contact")
    assert start.manoeuvre == capture.stem
    assert start.brakes == ("used" if capture.stem == "braking" else "off")
    assert Rig.parse(start.rig_text, str(capture)).name == "peugeot-406"
    assert len(Vehicle.parse(start.vehicle_text, str(capture)).corners) == 4
    for source, rate in FRAMES.items():
        assert len(raw.frames(source)) == stop.counts[source] == pytest.approx(rate * DURATION, abs=12)
    blocks = log.blocks()
    assert set(blocks) == set(STANDARD)
    for name, block in blocks.items():
        assert len(block) == pytest.approx(CHANNELS[name].rate * DURATION, abs=1)
        assert not np.any(block.flags)
        assert np.ptp(block.t_ns) / 1e9 == pytest.approx(DURATION, abs=0.02)
    assert not open_run(decoded[capture]).problems
    for secret in (b"anti_roll", b"hidden"):
        assert secret not in capture.read_bytes()


@pytest.mark.parametrize("capture", CAPTURES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_decoding_again_and_in_live_batches_gives_the_same_blocks(capture: Path, decoded: dict[Path, Path]):
    raw = LogReader(capture)
    written = LogReader(decoded[capture]).blocks()
    frames = [raw.frames(source) for source in raw.sources()]
    again = decode_all(raw)
    live = Decoder(Rig.parse(raw.start.rig_text, str(capture)), raw.start.documents)
    parts: dict[str, list[Block]] = defaultdict(list)
    edges = np.arange(raw.start.started_ns, max(int(f.t_ns[-1]) for f in frames) + 2 * BATCH_NS, BATCH_NS)
    cuts = [np.searchsorted(batch.t_ns, edges) for batch in frames]
    for i in range(len(edges) - 1):
        for batch, cut in zip(frames, cuts, strict=True):
            for block in live.feed(batch[int(cut[i]) : int(cut[i + 1])]):
                parts[block.channel].append(block)
    for block in live.finish():
        parts[block.channel].append(block)
    assert not live.losses()
    assert set(written) == set(again) == set(parts)
    for name, block in written.items():
        assert same(block, again[name]), name
        assert same(block, Block.concat(parts[name])), name


def test_decoding_twice_gives_the_same_bytes(decoded: dict[Path, Path], tmp_path: Path):
    capture = CAPTURES[0]
    assert main(["decode", str(capture), "-o", str(tmp_path / capture.name)]) == 0
    assert (tmp_path / capture.name).read_bytes() == decoded[capture].read_bytes()


def decode_all(raw: LogReader) -> dict[str, Block]:
    """In memory, with the recorded rig and documents."""
    rig = Rig.parse(raw.start.rig_text, str(raw.path))
    return decode_frames(Decoder(rig, raw.start.documents), [raw.frames(source) for source in raw.sources()])


def drives(campaign: str, decoded: dict[Path, Path]) -> tuple[Vehicle, dict[str, PreparedRun]]:
    told = expected(campaign)
    loaded = load([decoded[LOGS / campaign / name] for name in told["used"] + told["held"]])
    assert not loaded.warnings
    return loaded.vehicle, {f"{drive.name}.mcap": drive for drive in loaded.prepared}


def check_parameters(fitted: Fit, vehicle: Vehicle, told: dict[str, Any]) -> None:
    for name, entry in told["parameters"].items():
        assert fitted.value(name) == pytest.approx(entry["value"], abs=entry["tolerance"]), name
    whole = whole_vehicle(fitted, vehicle)
    assert whole is not None
    for name, entry in told["whole_vehicle"].items():
        assert whole.determined[NAMES.index(name)]
        assert whole.values[NAMES.index(name)] == pytest.approx(entry["value"], abs=entry["tolerance"]), name


@pytest.mark.parametrize("campaign", [CAMPAIGNS[0], pytest.param(CAMPAIGNS[1], marks=pytest.mark.slow)])
def test_the_expected_model_fits_and_predicts(campaign: str, decoded: dict[Path, Path]):
    told, (vehicle, by_name) = expected(campaign), drives(campaign, decoded)
    known, base = catalogue(vehicle, "contact"), Model.of(base_model(vehicle, "contact"))
    model, bounds = base, told["residual_to_floor"]
    for key in told["added"]:
        model = model + known[key]
    used, held = ([by_name[name] for name in told[part]] for part in ("used", "held"))
    fitted = fit(model, used)
    check_parameters(fitted, vehicle, told)
    comparisons = [compare(fitted, drive, 12) for drive in held]
    for comparison in comparisons:
        for row, score in comparison.scores.items():
            assert score.ratio < bounds["held_at_most"], f"{comparison.name} {row}"
    assert pooled_ratio(scores(comparisons)) < bounds["overall_at_most"]
    if told["added"]:
        plain = fit(base, used, FitOptions(unbias=False))  # what noise does to it is nothing beside what it lacks
        before = pooled_ratio(scores([compare(plain, drive, 4) for drive in held]))
        assert before > bounds["base_model_held_overall_at_least"]


@pytest.mark.slow
@pytest.mark.parametrize("campaign", CAMPAIGNS)
def test_what_is_hidden_is_named_and_nothing_else(campaign: str, decoded: dict[Path, Path]):
    told, (vehicle, by_name) = expected(campaign), drives(campaign, decoded)
    known, model = catalogue(vehicle, "contact"), Model.of(base_model(vehicle, "contact"))
    candidates = [effect for effect in known.values() if not effect.base]
    added: list[str] = []
    while True:
        fitted = fit(model, [by_name[name] for name in told["used"]])
        diagnosis = diagnose(fitted, floor_of(fitted, 99), candidates)
        if diagnosis.best is None or len(added) > len(told["added"]):
            break
        added.append(diagnosis.best.key)
        model = model + known[diagnosis.best.key]
    assert added == told["added"]
    assert diagnosis.verdict == told["verdict"]
    assert max(diagnosis.ratios.values()) < told["residual_to_floor"]["used_at_most"]


@pytest.mark.slow
def test_the_script_makes_them_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("mujoco")
    monkeypatch.setenv("LACET", f"{sys.executable} -m lacet")
    monkeypatch.setenv("PYTHONPATH", str(HOME))
    subprocess.run(["sh", str(LOGS / "make.sh"), str(tmp_path)], check=True)
    for capture in CAPTURES:
        made, kept = LogReader(tmp_path / capture.parent.name / capture.name), LogReader(capture)
        for source in kept.sources():
            a, b = made.frames(source), kept.frames(source)
            assert np.array_equal(a.t_ns, b.t_ns)
            assert np.array_equal(a.ident, b.ident)
        first, second = decode_all(made), decode_all(kept)
        for name, block in second.items():  # another processor may round an encoder's last bit the other way
            assert np.max(np.abs(first[name].values - block.values)) < 0.1 * CHANNELS[name].noise
