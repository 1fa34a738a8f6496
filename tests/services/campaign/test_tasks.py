"""Tasks of a campaign, without a cluster: what a run's sums are, that they are kept, and what is broken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lacet.daq.errors import UsageError
from lacet.daq.formats.exchange import write_table
from lacet.daq.formats.open_run import open_run
from lacet.identify.effects.catalogue import catalogue
from lacet.identify.regression.qr_accumulation import RunEquations
from lacet.identify.regression.sensitivity import ExpansionPoint
from lacet.identify.selection.laws.grammar import pool
from lacet.services.campaign import tasks
from lacet.services.campaign.ranking_tasks import PlainEffect
from lacet.services.campaign.run_reference import RunReference, Settings, references
from lacet.services.campaign.tasks import Broken, ColumnsAt, EquationsAt, NoiseAt, ScoresAt, SecondsAt, Survey
from tests.identify import cars
from tests.support.short_runs import CAR, write_short_runs

SETTINGS = Settings(
    rig=(CAR / "rig.toml").read_text(encoding="utf-8"), vehicle=(CAR / "vehicle.toml").read_text(encoding="utf-8"),
    wheel_reference="hub",
)  # fmt: skip
PLAIN = ColumnsAt(np.zeros(0))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run."""
    return write_short_runs(tmp_path_factory.mktemp("runs"), 1, 4.0)[0]


@pytest.fixture(scope="module")
def surveyed(run: Path) -> Survey:
    """The same, looked at."""
    found = tasks.survey(RunReference(str(run), "sine"), SETTINGS)
    assert isinstance(found, Survey)
    return found


def state(sums: RunEquations) -> EquationsAt:
    """Sensitivities at some parameters."""
    at = ExpansionPoint(np.full(SETTINGS.model().physics_size, 10.0))
    return EquationsAt(np.arange(40), at, np.eye(40), tuple(sums.triangles), np.zeros(0))


def test_a_survey_says_what_a_run_is(surveyed: Survey) -> None:
    """Content, length, wheel reference and vehicle."""
    assert len(surveyed.reference.digest) == 64
    assert surveyed.seconds == pytest.approx(4.0, abs=0.05)
    assert surveyed.wheel_reference == "hub"
    assert surveyed.vehicle == SETTINGS.vehicle


def test_a_broken_run_is_named(tmp_path: Path) -> None:
    """Neither a missing file nor one that is no run raises: both are named with their reason."""
    wrong = tmp_path / "wrong.parquet"
    wrong.write_bytes(b"no table")
    found = [tasks.survey(RunReference(str(p), p.stem), SETTINGS) for p in (wrong, tmp_path / "gone.mcap")]
    for one, name, why in zip(found, ("wrong", "gone"), ("wrong.parquet", "no such file"), strict=True):
        assert isinstance(one, Broken)
        assert list(one.runs) == [name]
        assert why in one.runs[name]
    named = [one.runs for one in found if isinstance(one, Broken)]
    assert tasks.merge([np.ones(2), *found], lambda parts: parts[0]) == Broken({**named[0], **named[1]})


def test_a_run_that_changes_under_way_is_broken(surveyed: Survey, tmp_path: Path) -> None:
    """A task compares the content with that of the survey."""
    other = replace(surveyed.reference, digest="0" * 64)
    found = tasks.reduce(other, SETTINGS, PLAIN)
    assert isinstance(found, Broken)
    assert "changed since" in found.runs["sine"]


def test_an_address_is_read_as_a_path_is(surveyed: Survey, run: Path) -> None:
    """The same sums from file://…, which is copied first."""
    pytest.importorskip("fsspec")
    away = replace(surveyed.reference, place=run.as_uri())
    one, other = (tasks.reduce(reference, SETTINGS, PLAIN) for reference in (surveyed.reference, away))
    for row, R in one.triangles.items():
        np.testing.assert_array_equal(R, other.triangles[row])
    gone = tasks.reduce(replace(away, place=f"{run.as_uri()}-gone.parquet"), SETTINGS, PLAIN)
    assert "cannot be read from there" in gone.runs["sine"]


def test_sums_are_kept_by_content(surveyed: Survey, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second time no run is read, and what is kept has the same bits; another state is made anew."""
    settings = replace(SETTINGS, store=str(tmp_path / "sums"))
    reads: list[str] = []
    read = tasks.read_run

    def counted(reference: RunReference, settings: Settings) -> Any:
        reads.append(reference.name)
        return read(reference, settings)

    monkeypatch.setattr(tasks, "read_run", counted)
    plain = tasks.reduce(surveyed.reference, settings, PLAIN)
    where = state(plain)
    sigma = dict.fromkeys(plain.triangles, 50.0)
    asked: Sequence[Any] = (
        PLAIN, where, NoiseAt(where, sigma, 2), SecondsAt(where, np.zeros(40), sigma),
        ScoresAt(np.full(86, 10.0), where.at, np.zeros(0), 3),
    )  # fmt: skip
    first = [tasks.reduce(surveyed.reference, settings, one) for one in asked]
    count = len(reads)
    again = [tasks.reduce(surveyed.reference, settings, one) for one in asked]
    assert len(reads) == count
    assert [tasks.digest_of(one) for one in first] == [tasks.digest_of(one) for one in again]
    moved = tasks.reduce(surveyed.reference, settings, replace(where, at=ExpansionPoint(np.full(86, 11.0))))
    assert len(reads) == count + 1
    assert tasks.digest_of(moved) != tasks.digest_of(first[1])


def test_the_seed_is_the_content(surveyed: Survey) -> None:
    """Noise drawn for a run is the same under any name and place, and another for another content."""
    sums = tasks.reduce(surveyed.reference, SETTINGS, PLAIN)
    asked = NoiseAt(state(sums), dict.fromkeys(sums.triangles, 50.0), 2)
    renamed = replace(surveyed.reference, name="other")
    tasks._kept.clear()
    one, other = (tasks.reduce(reference, SETTINGS, asked) for reference in (surveyed.reference, renamed))
    np.testing.assert_array_equal(one.slopes, other.slopes)
    assert renamed.seed != replace(renamed, digest="ab" * 32).seed


def test_names_are_distinct() -> None:
    """Runs of one name are called after their folders too; a run given twice is refused."""
    names = [one.name for one in references(["a/x.mcap", "b/x.mcap", "a/y.mcap", "s3://bucket/z.mcap"])]
    assert names == ["a-x.mcap", "b-x.mcap", "y", "z"]
    with pytest.raises(UsageError, match="twice"):
        references(["a.mcap", "a.mcap"])
    with pytest.raises(UsageError, match="no run"):
        references([])


@pytest.mark.parametrize("kind", ["suspension", "tyre", "chassis.fx"])
def test_a_law_of_no_catalogue_reaches_a_worker_as_its_line(kind: str) -> None:
    """With the place and the constants it is tried at; one of the catalogue is the worker's own."""
    vehicle, _ = cars.reference_car()
    known = catalogue(vehicle, "hub")
    for cls in pool(kind):
        first = cls("" if "." in kind else "rear", {name: 2.0 * grid[0] for name, grid in cls.grids.items()})
        found = PlainEffect.of(first).among(known)
        assert (found.key, dict(found.shape)) == (first.key, dict(first.shape))
        assert [row.text for row in found.line.rows] == [row.text for row in first.line.rows]
    bump = replace(known["bump_stop.rear"], shape={"gap": 0.0123})
    assert PlainEffect.of(bump).among(known) == bump


def test_a_run_with_a_channel_in_doubt_is_named_as_such(run: Path, surveyed: Survey, tmp_path: Path) -> None:
    """It stays in the campaign: gravity downwards, of a sensor with its z axis the other way."""
    assert surveyed.sound
    whole = open_run(run)
    accel = whole.signals["imu.accel"].values * np.array([1.0, 1.0, -1.0])
    write_table(whole.with_values({"imu.accel": accel}), turned := tmp_path / "turned.parquet")
    found = tasks.survey(RunReference(str(turned), "turned"), SETTINGS)
    assert isinstance(found, Survey)
    assert not found.sound
    assert any(line.startswith("turned: ") for line in found.warnings)
