"""Every kind of log, from the raw file to a row's residual or a channel as it is plotted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lacet.daq.errors import RunError
from lacet.daq.formats.open_run import open_run
from lacet.daq.maps.channel_map import ChannelMap
from lacet.daq.sources.open_source import open_source
from lacet.daq.sources.source import Reading, read_all
from lacet.identify.effects.catalogue import base_model
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensitivity import residual
from lacet.identify.regression.wls import Fit, fit
from lacet.services.workspace.import_log import import_logs
from tests.identify import cars
from tests.support.foreign_logs import BUS_WRITERS, MAP_HEAD, WRITERS, foreign, read_candump, units_of
from tests.support.places import HOME
from tests.support.tables import piece

VEHICLE, RIG = cars.reference_car()
CAN = HOME / "tests" / "data" / "can"
ROW = "suspension.fl"


@pytest.fixture(scope="module")
def reference() -> tuple[Fit, np.ndarray]:
    """A fit to some seconds of the car's own table, and its residual of a row."""
    drive = PreparedRun.of(piece("sine", 5.0, 11.0), VEHICLE, RIG)
    fitted = fit(Model.of(base_model(VEHICLE, "hub")), [drive])
    return fitted, _residual(fitted, drive)


def _residual(fitted: Fit, drive: PreparedRun) -> np.ndarray:
    found = residual(drive.motion, fitted.model.physics, fitted.physics)
    return next(values for row, values in found.items() if str(row) == ROW)


@pytest.mark.parametrize("kind", list(WRITERS))
def test_a_row_s_residual_is_that_of_the_car_s_own_table(
    kind: str, tmp_path: Path, reference: tuple[Fit, np.ndarray]
) -> None:
    """Other names, units, signs and a potentiometer instead of the hub laser; imported, read and compared."""
    name, write = WRITERS[kind]
    run = piece("sine", 5.0, 11.0)
    t, columns, channels = foreign(run)
    has_units = write(tmp_path / name, t, columns)
    text = MAP_HEAD + ("" if has_units else units_of(columns)) + channels
    map_ = ChannelMap.parse(text, "car.map.toml", tmp_path)
    found = import_logs([tmp_path / name], map_, tmp_path / "imported.mcap")
    assert len(found["samples"]) == len(run.signals)
    imported = open_run(tmp_path / "imported.mcap")
    for channel, signal in run.signals.items():
        got = imported.signals[channel]
        np.testing.assert_allclose(got.t, signal.t - signal.t[0], atol=2e-7)
        np.testing.assert_allclose(got.values, signal.values, rtol=1e-7, atol=1e-9, err_msg=channel)
    assert imported.wheel_reference == "hub"
    assert imported.rig_text == RIG.text
    fitted, expected = reference
    got = _residual(fitted, PreparedRun.of(imported, VEHICLE, RIG))
    assert len(got) == len(expected)
    # The grid begins at another fraction of a step: the same motion, read at most one step apart.
    assert np.std(got) == pytest.approx(np.std(expected), rel=0.02)
    assert np.std(expected) > 10.0


@pytest.mark.parametrize("kind", list(BUS_WRITERS))
def test_a_bus_log_of_any_tool_gives_the_channels_of_the_candump(kind: str, tmp_path: Path) -> None:
    """A real car's frames in the forms of four tools, decoded with its DBC and drawn."""
    name, write = BUS_WRITERS[kind]
    frames = read_candump(CAN / "road-car.candump.log")
    write(tmp_path / name, frames)
    text = f"""
format = "lacet-map 1"
[read]
dbc = "{CAN / "road-car.dbc"}"
[channels]
"car.yaw_rate" = "GYRO_YAW"
"steering.angle" = "ID_D0.STEER_ANGLE"
"wheel.fl.speed" = "WS_FL / 0.31 m"
"""
    run = open_run(tmp_path / name, ChannelMap.parse(text, "map", tmp_path))
    steer = [int.from_bytes(d[:2], "little", signed=True) * 0.1 for _, i, d in frames if i == 0x0D0]
    np.testing.assert_allclose(run.signals["steering.angle"].values[:, 0], np.deg2rad(steer), atol=1e-12)
    speed = [int.from_bytes(d[:2], "little") * 0.0155168902 / 0.31 for _, i, d in frames if i == 0x0D4]
    np.testing.assert_allclose(run.signals["wheel.fl.speed"].values[:, 0], speed, rtol=1e-12)
    stamps = np.array([t for t, i, _ in frames if i == 0x0D0])
    np.testing.assert_allclose(np.diff(run.signals["car.yaw_rate"].t), np.diff(stamps), atol=2e-4)
    assert not any("left out" in problem for problem in run.problems)


def test_a_canedge_s_raw_bus_log_is_decoded() -> None:
    """A real logger's MDF file of undecoded frames: gravity, rates and a speed of the module."""
    source = open_source(CAN / "canedge-gps-imu.mf4", Reading(dbc=(CAN / "canmod-gps.dbc",)))
    found = read_all(source, [f"gnss_imu.Acceleration{axis}" for axis in "XYZ"] + ["gnss_speed.Speed"])
    size = np.sqrt(sum(found[f"gnss_imu.Acceleration{axis}"].values ** 2 for axis in "XYZ"))
    assert np.median(size) == pytest.approx(9.81, rel=0.1)
    assert len(size) > 500
    assert source.listed["gnss_imu.AngularRateZ"].unit == "deg/s"
    assert any("identifiers are not in the DBC" in note for note in source.notes)


def test_its_channels_are_plotted_with_a_map(tmp_path: Path) -> None:
    """What the workbench draws of a raw bus log beside which a map lies."""
    from lacet.services.workbench.run_channels import RunChannels

    for name in ("canedge-gps-imu.mf4", "canmod-gps.dbc"):
        (tmp_path / name).write_bytes((CAN / name).read_bytes())
    (tmp_path / "map.toml").write_text("""
format = "lacet-map 1"
[read]
dbc = "canmod-gps.dbc"
[channels]
"imu.accel.x" = "AccelerationX"
"imu.accel.y" = "AccelerationY"
"imu.accel.z" = "AccelerationZ"
"gnss.speed" = "gnss_speed.Speed"
""")
    run = open_run(tmp_path / "canedge-gps-imu.mf4")
    drawn = RunChannels(tmp_path).samples(tmp_path / "canedge-gps-imu.mf4", ["imu.accel"])
    assert len(drawn) > 4 * run.signals["imu.accel"].values.size
    assert np.median(np.linalg.norm(run.signals["imu.accel"].values, axis=1)) == pytest.approx(9.81, rel=0.1)


def test_a_bus_log_without_its_dbc_is_refused_with_its_identifiers() -> None:
    with pytest.raises(RunError, match=r"identifiers 0x0d0.*\[read\] dbc"):
        open_source(CAN / "road-car.candump.log")
