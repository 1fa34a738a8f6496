"""MDF files: what another system recorded comes in with its names, units and signs, or is refused with a remedy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from asammdf import MDF
from asammdf import Signal as MdfSignal

from lacet.daq.errors import RunError
from lacet.daq.formats.open_run import open_run

T = np.arange(200) * 0.004 + 3.0
WAVE = {axis: np.sin(2.0 * T + k) for k, axis in enumerate("xyz")}
MAP = """
format = "lacet-mf4 1"
[run]
manoeuvre = "slalom"
brakes = "off"
[channels]
wheel.fl.force.x = "Fx"
wheel.fl.force.y = { name = "Fy", scale = -1.0 }
wheel.fl.force.z = "Fz"
"""


def write(file: Path, *groups: list[MdfSignal]) -> Path:
    """An MDF file with these groups."""
    mdf = MDF(version="4.10")
    for group in groups:
        mdf.append(group)
    mdf.save(file, overwrite=True)
    mdf.close()
    return file


def force(unit: str = "kN", names: str = "xyz") -> list[MdfSignal]:
    """A wheel's forces under another system's names."""
    return [MdfSignal(WAVE[axis], T, name=f"F{axis}", unit=unit) for axis in names]


def test_mapped_channels_come_in_si_with_signs_and_stamps(tmp_path: Path):
    write(tmp_path / "run.mf4", force(), [MdfSignal(T, T, name="gear")])
    (tmp_path / "run.toml").write_text(MAP)
    run = open_run(tmp_path / "run.mf4")
    assert (run.manoeuvre, run.brakes, run.problems) == ("slalom", "off", ())
    assert list(run.signals) == ["wheel.fl.force"]
    one = run.signals["wheel.fl.force"]
    np.testing.assert_allclose(one.t, T - T[0], atol=1e-12)
    np.testing.assert_allclose(one.values, 1e3 * np.stack([WAVE["x"], -WAVE["y"], WAVE["z"]], axis=1))
    assert np.all(one.usable)


def test_our_own_names_need_no_map(tmp_path: Path):
    own = [MdfSignal(WAVE["x"], T, name="laser.rr.hub", unit="mm"), MdfSignal(WAVE["y"], T, name="laser.rr.ground")]
    run = open_run(write(tmp_path / "run.mf4", own))
    np.testing.assert_allclose(run.signals["laser.rr.hub"].values[:, 0], 1e-3 * WAVE["x"])
    assert run.problems == ("without a unit, taken as SI: laser.rr.ground",)


def test_channels_keep_their_own_time_bases(tmp_path: Path):
    slow = T[::5]
    run = open_run(
        write(
            tmp_path / "run.mf4",
            [MdfSignal(WAVE["x"], T, name="laser.rr.hub", unit="m")],
            [MdfSignal(WAVE["y"][::5], slow + 0.1, name="camera.fl.steer", unit="deg")],
        )
    )
    np.testing.assert_allclose(run.signals["camera.fl.steer"].t, slow + 0.1 - T[0], atol=1e-12)
    np.testing.assert_allclose(run.signals["camera.fl.steer"].values[:, 0], np.deg2rad(WAVE["y"][::5]))
    assert len(run.signals["laser.rr.hub"].t) == 200


def test_a_component_with_other_stamps_is_interpolated_and_said(tmp_path: Path):
    fine = np.linspace(T[0], T[-1], 2001)
    write(tmp_path / "run.mf4", force(names="xy"), [MdfSignal(np.sin(2.0 * fine + 2), fine, name="Fz", unit="N")])
    (tmp_path / "mf4.toml").write_text(MAP)
    run = open_run(tmp_path / "run.mf4")
    np.testing.assert_allclose(run.signals["wheel.fl.force"].values[:, 2], WAVE["z"], atol=1e-5)
    assert run.problems == ("wheel.fl.force.z has other stamps than wheel.fl.force.x and was interpolated",)


def test_samples_marked_invalid_are_flagged(tmp_path: Path):
    bad = np.zeros(200, bool)
    bad[40:50] = True
    one = MdfSignal(WAVE["x"], T, name="laser.rr.hub", unit="m", invalidation_bits=bad)
    run = open_run(write(tmp_path / "run.mf4", [one]))
    np.testing.assert_array_equal(run.signals["laser.rr.hub"].usable, ~bad)


def test_a_name_in_two_groups_needs_the_group(tmp_path: Path):
    file = write(tmp_path / "run.mf4", force("N"), [MdfSignal(-WAVE["x"], T, name="Fx", unit="N")])
    (tmp_path / "run.toml").write_text(MAP)
    with pytest.raises(RunError, match=r"'Fx' is in groups 0, 1: say which in the map \(group = …\)"):
        open_run(file)
    (tmp_path / "run.toml").write_text(MAP.replace('"Fx"', '{ name = "Fx", group = 1 }'))
    np.testing.assert_allclose(open_run(file).signals["wheel.fl.force"].values[:, 0], -WAVE["x"])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("wheel.fl.force.x", "wheel.fl.force.w"), "channels.wheel.fl.force.w: is not a channel; did you mean"),
        (('"Fx"', '{ name = "Fx", unit = "blorp" }'), "channels.wheel.fl.force.x.unit: unit 'blorp' is not known"),
        (('"Fx"', "3"), 'write "NAME" or'),
        (('"Fx"', '{ name = "Fx", scale = "two" }'), "channels.wheel.fl.force.x.scale: must be a finite number"),
        (('"Fx"', '{ name = "Fx", group = -1 }'), "must be the number of a group"),
        (("lacet-mf4 1", "lacet-mf4 7"), "format"),
        (('"off"', '"on"'), "run.brakes: must be one of off, used, unknown"),
    ],
)
def test_faults_of_the_map_are_told(tmp_path: Path, change: tuple[str, str], says: str):
    file = write(tmp_path / "run.mf4", force())
    (tmp_path / "run.toml").write_text(MAP.replace(*change))
    with pytest.raises(RunError) as caught:
        open_run(file)
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("unit", "says"), [("mm", "its unit is mm, wanted is N"), ("zorkmid", "unit 'zorkmid' is not known")]
)
def test_a_wrong_unit_is_never_taken(tmp_path: Path, unit: str, says: str):
    file = write(tmp_path / "run.mf4", force(unit), [MdfSignal(T, T, name="laser.rr.hub", unit="m")])
    (tmp_path / "run.toml").write_text(MAP)
    run = open_run(file)
    assert list(run.signals) == ["laser.rr.hub"]
    assert says in run.problems[0]


def test_a_file_without_our_channels_says_what_it_has_and_what_to_do(tmp_path: Path):
    with pytest.raises(RunError, match=r"it has Fx, Fy, Fz: write a map, run.toml or mf4.toml"):
        open_run(write(tmp_path / "run.mf4", force()))


@pytest.mark.parametrize("part", [0.0, 0.0005, 0.02, 0.3, 0.7, 0.95])
def test_a_file_cut_short_is_refused(tmp_path: Path, part: float, capfd: pytest.CaptureFixture[str]):
    """Its index is at the end: nothing can be read without it."""
    whole = write(tmp_path / "whole.mf4", [MdfSignal(WAVE["x"], T, name="laser.rr.hub", unit="m")]).read_bytes()
    (tmp_path / "run.mf4").write_bytes(whole[: int(part * len(whole))])
    with pytest.raises(RunError, match=r"no MDF file|cannot be read as MDF|cannot be read|no channel"):
        open_run(tmp_path / "run.mf4")
    assert "Traceback" not in capfd.readouterr().err
