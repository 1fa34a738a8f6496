"""Logs of ROS 2: units and quantities by the message's type, joints by their names, and the folder of a bag."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lacet.daq.errors import RunError
from lacet.daq.formats.open_run import open_run
from lacet.daq.maps.channel_map import ChannelMap
from lacet.daq.maps.guess import ACCEPTED, Guess, guess
from lacet.daq.maps.mapped_run import mapped_run
from lacet.daq.sources.open_source import open_source, opened
from lacet.daq.sources.source import read_all
from lacet.services.commands.__main__ import main
from lacet.services.workspace.import_log import import_logs
from tests.support.ros_logs import Messages, vector, write_ros2
from tests.support.tables import piece

IMU, TWIST, WRENCH = "sensor_msgs/msg/Imu", "geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/WrenchStamped"
JOINTS, FIX, RANGE = "sensor_msgs/msg/JointState", "sensor_msgs/msg/NavSatFix", "sensor_msgs/msg/Range"
CORNERS = ("fl", "fr", "rl", "rr")
WHEELS = [f"wheel_{c}" for c in CORNERS]


def drive(first: float, last: float) -> Messages:
    """Messages of a car in a slalom, of each type that cars' instruments send."""
    run = piece("sine", first, last)
    signals = {name: one.values for name, one in run.signals.items()}
    t = run.signals["imu.accel"].t
    out = []
    for i in range(0, len(t), 4):
        at = {name: values[i] for name, values in signals.items()}
        for c in CORNERS:
            wrench = {"force": vector(*at[f"wheel.{c}.force"]), "torque": vector(*at[f"wheel.{c}.moment"])}
            out.append((f"/wheel_load/{c}", WRENCH, float(t[i]), {"wrench": wrench}))
            out.append((f"/laser/{c}/ground", RANGE, float(t[i]), {"range": float(at[f"laser.{c}.ground"][0])}))
        moved = {"angular_velocity": vector(*at["imu.rate"]), "linear_acceleration": vector(*at["imu.accel"])}
        x, y, z, w = Rotation.from_euler("ZYX", at["imu.attitude"][::-1]).as_quat()
        moved["orientation"] = {"x": float(x), "y": float(y), "z": float(z), "w": float(w)}
        out.append(("/imu/data_raw", IMU, float(t[i]), moved))
        linear = vector(*at["correvit.speed"], 0.0)
        out.append(("/correvit", TWIST, float(t[i]), {"twist": {"linear": linear}}))
        turned, speeds = ([float(at[f"wheel.{c}.{what}"][0]) for c in CORNERS] for what in ("angle", "speed"))
        out.append(("/wheels", JOINTS, float(t[i]), {"name": WHEELS, "position": turned, "velocity": speeds}))
        steered = [float(at[f"camera.{c}.steer"][0]) for c in CORNERS]
        out.append(("/steer", JOINTS, float(t[i]), {"name": [f"steer_{c}" for c in CORNERS], "position": steered}))
        where = {"latitude": 48.0, "longitude": 2.0 + 1e-6 * i, "altitude": 150.0}
        out.append(("/gps/fix", FIX, float(t[i]), where))
        out.append(("/gps/vel", TWIST, float(t[i]), {"twist": {"linear": vector(*at["correvit.speed"], 0.0)}}))
        out.append(("/cmd_vel", TWIST, float(t[i]), {"twist": {"linear": linear}}))
    return out


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("ros") / "drive.mcap"
    write_ros2(path, drive(5.0, 25.0))
    return path


@pytest.fixture(scope="module")
def proposed(log: Path) -> dict[str, Guess]:
    with opened(log) as source:
        return {one.name: one for one in guess(source)}


@pytest.mark.parametrize(("name", "unit"), [
    ("imu/data_raw.linear_acceleration.x", "m/s²"), ("imu/data_raw.angular_velocity.z", "rad/s"),
    ("imu/data_raw.orientation.w", "-"), ("correvit.twist.linear.y", "m/s"), ("correvit.twist.angular.z", "rad/s"),
    ("wheel_load/fl.wrench.force.y", "N"), ("wheel_load/rr.wrench.torque.x", "N·m"), ("gps/fix.latitude", "deg"),
    ("gps/fix.altitude", "m"), ("laser/fl/ground.range", "m"), ("laser/fl/ground.field_of_view", "rad"),
])  # fmt: skip
def test_a_message_s_type_says_the_units_of_its_fields(proposed: dict[str, Guess], name: str, unit: str) -> None:
    assert proposed[name].unit == unit


@pytest.mark.parametrize(("name", "column", "sure"), [
    ("imu/data_raw.linear_acceleration.x", "imu.accel.x", False),
    ("imu/data_raw.linear_acceleration.y", "imu.accel.y", True),
    ("imu/data_raw.angular_velocity.x", "imu.rate.x", True),
    ("imu/data_raw.angular_velocity.y", "imu.rate.y", True),
    ("imu/data_raw.orientation.x", "imu.attitude.roll", True),
    ("imu/data_raw.orientation.y", "imu.attitude.pitch", True),
    ("imu/data_raw.orientation.z", "imu.attitude.yaw", True),
    ("imu/data_raw.angular_velocity.z", "imu.rate.z", True),
    ("correvit.twist.linear.x", "correvit.speed.x", True),
    ("wheel_load/fl.wrench.force.y", "wheel.fl.force.y", True),
    ("wheel_load/fr.wrench.force.y", "wheel.fr.force.y", True),
    ("wheel_load/fl.wrench.torque.y", "wheel.fl.moment.y", False),
    ("laser/rl/ground.range", "laser.rl.ground", True),
    ("wheels.velocity.wheel_rl", "wheel.rl.speed", True),
    ("wheels.position.wheel_rl", "wheel.rl.angle", True),
    ("steer.position.steer_fr", "camera.fr.steer", True),
    ("gps/fix.longitude", "gnss.longitude", True),
    ("correvit.twist.angular.z", "", False),
    ("gps/vel.twist.linear.x", "", False),
])  # fmt: skip
def test_and_what_they_are(proposed: dict[str, Guess], name: str, column: str, sure: bool) -> None:
    """Zeros of an unused field, a velocity in axes of the earth and a command are no rivals."""
    one = proposed[name]
    assert (one.column, one.expression.startswith("-")) == (column, False)
    assert (one.probability >= ACCEPTED) == sure


def test_the_angles_of_an_orientation_are_made_of_its_quaternion(log: Path, proposed: dict[str, Guess]) -> None:
    lines = [f'"{one.column}" = "{one.expression}"' for one in proposed.values() if "attitude" in one.column]
    run = mapped_run([log], ChannelMap.parse('format = "lacet-map 1"\n[channels]\n' + "\n".join(lines)))
    expected = piece("sine", 5.0, 25.0).signals["imu.attitude"].values[::4]
    np.testing.assert_allclose(run.signals["imu.attitude"].values, expected, atol=1e-9)
    assert not run.problems


def test_joints_are_named_and_a_map_with_their_numbers_is_still_read(log: Path, tmp_path: Path) -> None:
    speeds = [f'"wheel.{c}.speed" = "wheels.velocity.{k}"' for k, c in enumerate(CORNERS)]
    map_ = ChannelMap.parse('format = "lacet-map 1"\n[channels]\n' + "\n".join(speeds))
    found = import_logs([log], map_, tmp_path / "run.mcap")
    assert found["without_unit"] == []
    run = open_run(tmp_path / "run.mcap")
    with opened(log) as source:
        read = read_all(source, ["wheels.velocity.wheel_rr"])["wheels.velocity.wheel_rr"]
    np.testing.assert_allclose(run.signals["wheel.rr.speed"].values[:, 0], read.values)


def test_joints_of_changing_order_are_told_apart_by_their_names(tmp_path: Path) -> None:
    first, second = {"name": ["a", "b"], "position": [1.0, 2.0]}, {"name": ["b", "a"], "position": [2.0, 1.0]}
    write_ros2(tmp_path / "a.mcap", [("/j", JOINTS, 0.0, first), ("/j", JOINTS, 0.1, second)])
    with opened(tmp_path / "a.mcap") as source:
        found = read_all(source, ["j.position.a", "j.position.b"])
    assert [one.values.tolist() for one in found.values()] == [[1.0, 1.0], [2.0, 2.0]]


def test_joints_without_names_have_their_numbers(tmp_path: Path) -> None:
    write_ros2(tmp_path / "a.mcap", [("/j", JOINTS, 0.1 * k, {"position": [1.0, 2.0]}) for k in range(3)])
    with opened(tmp_path / "a.mcap") as source:
        assert list(source.listed) == ["j.position.0", "j.position.1"]


def bag(folder: Path, messages: Messages, edge: float) -> Path:
    """A bag of two files, the later of which comes first by its name."""
    folder.mkdir()
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  version: 9\n")
    write_ros2(folder / "bag_10.mcap", [one for one in messages if one[2] < edge])
    write_ros2(folder / "bag_11.mcap", [one for one in messages if one[2] >= edge])
    (folder / "bag_10.mcap").rename(folder / "bag_9.mcap")
    return folder


def test_the_folder_of_a_bag_is_one_log_in_order_of_time(tmp_path: Path) -> None:
    messages = drive(5.0, 7.0)
    times = [one[2] for one in messages]
    folder = bag(tmp_path / "car", messages, 0.5 * (times[0] + times[-1]))
    write_ros2(tmp_path / "whole.mcap", messages)
    name = "imu/data_raw.linear_acceleration.y"
    with opened(folder) as source, opened(tmp_path / "whole.mcap") as whole:
        got, expected = (read_all(one, [name])[name] for one in (source, whole))
        assert list(source.listed) == list(whole.listed)
    np.testing.assert_array_equal(got.t, expected.t)
    np.testing.assert_array_equal(got.values, expected.values)
    map_ = ChannelMap.parse(f'format = "lacet-map 1"\n[channels]\n"car.lateral_accel" = "`{name}`"')
    assert open_run(folder, map_).name == "car"
    with pytest.raises(RunError, match=r"this is a ROS 2 bag: .*lacet map --guess"):
        open_run(folder)


@pytest.mark.parametrize(("name", "says"), [
    ("car.bag", r"a bag of ROS 1 is not read.*rosbags-convert --src \S+car.bag --dst \S+car --dst-storage mcap"),
    ("bag/bag_0.db3", r"SQLite .*rosbags-convert --src \S+bag --dst \S+bag-mcap --dst-storage mcap"),
    ("bag/bag_0.mcap.zstd", "compressed as a whole.*zstd -d"), ("bag/notes.txt", "no files of messages"),
])  # fmt: skip
def test_a_bag_of_another_kind_is_refused_with_the_remedy(tmp_path: Path, name: str, says: str) -> None:
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    (tmp_path / name).write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(RunError, match=says):
        open_source(tmp_path / name if name.endswith(".bag") else tmp_path / "bag")
    if name.endswith(".bag"):
        with pytest.raises(RunError, match=says):
            open_run(tmp_path / name)


def test_a_folder_that_is_no_bag_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"a folder is read only where it is a ROS 2 bag \(metadata.yaml in it\)"):
        open_source(tmp_path)


def test_commands_take_the_folder_of_a_bag_as_a_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Not as a study's folder, nor as a file that is not there."""
    folder, study = str(bag(tmp_path / "car", drive(5.0, 5.5), 5.2)), str(tmp_path / "study")
    for words in (["check", folder], ["study", "new", study, "--use", folder], ["info", folder]):
        assert main(words) == 2
        assert "this is a ROS 2 bag" in capsys.readouterr().err
    assert main(["map", "--guess", folder, "-o", str(tmp_path / "map.toml")]) == 0
    assert main(["info", folder, "--map", str(tmp_path / "map.toml")]) in (0, 3)
    assert "car: 0.5 s" in capsys.readouterr().out
