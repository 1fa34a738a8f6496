"""A sensor sheet that states too much or too little noise: the measured noise takes its place, and it is told."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from lacet.daq.channels import CHANNELS
from lacet.daq.rig import Rig
from lacet.services.workspace.loading import Loaded, load
from tests.identify import cars

FILES = [cars.CAR / f"{name}.parquet" for name in ("sine", "rough")]
RIG = cars.reference_car()[1]
FAMILIES = tuple(dict.fromkeys(CHANNELS[c].family for sensor in RIG.sensors for c in sensor.channels))
JUDGED = ("wheel.force", "laser.hub", "imu.rate")


def loaded(factor: float, families: tuple[str, ...], folder: Path) -> Loaded:
    """The runs of the reference car with a rig whose sheet states `factor` times the noise of these families."""
    text = (cars.CAR / "rig.toml").read_text(encoding="utf-8")
    for family in families:
        text = re.sub(
            rf'("{re.escape(family)}" = )([-\d.e]+)(?=[ ,][^\n]*)',
            lambda found: f"{found[1]}{factor * float(found[2]):.6g}",
            text,
        )
    file = folder / "rig.toml"
    file.write_text(text, encoding="utf-8")
    return load(FILES, file, cars.CAR / "vehicle.toml")


def stated(rig: Rig, family: str) -> float:
    """σ of a family in a rig."""
    return rig.noise(next(name for name, channel in CHANNELS.items() if channel.family == family))


@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("families", [("laser.hub",), ("wheel.force",), FAMILIES], ids=["laser", "force", "all"])
def test_a_wrong_sheet_is_replaced_by_what_was_measured(
    factor: float, families: tuple[str, ...], tmp_path: Path
) -> None:
    """The equations use the true noise, tolerances stay; a sentence says which way the sheet is wrong."""
    found = loaded(factor, families, tmp_path)
    for run in found.prepared:
        used = run.recording.rig
        for family in JUDGED:
            assert stated(used, family) == pytest.approx(stated(RIG, family), rel=0.07), (run.name, family)
        assert [sensor.tolerance for sensor in used.sensors] == [sensor.tolerance for sensor in RIG.sensors]
    says = found.sheet
    assert any(line.startswith(f"noise of {families[0]} ") for line in says)
    assert all(("too large" if factor > 1 else "too small") in line for line in says)
    assert all("coloured noise" in line for line in says)


def test_a_right_sheet_stays_to_the_last_digit(tmp_path: Path) -> None:
    """Nothing is replaced, and nothing said."""
    found = loaded(1.0, FAMILIES, tmp_path)
    assert all(run.recording.rig is found.rig for run in found.prepared)
    assert not found.sheet


def test_what_a_road_adds_in_one_run_is_not_the_instruments(tmp_path: Path) -> None:
    """Wheel forces of one run that move up to the highest frequencies: the sheet stays, as the other run shows."""
    rng = np.random.default_rng(5)
    table = pq.read_table(FILES[1])
    for place, name in enumerate(table.column_names):
        if name.startswith("wheel.") and ".force." in name:
            loud = table[name].to_numpy() + rng.normal(0.0, 2.0 * stated(RIG, "wheel.force"), len(table))
            table = table.set_column(place, name, [loud])
    pq.write_table(table, tmp_path / "rough.parquet")
    rig, vehicle = cars.CAR / "rig.toml", cars.CAR / "vehicle.toml"
    both = load([FILES[0], tmp_path / "rough.parquet"], rig, vehicle)
    assert all(run.recording.rig is both.rig for run in both.prepared)
    assert not both.sheet
    alone = load([tmp_path / "rough.parquet"], rig, vehicle)
    assert any("too small" in line for line in alone.sheet)
