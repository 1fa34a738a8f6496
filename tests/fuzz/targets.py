"""The table of fuzz targets: every reader, decoder and driver, with a whole input, its mutations and its use."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from lacet.daq.bus.certificates import Names, Role
from lacet.daq.bus.listener import LENGTH, Message
from lacet.daq.bus.session import Keys, chunk, split_key
from lacet.daq.channels import CHANNELS
from lacet.daq.errors import LacetError
from lacet.daq.formats import wire
from lacet.daq.formats.array_messages import joined_block
from lacet.daq.formats.events import EventKind, RunEvent, event_from_bytes, event_to_bytes
from lacet.daq.formats.exchange import write_table
from lacet.daq.formats.log import LogReader, LogWriter, recover
from lacet.daq.formats.mf4_write import write_mf4
from lacet.daq.formats.open_run import open_run
from lacet.daq.frames import Frames
from lacet.daq.maps.channel_map import ChannelMap
from lacet.daq.maps.guess import guess
from lacet.daq.maps.lookup import read_lookup
from lacet.daq.maps.mapped_run import mapped_run
from lacet.daq.rig import Rig
from lacet.daq.sources.dbc_messages import read_dbc
from lacet.daq.sources.open_source import opened
from lacet.daq.sources.source import Reading
from lacet.daq.vehicle import Vehicle
from lacet.drivers import driver_names, open_driver
from lacet.services.acquisition.assembly import Assembly
from lacet.services.acquisition.other_logs import frames_for
from lacet.services.acquisition.run_state import RunState, read_states
from lacet.services.acquisition.transports.endpoints import read_endpoints, write_endpoints
from lacet.services.workspace.decode import decode_log
from tests.drivers.driver_cases import decode_split, plausible_blocks
from tests.drivers.test_gnss_drivers import NMEA_STREAM, UBX_STREAM, reads
from tests.fuzz import mutation
from tests.fuzz.containers import log_messages, messages_changed, write_messages
from tests.support.foreign_logs import BUS_WRITERS, MAP_HEAD, WRITERS, Columns, foreign, read_candump, units_of
from tests.support.places import HOME
from tests.support.rig import T0, make_frames, rig_text, samples
from tests.support.tables import CAR, piece

CAN = HOME / "tests" / "data" / "can"
SIGNALS = {"car.yaw_rate": "GYRO_YAW", "steering.angle": "ID_D0.STEER_ANGLE", "wheel.fl.speed": "WS_FL / 0.31 m"}
ROAD_MAP = f"""\
format = "lacet-map 1"
[read]
dbc = "{CAN / "road-car.dbc"}"
[channels]
""" + "".join(f'"{channel}" = "{entry}"\n' for channel, entry in SIGNALS.items())


@dataclass(frozen=True)
class Target:
    """One reader under test.

    Attributes
    ----------
    seed : makes a whole input, which `use` accepts.
    changed : a mutation of it, by a generator.
    use : reads an input to the end, in an empty folder; nothing but LacetError may come out.
    """

    seed: Callable[[], Any]
    changed: Callable[[Random, Any], Any]
    use: Callable[[Any, Path], Any]


def _file(name: str, seed: Callable[[], bytes], changed: Callable[[Random, bytes], bytes], use: Callable[[Path], Any]):
    """A reader of a file of that name."""

    def use_file(data: bytes, folder: Path) -> None:
        (folder / name).write_bytes(data)
        use(folder / name)

    return Target(seed, changed, use_file)


def _written(name: str, write: Callable[[Path], Any]) -> Callable[[], bytes]:
    """A seed: the bytes that a writer of files writes, made once."""

    @cache
    def seed() -> bytes:
        with TemporaryDirectory() as folder:
            write(Path(folder) / name)
            return (Path(folder) / name).read_bytes()

    return seed


def _message(seed: Callable[[], bytes], use: Callable[[bytes], Any]) -> Target:
    """A reader of a message in memory."""
    return Target(seed, mutation.bytes_changed, lambda data, folder: use(data))


# ---- drivers: frames of any contents, identifiers, order and stamps


def _driver(name: str) -> Target:
    def opened_driver() -> Any:
        options = {"dbc": "road-car.dbc", "signals": SIGNALS} if name == "dbc" else {}
        return open_driver(name, "bus", options, CAN)

    @cache
    def seed() -> Frames:
        if name in ("nmea", "ubx"):
            return reads(NMEA_STREAM if name == "nmea" else UBX_STREAM, 13)
        if name == "dbc":
            rows = read_candump(CAN / "road-car.candump.log")[:200]
            return Frames.from_iter("bus", [("bus", round(1e9 * t), ident, data) for t, ident, data in rows])
        return opened_driver().encode(plausible_blocks(opened_driver(), 12, 3, device=True))

    def use(frames: Frames, folder: Path) -> None:
        blocks, counts = decode_split(opened_driver(), frames, (len(frames) // 3, len(frames) // 2))
        assert all(count >= 0 for count in counts.values()), counts
        assert all(len(one.values) == len(one.t_ns) == len(one.flags) for one in blocks.values())

    return Target(seed, mutation.frames_changed, use)


# ---- lacet's own logs


@cache
def _log(decoded: bool = False) -> bytes:
    """A log of 0.3 s of the bench rig at a tenth of its rates: raw frames, and blocks where `decoded`."""
    rig = Rig.parse(rig_text())
    with TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        with LogWriter(path, wire.StartRecord("run-1", T0, "", rig.text)) as log:
            for frames in make_frames(rig, 0.3, 0.1).values():
                log.write_frames(frames[:20])
                log.write_frames(frames[20:40])
            log.write_event(RunEvent(T0, EventKind.SENSOR, "imu", "silent", "imu: silent"))
        if decoded:
            decode_log(path, path.with_name("decoded.mcap"))
            path = path.with_name("decoded.mcap")
        return path.read_bytes()


@cache
def _messages(decoded: bool) -> tuple[Any, ...]:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        path.write_bytes(_log(decoded))
        return tuple(log_messages(path))


def _read_log(path: Path) -> None:
    """Everything that a log offers."""
    reader = LogReader(path)
    for source in reader.sources():
        reader.frames(source)
        reader.span(source)
    reader.blocks()
    reader.blocks(between=(T0, T0 + 10**8))
    reader.events()
    assert all(isinstance(line, str) for line in reader.damage)


def _decode(path: Path) -> None:
    decode_log(path, path.with_name("decoded.mcap"))


def _recover(path: Path) -> None:
    recover(path, path.with_name("whole.mcap"))
    _read_log(path.with_name("whole.mcap"))


def _container(decoded: bool, use: Callable[[Path], Any]) -> Target:
    """A reader of a log that is well-formed, whatever its messages are."""

    def use_messages(messages: Sequence[Any], folder: Path) -> None:
        write_messages(folder / "run.mcap", list(messages))
        use(folder / "run.mcap")

    return Target(partial(_messages, decoded), messages_changed, use_messages)


# ---- messages of log and bus


START = wire.StartRecord("run-1", T0, "", rig_text(), {"a.dbc": "VERSION"}, "car", "sine", extra={"part": "2"})
TALLIES = {"imu.accel": wire.Tally(6, 60, 7)}, {"can0": wire.Tally(2, 9, 1)}
MANIFEST = wire.Manifest("run-1", *TALLIES, {"can0": {"queue": 1}})
BLOCK = samples(CHANNELS["imu.accel"], 0.1, 100.0)
MESSAGES: dict[str, tuple[bytes, Callable[[bytes], Any]]] = {
    "start record": (wire.start_to_bytes(START), wire.start_from_bytes),
    "stop record": (
        wire.stop_to_bytes(wire.StopRecord(T0, "stopped", {"can0": 5}, {"can0": {"queue": 2}})), wire.stop_from_bytes,
    ),
    "manifest": (wire.manifest_to_bytes(MANIFEST), wire.manifest_from_bytes),
    "document": (wire.document_to_bytes(wire.Document("event", "run-1", "{}", 3)), wire.document_from_bytes),
    "event": (event_to_bytes(RunEvent(T0, EventKind.LOG, "", "stop", "end"), "run-1", 1), event_from_bytes),
    "block": (wire.block_to_bytes(BLOCK, 5), wire.block_from_bytes),
    "joined blocks": (wire.block_to_bytes(BLOCK, 5), lambda data: joined_block([data, wire.block_to_bytes(BLOCK, 6)])),
    "frames": (wire.frames_to_bytes(make_frames(Rig.parse(rig_text()), 0.02)["can1"], 3), wire.frames_from_bytes),
}  # fmt: skip


def _assembly_messages() -> list[Message]:
    keys = Keys("car", "run-1")
    parts = [BLOCK for _ in range(6)]
    bodies = [wire.block_to_bytes(block, number) for number, block in enumerate(parts)]
    fetched = b"".join(LENGTH.pack(len(body)) + body for body in bodies[3:])
    live = [Message(keys, "block", "imu.accel", number, body) for number, body in enumerate(bodies[:3])]
    return [
        *live, Message(keys, "ledger", "", 0, b"{}"),
        Message(keys, "manifest", "", 0, wire.manifest_to_bytes(MANIFEST), True),
        Message(keys, "blocks", "imu.accel", 3, fetched, True), Message(keys, "answered", "imu.accel", 3, b"", True),
    ]  # fmt: skip


def _message_changed(random: Random, one: Message) -> Message:
    match random.randrange(4):
        case 0:
            return replace(one, sequence=random.choice(mutation.INTEGERS) % 2**64)
        case 1:
            return replace(one, name=random.choice(("", "no.such", "imu.rate", "x" * 300)))
        case _:
            return replace(one, payload=mutation.bytes_changed(random, one.payload))


def _assemble(messages: list[Message], folder: Path) -> None:
    assembly = Assembly(Keys("car", "run-1"), START, folder)
    try:
        for message in messages:
            assembly.take(message)
            assembly.missing()
            assembly.request()
        if assembly.manifest is not None:
            assembly.digest()
        assembly.write(folder / "run.mcap", complete=False)
    finally:
        assembly.close()
    LogReader(folder / "run.mcap").blocks()


def _key(data: bytes, folder: Path) -> None:
    text = data.decode("utf-8", "replace")
    found = split_key(text)
    assert found is None or (len(found[0].run.encode()) <= 80 and not found[0].run.startswith("."))
    safe = chunk(text)
    assert split_key(f"lacet/car/{safe}/start") is not None
    assert (folder / safe).parent == folder


# ---- texts that people write


def _toml(name: str, text: Callable[[], str], use: Callable[[Path], Any]) -> Target:
    return _file(name, lambda: text().encode(), mutation.toml_changed, use)


def _decoder_rig(path: Path) -> None:
    """A rig with drivers and their options, opened as the recorder does."""
    for sensor in Rig.load(path).sensors:
        if sensor.driver is not None and sensor.bus is not None:
            open_driver(sensor.driver, sensor.bus, sensor.options, CAN)


ROAD_RIG = f"""\
format = "lacet-rig 1"
name = "road"
[bus.can0]
kind = "can"
bitrate = 500000
[[sensor]]
name = "car"
driver = "dbc"
bus = "can0"
dbc = "road-car.dbc"
axes = "body"
signals = {{ {", ".join(f'"{channel}" = "{entry}"' for channel, entry in SIGNALS.items())} }}
"""


def _dbc(path: Path) -> None:
    """Frames of a road car by a mutated description of them, as a driver and as an import do."""
    messages = read_dbc(path)
    frames = TARGETS["driver dbc"].seed()
    driver = open_driver("dbc", "bus", {"dbc": path.name, "signals": SIGNALS}, path.parent)
    decode_split(driver, frames, (50,))
    assert all(message.width >= 0 for message in messages)


# ---- tables and logs of others


KEPT = ("wheel.fl.force", "laser.fl.hub", "imu.rate")


@cache
def _foreign() -> tuple[np.ndarray, Columns, str]:
    """An eighth of a second of some of the reference car's channels in another system's names."""
    run = piece("sine", 6.0, 6.125)
    return foreign(replace(run, signals={name: run.signals[name] for name in KEPT}))


def _import(path: Path, with_units: bool) -> None:
    """A log of another system: its names guessed, and a run made by the map."""
    _, columns, channels = _foreign()
    map_ = ChannelMap.parse(MAP_HEAD + channels + ("" if with_units else units_of(columns)), "map", path.parent)
    with opened(path, Reading()) as source:
        guess(source)
    mapped_run([path], map_)


def _foreign_file(kind: str) -> Target:
    """Bytes of a log of another system."""
    name, write = WRITERS[kind]
    with_units: list[bool] = []

    def write_it(path: Path) -> None:
        t, columns, _ = _foreign()
        with_units.append(write(path, t, columns))

    seed = _written(name, write_it)
    changed = mutation.text_changed if kind == "csv" else mutation.bytes_changed
    return _file(name, seed, changed, lambda path: _import(path, with_units[0]))


def _foreign_container(kind: str) -> Target:
    """A log of another system that is well-formed, whatever its columns are; written by the format's own library."""
    name, write = WRITERS[kind]

    def seed() -> dict[str, tuple[str, Any]]:
        t, columns, _ = _foreign()
        return {"time": ("s", t), **{own: (unit, values) for own, unit, values in columns.values()}}

    def use(columns: dict[str, tuple[str, Any]], folder: Path) -> None:
        rest = dict(columns)
        t = np.asarray(rest.pop("time", ("s", np.arange(100) * 0.004))[1])
        path = folder / name
        try:
            units = write(path, t, {own: (own, unit, values) for own, (unit, values) in rest.items()})
        except Exception:  # the library does not write that
            return
        _import(path, units)

    return Target(seed, mutation.columns_changed, use)


def _bus_log(kind: str) -> Target:
    """Bytes of a bus log of another tool: decoded by a DBC, and played onto a rig."""
    name, write = BUS_WRITERS[kind]
    seed = _written(name, lambda path: write(path, read_candump(CAN / "road-car.candump.log")[:60]))

    def use(path: Path) -> None:
        with contextlib.suppress(LacetError):
            frames_for(path, Rig.parse(ROAD_RIG, "rig", CAN))
        mapped_run([path], ChannelMap.parse(ROAD_MAP, "map"))

    return _file(name, seed, mutation.bytes_changed if kind == "blf" else mutation.text_changed, use)


TABLE = "wheel angle [deg],travel [mm]\n" + "".join(f"{a},{2 * a}\n" for a in range(-20, 21, 5))
MF4_MAP = """
format = "lacet-mf4 1"
[run]
manoeuvre = "slalom"
brakes = "off"
[channels]
wheel.fl.force.x = "laser.fl.hub"
laser.rr.hub = { name = "laser.rr.hub", scale = -1.0 }
"""


def _mf4_with_map(path: Path) -> None:
    """An MDF file of lacet's names with a map of the older kind beside it, which is the one mutated."""
    run = path.with_name("run.mf4")
    run.write_bytes(_own_mf4())
    open_run(run)


_own_mf4 = _written("run.mf4", lambda path: write_mf4(piece("sine", 6.0, 6.2), path))


def _dbc_of(name: str) -> Target:
    """The description of an instrument's frames, which a rig may give."""

    def use(path: Path) -> None:
        driver = open_driver(name, "bus", {"dbc": path.name}, path.parent)
        decode_split(driver, TARGETS[f"driver {name}"].seed(), (10,))

    return _file("own.dbc", (HOME / "drivers" / "dbc" / f"{name}.dbc").read_bytes, mutation.text_changed, use)


STATE = "run-1.state.json"


def _state(path: Path) -> None:
    (path.parent / "run-1.mcap").touch()
    read_states(path.parent)


TARGETS: dict[str, Target] = {
    **{f"driver {name}": _driver(name) for name in driver_names()},
    "log": _file("run.mcap", partial(_log, True), mutation.bytes_changed, _read_log),
    "log as a run": _file("run.mcap", partial(_log, True), mutation.bytes_changed, open_run),
    "log recovered": _file("run.mcap", _log, mutation.bytes_changed, _recover),
    "log decoded": _file("run.mcap", _log, mutation.bytes_changed, _decode),
    "whole log": _container(True, _read_log),
    "whole log as a run": _container(True, open_run),
    "whole log recovered": _container(True, _recover),
    "whole log decoded": _container(False, _decode),
    **{f"message: {name}": _message(lambda data=data: data, use) for name, (data, use) in MESSAGES.items()},
    "messages of the bus": Target(
        _assembly_messages, lambda random, items: mutation.one_changed(random, items, _message_changed), _assemble
    ),
    "key of the bus": Target(lambda: "lacet/car/Lauf-é/block/imu.accel".encode(), mutation.text_changed, _key),
    "state of a run": _file(
        STATE, _written(STATE, lambda path: RunState("c", "run-1", "run-1.mcap", "0").save(path.parent)),
        mutation.json_changed, _state,
    ),
    "names on the bus": _file(
        "names.json", _written("names.json", Names({"a": Role.CAR, "b": Role.WORKER}).write), mutation.json_changed,
        Names.read,
    ),
    "endpoints": _file(
        "wires.json", _written("wires.json", lambda path: write_endpoints(path, {"can0": "multicast:43113"})),
        mutation.json_changed, read_endpoints,
    ),
    "rig": _toml("rig.toml", (CAR / "rig.toml").read_text, Rig.load),
    "rig with drivers": _toml("rig.toml", rig_text, _decoder_rig),
    "rig with a DBC": _toml("rig.toml", lambda: ROAD_RIG, _decoder_rig),
    "vehicle": _toml("vehicle.toml", (CAR / "vehicle.toml").read_text, Vehicle.load),
    "channel map": _toml("map.toml", lambda: MAP_HEAD + _foreign()[2] + units_of(_foreign()[1]), ChannelMap.load),
    "channel map of a bus": _toml("map.toml", lambda: ROAD_MAP, ChannelMap.load),
    "map of an MDF file": _toml("run.toml", lambda: MF4_MAP, _mf4_with_map),
    "DBC": _file("road-car.dbc", (CAN / "road-car.dbc").read_bytes, mutation.text_changed, _dbc),
    **{f"DBC of {name}": _dbc_of(name) for name in ("igel", "lasers", "correvit")},
    "lookup table": _file("table.csv", TABLE.encode, mutation.text_changed, lambda path: read_lookup(path, "travel")),
    "exchange table": _file(
        "run.csv", _written("run.csv", lambda path: write_table(piece("sine", 6.0, 6.1), path)),
        mutation.text_changed, open_run,
    ),
    "exchange Parquet": _file(
        "run.parquet", _written("run.parquet", lambda path: write_table(piece("sine", 6.0, 6.1), path)),
        mutation.bytes_changed, open_run,
    ),
    "own MDF": _file("run.mf4", _own_mf4, mutation.bytes_changed, open_run),
    **{f"import {kind}": _foreign_file(kind) for kind in WRITERS},
    **{f"import whole {kind}": _foreign_container(kind) for kind in WRITERS},
    **{f"bus log {kind}": _bus_log(kind) for kind in BUS_WRITERS},
    "bus log MDF": _file(
        "drive.mf4", (CAN / "canedge-gps-imu.mf4").read_bytes, mutation.bytes_changed,
        lambda path: frames_for(path, Rig.parse(ROAD_RIG, "rig", CAN), ("2=can0",)),
    ),
}  # fmt: skip
"""Target by name. A mutation is known by target and number, which a failing test says: `mutated` makes it again."""


def mutated(name: str, number: int) -> Any:
    """Mutation number `number` of a target's whole input."""
    target = TARGETS[name]
    return target.changed(Random(f"{name} {number}"), target.seed())
