"""Channel maps: what they say is checked before any file, and nothing in them is executed."""

from __future__ import annotations

from pathlib import Path

import pytest

from lacet.daq.maps.channel_map import ChannelMap, MapError

HEAD = 'format = "lacet-map 1"\n'


def faults(text: str, folder: Path | None = None) -> str:
    with pytest.raises(MapError) as caught:
        ChannelMap.parse(HEAD + text, "car.map.toml", folder)
    return str(caught.value)


def test_a_map_of_every_form(tmp_path: Path) -> None:
    (tmp_path / "steering.csv").write_text("SWA [deg],camera.fl.steer [deg]\n-90,-5\n0,0\n90,6\n")
    found = ChannelMap.parse(HEAD + """
[run]
manoeuvre = "lap"
[read]
time = "Zeit"
time_unit = "ms"
[sources]
SWA = { unit = "deg", delay = "20 ms" }
"Pot_*" = { unit = "mm", time = "t_pot" }
left = { name = "Vehicle Speed, left wheel", unit = "km/h" }
[channels]
"laser.fl.hub" = "300 mm - 1.32 * Pot_FL"
"camera.fl.steer" = { from = "SWA", table = "steering.csv" }
"wheel.fl.speed" = "left / 0.31 m"
"imu.accel.y" = { from = "-`Lat Acc`", unit = "g", delay = "3 ms" }
imu.accel.z = "IMU.acc.z"
""", "m", tmp_path)  # fmt: skip
    assert found.metadata == {"manoeuvre": "lap"}
    assert (found.reading.time, found.reading.time_unit) == ("Zeit", "ms")
    assert found.said("Pot_RR").time == "t_pot"
    assert found.said("SWA").delay == pytest.approx(0.02)
    assert found.channels["imu.accel.y"].delay == pytest.approx(0.003)
    assert list(found.channels["imu.accel.y"].written.names.values()) == ["Lat Acc"]
    assert list(found.channels["imu.accel.z"].written.names.values()) == ["IMU.acc.z"]


@pytest.mark.parametrize(("text", "says"), [
    ('[sources]\nA = "mm"\n[channels]\n"laser.fl.hub" = "300 - 1.32 * A"', "300 [-] and 1.32 * A [m]"),
    ('[sources]\nA = "mm"\n[channels]\n"wheel.fl.force.x" = "A"', "this is in m, and wheel.fl.force.x is in N"),
    ('[sources]\nn = "Hz"\n[channels]\n"wheel.fl.speed" = "n"', "write rev/s or rad/s"),
    ('[sources]\nn = "%"\n[channels]\n"steering.angle" = "n"', "'%' is no unit of what steering.angle is in, rad"),
    ('[sources]\nA = "blorp"\n[channels]\n"wheel.fl.force.x" = "A"', "sources.A.unit: unit 'blorp' is not known"),
    ('[channels]\n"imu.acel.y" = "A"', "is not a channel; did you mean 'imu.accel.y'?"),
    ('[channels]\n"imu.accel" = "A"', "write imu.accel.x, imu.accel.y, imu.accel.z"),
    ('[channels]\n"imu.accel.y" = "__import__(\'os\').system(\'true\')"', "only numbers, names"),
    ('[channels]\n"imu.accel.y" = "open(A)"', "the function open is not known"),
    ('[channels]\n"imu.accel.y" = "Lat Acc"', "a name with spaces or signs is written in `backquotes`"),
    ('[channels]\n"imu.accel.y" = "9.81"', "a constant needs its unit: 9.81 m/s²"),
    ('[channels]\n"imu.accel.y" = 9.81', 'a constant is written with its unit: "9.81 m/s²"'),
    ('[channels]\n"imu.accel.y" = { name = "A" }', 'write "EXPRESSION" or { from = "EXPRESSION"'),
    ('[channels]\n"imu.accel.y" = { from = "A", delay = "12" }', 'must be a time with its unit, "12 ms"'),
    ('[sources]\nA = { drift = "12 ms" }', "must be a share of time below 10%"),
    ('[sources]\nA = { drift = "0.2" }', "must be a share of time below 10%"),
    ('[channels]\n"imu.accel.y" = { from = "A + B", unit = "g" }', "says the unit of one name, and here are more"),
    ('[channels]\n"imu.accel.y" = { from = "A", tabel = "x" }', "unknown key; did you mean 'table'?"),
    ('[read]\ndbc = "cra.dbc"\n[channels]\n"imu.accel.y" = "A"', "there is no file"),
    ('[read]\ntime_unit = "mm"\n[channels]\n"imu.accel.y" = "A"', "'mm' is no unit of time"),
    ("", "names no channel: write"),
    ('[channels]\n# "imu.accel.y" = "A"  # probability 0.78', "names no channel: remove the # of the proposals"),
])  # fmt: skip
def test_every_fault_is_told_with_place_and_remedy(text: str, says: str) -> None:
    assert says in faults(text)


def test_a_wrong_format_is_told() -> None:
    with pytest.raises(MapError, match='must be "lacet-map 1"'):
        ChannelMap.parse('[channels]\n"imu.accel.y" = "A"\n')


@pytest.mark.parametrize(("table", "says"), [
    ("SWA,camera.fl.steer [deg]\n0,0\n1,1\n", "column 'SWA' has no unit"),
    ("SWA [deg],camera.fl.steer [mm]\n0,0\n1,1\n", "its values are in mm, and camera.fl.steer is in rad"),
    ("SWA [deg],camera.fl.steer [deg]\n0,0\n1,1\n1,2\n", "line 4: 'SWA' must increase"),
    ("SWA [deg],a [deg],b [deg]\n0,0,0\n1,1,1\n", "no column is camera.fl.steer; it has a, b"),
    ("SWA [mm],camera.fl.steer [deg]\n0,0\n1,1\n", "this is a plain number or an angle, and column"),
])  # fmt: skip
def test_a_table_s_faults_name_line_or_column(tmp_path: Path, table: str, says: str) -> None:
    (tmp_path / "steer.csv").write_text(table)
    text = '[sources]\nSWA = "deg"\n[channels]\n"camera.fl.steer" = { from = "SWA", table = "steer.csv" }'
    assert says in faults(text, tmp_path)


def test_a_misspelt_table_names_the_nearest(tmp_path: Path) -> None:
    (tmp_path / "steering.csv").write_text("SWA [deg],camera.fl.steer [deg]\n0,0\n1,1\n")
    text = '[channels]\n"camera.fl.steer" = { from = "SWA", table = "stering.csv" }'
    assert "did you mean 'steering.csv'?" in faults(text, tmp_path)
