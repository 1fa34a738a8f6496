"""Some seconds of the reference car as other systems would have recorded it: other names, units, signs and formats.

Where another library than the reader's own writes a format, it does.
"""

from __future__ import annotations

import csv
import io
import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from lacet.daq.channels import CHANNELS
from lacet.daq.run import Run
from tests.support.tables import CAR

DEG = np.pi / 180.0
Columns = dict[str, tuple[str, str, np.ndarray]]
"""Column of the vocabulary → name, unit and values in the other system's log."""

_OTHERS: dict[str, tuple[str, str, float, str]] = {
    # family.component: name, unit, factor to SI, expression of the map
    "wheel.force.x": ("Fx_{C}", "kN", 1e3, "{n}"), "wheel.force.y": ("Fy_{C}", "daN", -10.0, "-{n}"),
    "wheel.force.z": ("Fz_{C}", "N", 1.0, "{n}"), "wheel.moment.x": ("Mx_{C}", "N*m", 1.0, "{n}"),
    "wheel.moment.y": ("My_{C}", "Nm", 1.0, "{n}"), "wheel.moment.z": ("Mz_{C}", "kNm", 1e3, "{n}"),
    "wheel.speed": ("n_{C}", "1/min", np.pi / 30.0, "{n}"), "wheel.angle": ("phi_{C}", "deg", DEG, "{n}"),
    "laser.ground": ("Hgnd_{C}", "mm", 1e-3, "{n}"), "camera.steer": ("delta_{C}", "deg", DEG, "{n}"),
    "camera.camber": ("gamma_{C}", "deg", -DEG, "-{n}"), "imu.accel.x": ("AccX", "g", 9.80665, "{n}"),
    "imu.accel.y": ("AccY", "m/s**2", 1.0, "{n}"), "imu.accel.z": ("AccZ", "m/s^2", 1.0, "{n}"),
    "imu.rate.x": ("GyroX", "deg/s", DEG, "{n}"), "imu.rate.y": ("GyroY", "°/s", DEG, "{n}"),
    "imu.rate.z": ("GyroZ", "rad/s", 1.0, "{n}"), "imu.attitude.roll": ("Roll", "deg", DEG, "{n}"),
    "imu.attitude.pitch": ("Pitch", "mrad", 1e-3, "{n}"), "imu.attitude.yaw": ("Yaw", "°", DEG, "{n}"),
    "correvit.speed.x": ("Vx", "km/h", 1 / 3.6, "{n}"), "correvit.speed.y": ("Vy", "m/s", 1.0, "{n}"),
}  # fmt: skip
MAP_HEAD = f"""\
format = "lacet-map 1"

[run]
vehicle = "{CAR / "vehicle.toml"}"
rig = "{CAR / "rig.toml"}"
wheel_reference = "hub"
manoeuvre = "sine"
brakes = "off"
"""


def foreign(run: Run) -> tuple[np.ndarray, Columns, str]:
    """Times, columns and map of a run in another system's names; travel by a potentiometer is the hub laser."""
    columns: Columns = {}
    lines: list[str] = []
    for name, signal in run.signals.items():
        channel = CHANNELS[name]
        for k, column in enumerate(channel.columns):
            part = f".{channel.components[k]}" if channel.components else ""
            corner = (channel.corner or "").upper()
            if channel.family == "laser.hub":
                own, unit = f"Pot_{corner}", "mm"
                values, expression = (0.3 - signal.values[:, k]) / 1.32 * 1e3, f"300 mm - 1.32 * {own}"
            else:
                pattern, unit, factor, form = _OTHERS[channel.family + part]
                own = pattern.format(C=corner)
                values, expression = signal.values[:, k] / factor, form.format(n=own)
            columns[column] = (own, unit, values)
            lines.append(f'"{column}" = "{expression}"')
    return next(iter(run.signals.values())).t, columns, "\n[channels]\n" + "\n".join(lines) + "\n"


def units_of(columns: Columns) -> str:
    """The part of a map that says the units, for a format that has none."""
    return "\n[sources]\n" + "\n".join(f'"{name}" = "{unit}"' for name, unit, _ in columns.values()) + "\n"


# ---- writers: (path, times, columns) → whether the file has units


def write_csv(path: Path, t: np.ndarray, columns: Columns) -> bool:
    """A spreadsheet's: preamble, semicolons, decimal commas, a row of units, times in ms, Windows' encoding."""
    out = io.StringIO()
    out.write("Messung;Prüfstand 3\nFahrer;Müller\n\n")
    table = csv.writer(out, delimiter=";", lineterminator="\r\n")
    table.writerow(["Zeit", *(name for name, _, _ in columns.values())])
    table.writerow(["ms", *(unit for _, unit, _ in columns.values())])
    rows = np.column_stack([1e3 * t, *(values for _, _, values in columns.values())])
    for row in rows:
        table.writerow([repr(float(x)).replace(".", ",") for x in row])
    path.write_bytes(out.getvalue().encode("cp1252"))
    return True


def write_parquet(path: Path, t: np.ndarray, columns: Columns) -> bool:
    """Units in the names, times as epoch stamps."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    stamps = pa.array(np.round((t + 1.7e9) * 1e9).astype(np.int64)).cast(pa.timestamp("ns"))
    pq.write_table(pa.table({"stamp": stamps, **{f"{n} [{u}]": v for n, u, v in columns.values()}}), path)
    return True


def write_mf4(path: Path, t: np.ndarray, columns: Columns) -> bool:
    """A measured MDF file with two groups."""
    from asammdf import MDF
    from asammdf import Signal as MdfSignal

    mdf = MDF(version="4.10")
    signals = [MdfSignal(v, t, name=n, unit=u) for n, u, v in columns.values()]
    mdf.append(signals[:20])
    mdf.append(signals[20:])
    mdf.save(path, overwrite=True)
    mdf.close()
    return True


def write_mat5(path: Path, t: np.ndarray, columns: Columns) -> bool:
    """Variables, by mat4py."""
    import mat4py

    mat4py.savemat(str(path), {"t": t.tolist(), **{n: v.tolist() for n, _, v in columns.values()}})
    return False


def write_mat73(path: Path, t: np.ndarray, columns: Columns) -> bool:
    """HDF5 laid out as MATLAB does: user block, transposed arrays, texts as numbers."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, unit, values in columns.values():
            group = file.create_group(name)
            for key, array in (("time", t), ("data", values)):
                group.create_dataset(key, data=array[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
            text = group.create_dataset("unit", data=np.array([[ord(c)] for c in unit], np.uint16))
            text.attrs["MATLAB_class"] = np.bytes_("char")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + struct.pack("<HH", 0x0200, 0x4D49)
    with path.open("r+b") as stream:
        stream.write(head)
    return True


def write_tdms(path: Path, t: np.ndarray, columns: Columns) -> bool:
    """Waveforms of LabVIEW."""
    from nptdms import ChannelObject, TdmsWriter

    step = float(t[1] - t[0])
    with TdmsWriter(path) as writer:
        writer.write_segment([
            ChannelObject("Car", n, v, {"unit_string": u, "wf_increment": step, "wf_start_offset": float(t[0])})
            for n, u, v in columns.values()
        ])  # fmt: skip
    return True


def write_mcap_json(path: Path, t: np.ndarray, columns: Columns) -> bool:
    """JSON messages, one topic."""
    from mcap.writer import Writer

    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("Car", "jsonschema", b'{"type": "object"}')
        topic = writer.register_channel("/car", "json", schema)
        for at, row in zip(t, _rows(columns), strict=True):
            stamp = round((at + 1.7e9) * 1e9)
            writer.add_message(topic, stamp, json.dumps(row).encode(), stamp)
        writer.finish()
    return False


def write_mcap_protobuf(path: Path, t: np.ndarray, columns: Columns) -> bool:
    """Protobuf messages of a type made here, with a time of their own."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
    from mcap_protobuf.writer import Writer

    file = descriptor_pb2.FileDescriptorProto(name="car.proto", package="car", syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")
    kind = file.message_type.add(name="Car")
    field = descriptor_pb2.FieldDescriptorProto
    kind.field.add(
        name="stamp", number=1, type=field.TYPE_MESSAGE, label=1, type_name=".google.protobuf.Timestamp"
    )  # fmt: skip
    for at, (name, _, _) in enumerate(columns.values()):
        kind.field.add(name=name, number=at + 2, type=field.TYPE_DOUBLE, label=1)
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(timestamp_pb2.DESCRIPTOR.serialized_pb)
    pool.AddSerializedFile(file.SerializeToString())
    made = message_factory.GetMessageClass(pool.FindMessageTypeByName("car.Car"))
    with path.open("wb") as stream, Writer(stream) as writer:
        for at, row in zip(t, _rows(columns), strict=True):
            stamp = round((at + 1.7e9) * 1e9)
            message = made(**row)
            message.stamp.seconds, message.stamp.nanos = divmod(stamp, 10**9)
            writer.write_message("/car", message, stamp + 5_000_000, stamp + 5_000_000)
    return False


def write_mcap_ros2(path: Path, t: np.ndarray, columns: Columns) -> bool:
    """ROS 2 messages with a header, in CDR, by rosbags."""
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    text = "std_msgs/Header header\n" + "\n".join(f"float64 {n.lower()}" for n, _, _ in columns.values()) + "\n"
    store.register(get_types_from_msg(text, "car_msgs/msg/Car"))
    made, header, time = (
        store.types[k] for k in ("car_msgs/msg/Car", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    full, _ = store.generate_msgdef("car_msgs/msg/Car", ros_version=2)
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        schema = writer.register_schema("car_msgs/msg/Car", "ros2msg", full.encode())
        topic = writer.register_channel("/car", "cdr", schema)
        for at, row in zip(t, _rows(columns), strict=True):
            stamp = round((at + 1.7e9) * 1e9)
            second, nano = divmod(stamp, 10**9)
            message = made(header=header(stamp=time(sec=second, nanosec=nano), frame_id=""),
                           **{n.lower(): v for n, v in row.items()})  # fmt: skip
            data = bytes(store.serialize_cdr(message, "car_msgs/msg/Car"))
            writer.add_message(topic, stamp + 7_000_000, data, stamp + 7_000_000)
        writer.finish()
    return False


def _rows(columns: Columns) -> list[dict[str, float]]:
    names = [name for name, _, _ in columns.values()]
    return [
        dict(zip(names, map(float, row), strict=True)) for row in zip(*(v for _, _, v in columns.values()), strict=True)
    ]


WRITERS: dict[str, tuple[str, Callable[[Path, np.ndarray, Columns], bool]]] = {
    "csv": ("drive.csv", write_csv), "parquet": ("drive.parquet", write_parquet), "mf4": ("drive.mf4", write_mf4),
    "mat 5": ("drive.mat", write_mat5), "mat 7.3": ("drive.mat", write_mat73), "tdms": ("drive.tdms", write_tdms),
    "mcap json": ("drive.mcap", write_mcap_json), "mcap protobuf": ("drive.mcap", write_mcap_protobuf),
    "mcap ros 2": ("drive.mcap", write_mcap_ros2),
}  # fmt: skip

# ---- bus logs, of frames (time, identifier, data)

Frame = tuple[float, int, bytes]


def write_candump(path: Path, frames: list[Frame]) -> None:
    """As can-utils' ``candump -L``."""
    path.write_text("".join(f"({t:.6f}) can0 {i:03X}#{d.hex().upper()}\n" for t, i, d in frames))


def write_blf(path: Path, frames: list[Frame]) -> None:
    """By vblf."""
    from vblf.can import CanMessage
    from vblf.constants import Compression, ObjFlags
    from vblf.writer import BlfWriter

    with BlfWriter(path, Compression.SPEED, buffer_size=1 << 24) as writer:
        for t, ident, data in frames:
            stamp = round(1e9 * (t - frames[0][0]))
            writer.write(CanMessage.new(ObjFlags.TIME_ONE_NANS, stamp, 1, 0, len(data), ident, data.ljust(8, b"\0")))


def write_asc(path: Path, frames: list[Frame]) -> None:
    """In the form of Vector's tools."""
    begin = frames[0][0]
    lines = ["date Sun Sep 12 03:15:54.722 am 2021", "base hex  timestamps absolute", "internal events logged",
             "Begin Triggerblock Sun Sep 12 03:15:54.722 am 2021", "   0.000000 Start of measurement"]  # fmt: skip
    for t, ident, data in frames:
        lines.append(f"{t - begin:11.6f} 1  {ident:<15X} Rx   d {len(data)} {data.hex(' ').upper()}")
    path.write_text("\n".join([*lines, "End TriggerBlock", ""]))


def write_trc(path: Path, frames: list[Frame]) -> None:
    """In PEAK's form, version 1.1."""
    begin = frames[0][0]
    lines = [";$FILEVERSION=1.1", ";$STARTTIME=44451.1360500000", ";", ";   Message Number"]
    for number, (t, ident, data) in enumerate(frames, 1):
        shown = data.hex(" ").upper()
        lines.append(f"{number:6d}) {1e3 * (t - begin):11.1f}  Rx        {ident:04X}  {len(data)}  {shown}")
    path.write_text("\n".join([*lines, ""]))


BUS_WRITERS: dict[str, tuple[str, Callable[[Path, list[Frame]], None]]] = {
    "candump": ("lap.log", write_candump), "blf": ("lap.blf", write_blf), "asc": ("lap.asc", write_asc),
    "trc": ("lap.trc", write_trc),
}  # fmt: skip


def read_candump(path: Path) -> list[Frame]:
    """The frames of a candump log, read apart from the reader under test."""
    out: list[Frame] = []
    for line in path.read_text().splitlines():
        stamp, _, frame = line.split()
        ident, _, data = frame.partition("#")
        out.append((float(stamp.strip("()")), int(ident, 16), bytes.fromhex(data)))
    return out
