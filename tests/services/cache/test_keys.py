"""What is in a key: the content of what a value is made of, and the sources of the rooms that make it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from lacet.services.cache import keys
from lacet.services.cache.keys import ROOMS, run_digests
from tests.support.places import HOME

ASKED = """
import os, sys
from lacet.identify.effects.catalogue import effect_classes
from lacet.services.cache.keys import key_of
every = effect_classes()
model = [every["body"], every["spring"], every["coulomb"]]
for line in sys.stdin:
    if os.fork() == 0:  # nothing that an earlier question left in memory
        print(key_of("regression", model), key_of("validation", model), key_of("selection", None), flush=True)
        os._exit(0)
    os.wait()
"""


def test_the_rooms_are_those_of_the_contract() -> None:
    contracts = tomllib.loads((HOME / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    (layers,) = (c["layers"] for c in contracts if c["name"] == "the rooms of identify, top to bottom")
    assert tuple(layer.rpartition(".")[2] for layer in reversed(layers) if "progress" not in layer) == ROOMS


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of lacet's sources."""
    folder = tmp_path_factory.mktemp("sources")
    shutil.copytree(HOME / "lacet", folder / "lacet", symlinks=True)
    for name in ("daq", "drivers", "identify", "services", "simulate"):
        shutil.copytree(HOME / name, folder / name, ignore=shutil.ignore_patterns("__pycache__", "static"))
    return folder


@pytest.fixture(scope="module")
def asked(sources: Path) -> Iterator[Callable[[], tuple[str, ...]]]:
    """Gives the keys of a fit, a floor and a ranking, as a fresh process on these sources makes them."""
    with subprocess.Popen(
        [sys.executable, "-c", ASKED], cwd=sources, env={**os.environ, "PYTHONPATH": str(sources)}, text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    ) as process:  # fmt: skip
        assert process.stdin is not None
        assert process.stdout is not None
        questions, answers = process.stdin, process.stdout

        def ask() -> tuple[str, ...]:
            print("keys", file=questions, flush=True)
            return tuple(answers.readline().split())

        yield ask
        questions.close()


def test_a_change_of_the_sources_drops_what_it_concerns_and_nothing_else(
    sources: Path, asked: Callable[[], tuple[str, ...]]
) -> None:
    before = asked()
    assert len(set(before)) == 3

    def after(name: str) -> list[bool]:
        file = sources / name
        text = file.read_text(encoding="utf-8")
        file.write_text(text + "\n# a change\n", encoding="utf-8")
        found = asked()
        file.write_text(text, encoding="utf-8")
        return [one == other for one, other in zip(before, found, strict=True)]

    assert after("identify/effects/suspension/stops.py") == [True, True, False], "an effect that is not in the model"
    assert after("identify/effects/suspension/coulomb.py") == [False, False, False], "an effect that is"
    assert after("identify/effects/suspension/linear_suspension.py") == [False, False, False], "and what it imports"
    latency = "identify/effects/sensors/sensor_latency.py"
    assert after(latency) == [False, False, False], "an effect that regression itself uses"
    assert after("identify/car/kinematics.py") == [False, False, False]
    assert after("daq/rig.py") == [False, False, False]
    assert after("identify/validation/score.py") == [True, False, False]
    assert after("identify/selection/diagnose.py") == [True, True, False]
    assert after("identify/design/run_ranking.py") == [True, True, True]
    assert after("services/workbench/server.py") == [True, True, True]
    assert asked() == before


def test_a_run_is_read_once_and_known_by_its_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[Path] = []
    content = keys.run_digest

    def counted(run: Path) -> str:
        read.append(run)
        return content(run)

    monkeypatch.setattr(keys, "run_digest", counted)
    study, one, other = tmp_path / "study", tmp_path / "one.parquet", tmp_path / "other.parquet"
    study.mkdir()
    one.write_bytes(b"abc")
    other.write_bytes(b"abc")
    first = run_digests(study, [one, other])
    assert first[0] == first[1], "the content counts, not the name"
    assert run_digests(study, [one, other]) == first
    assert len(read) == 2
    one.write_bytes(b"abd")
    assert run_digests(study, [one])[0] != first[0]
    (study / ".cache" / "runs.json").write_text('{"damaged')
    assert run_digests(study, [other]) == [first[1]]
    assert run_digests(study, [tmp_path / "gone.parquet", other, other]) == ["", first[1], first[1]]


@pytest.mark.parametrize("damage", ['{"damaged', "[]", '{"%s": [1]}', '{"%s": null}'])
def test_a_damaged_memory_is_written_anew(tmp_path: Path, damage: str) -> None:
    run = tmp_path / "run.parquet"
    run.write_bytes(b"abc")
    before = run_digests(tmp_path, [run])
    memory = tmp_path / ".cache" / "runs.json"
    memory.write_text(damage.replace("%s", str(run.resolve())))
    assert run_digests(tmp_path, [run]) == before
