"""Rig: the sensors of a car, their mounting, wires, latency, noise and tolerances, read from a TOML file.

The file format is documented in ``docs/rig.md``; a new sensor of a known kind is one table of it.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lacet.daq.channels import AXES, AXES_OF, CHANNELS, COLUMNS, CORNERS
from lacet.daq.errors import RigError, nearest
from lacet.daq.shipped import DRIVERS, driver_files, find_shipped
from lacet.daq.toml_reader import Reader, dotted

FORMAT = "lacet-rig 1"
WHEEL_REFERENCES = ("contact", "hub")

DEFAULT_TOLERANCE: dict[str, float] = {
    # 1 σ errors of a calibrated instrument; a rig file may have others.
    "wheel.force.zero": 20.0,
    "wheel.moment.zero": 5.0,
    "wheel.force.gain": 0.003,
    "wheel.moment.gain": 0.003,
    "imu.accel.zero": 0.02,
    "imu.rate.zero": 0.0005,
    "imu.accel.gain": 0.001,
    "imu.rate.gain": 0.001,
    "imu.attitude.zero": 0.001,
    "laser.ground.zero": 0.0005,
    "laser.hub.zero": 0.0005,
    "laser.ground.gain": 0.002,
    "laser.hub.gain": 0.002,
    "camera.steer.zero": 0.0005,
    "camera.camber.zero": 0.0005,
    "correvit.speed.zero": 0.02,
    "correvit.speed.gain": 0.002,
    "shaft.torque.zero": 5.0,
    "shaft.torque.gain": 0.005,
    "brake.torque.zero": 10.0,
    "brake.torque.gain": 0.01,
    "suspension.travel.zero": 0.0005,
    "suspension.travel.gain": 0.002,
    "damper.travel.zero": 0.0005,
    "damper.travel.gain": 0.002,
    "hub.load.zero": 20.0,
    "hub.load.gain": 0.003,
    "pushrod.force.zero": 20.0,
    "pushrod.force.gain": 0.005,
    "scale.load.zero": 10.0,
    "scale.load.gain": 0.001,
    "steering.angle.zero": 0.01,
    "car.speed.zero": 0.05,
    "car.speed.gain": 0.02,
    "gnss.speed.zero": 0.02,
    "car.lateral_accel.zero": 0.05,
    "car.lateral_accel.gain": 0.01,
    "car.yaw_rate.zero": 0.002,
    "car.yaw_rate.gain": 0.01,
    "latency": 0.002,
    # Drift of the zeros during warm-up, per minute.
    "wheel.force.drift": 2.0,
    "wheel.moment.drift": 0.5,
    "imu.accel.drift": 0.001,
    "imu.rate.drift": 2e-5,
    "imu.attitude.drift": 5e-5,
    "laser.ground.drift": 2e-5,
    "laser.hub.drift": 2e-5,
    "camera.steer.drift": 2e-5,
    "camera.camber.drift": 2e-5,
    "correvit.speed.drift": 0.001,
    "shaft.torque.drift": 0.5,
    "brake.torque.drift": 1.0,
    # Cross-talk between the forces of a dynamometer: at most 1 % in data sheets.
    "wheel.force.crosstalk": 0.005,
    # Accuracy of mounting and survey on a car.
    "imu.misalignment": 0.005,
    "correvit.misalignment": 0.01,
    "wheel.misalignment": 0.003,
    "laser.misalignment": 0.01,
    "camera.misalignment": 0.002,
    "imu.position": 0.01,
}
"""Default sensor sheet: zeros in SI, gains as fractions, latency [s], drifts in SI per minute, cross-talk as a
fraction; by instrument, misalignment [rad] and position [m]."""

BY_INSTRUMENT = ("misalignment", "position")
"""Entries of the sheet for a whole instrument: ``imu.misalignment``."""


@dataclass(frozen=True)
class Bus:
    """One wire of the rig. `kind` is can, serial or udp; the other fields are its address on the logging machine."""

    name: str
    kind: str
    bitrate: int | None = None
    baud: int | None = None
    device: str | None = None
    port: int | None = None


@dataclass(frozen=True)
class Sensor:
    """One sensor of the rig: its mounting, driver, bus, noise and tolerances.

    Attributes
    ----------
    name : unique in the rig.
    channels : names in the vocabulary.
    driver, bus : decoder of its bytes and wire they arrive on; None for a sensor in exchange tables only.
    axes : axes its vectors are delivered in, one of `daq.channels.AXES`.
    latency : time from the physical instant to the stamp [s].
    clock : origin of the time stamps: ``arrival``; ``device``, the sensor's own clock fitted to the arrivals; or
        ``steady``, the sample's number at a constant rate fitted to them.
    noise : 1 σ at the nominal rate by channel family, SI.
    tolerance : 1 σ of its errors: ``family.zero`` (SI), ``family.gain``, ``latency`` [s] and so on, with the keys of
        `DEFAULT_TOLERANCE`.
    position : mount in body axes [m], by corner for corner sensors, under ``""`` otherwise.
    from_wheel_centre : mount relative to each design wheel centre, body axes [m], instead of `position`.
    orientation : roll, pitch, yaw of the sensor in body axes [rad].
    options : options of the driver.
    """

    name: str
    channels: tuple[str, ...]
    driver: str | None
    bus: str | None
    axes: str
    latency: float
    clock: str
    noise: Mapping[str, float]
    tolerance: Mapping[str, float]
    position: Mapping[str, tuple[float, ...]]
    from_wheel_centre: tuple[float, ...] | None
    orientation: tuple[float, ...]
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Rig:
    """The sensors of a car, with mounting, wires, latencies, noise and tolerances.

    `wheel_reference` is ``contact`` (road on tyre, reduced to the wheel centre) or ``hub`` (wheel on hub, rim and tyre
    outboard). `text` is the file's full text, as stored in every log; `folder` is the file's folder, `path` the file as
    it was named, for messages.

    Examples
    --------
    >>> rig = lacet.Rig.load("peugeot-406")  # a file, or the name of one shipped
    >>> rig.tolerance("laser.fl.hub", "zero") > 0.0
    True
    """

    name: str
    wheel_reference: str
    buses: Mapping[str, Bus]
    sensors: tuple[Sensor, ...]
    text: str
    folder: Path | None = None
    path: str = field(default="rig", compare=False)

    @classmethod
    def load(cls, path: str | Path, kept: bool = False) -> Rig:
        """The rig of a file, or a shipped one by its name. Raises RigError with every fault at once.

        `kept` : it is a copy, in a study or an upload, whose drivers need not be at hand.
        """
        found = find_shipped(path, "rigs", RigError)
        known = None if kept else {*driver_files(DRIVERS), *driver_files(found.parent / "drivers")}
        return cls.parse(found.read_text(encoding="utf-8", errors="replace"), str(path), found.parent, known)

    @classmethod
    def parse(
        cls, text: str, name: str = "rig", folder: Path | None = None, drivers: Collection[str] | None = None
    ) -> Rig:
        """The rig of a text, with any drivers, or only with `drivers`. Raises RigError with every fault at once."""
        reader = Reader(text, name, RigError, FORMAT)
        root = reader.root
        reader.known(root, ("format", "name", "description", "wheel_reference", "bus", "sensor"), "")
        buses = {key: _bus(reader, key, row) for key, row in reader.table(root, "bus", "").items()}
        rows = root.get("sensor", [])
        if not isinstance(rows, list) or not rows:
            reader.fault("sensor", "the rig needs at least one [[sensor]] row")
            rows = []
        for i, row in enumerate(rows):
            if not isinstance(row, dict):
                reader.fault(f"sensor #{i + 1}", f"must be a [[sensor]] row, found {row!r}")
        sensors = tuple(_sensor(reader, i, row, buses) for i, row in enumerate(rows) if isinstance(row, dict))
        _check_unique(reader, sensors)
        _check_lasers(reader, sensors)
        if drivers is not None:
            _check_drivers(reader, sensors, drivers)
        rig = cls(
            reader.text(root, "name", ""),
            reader.choice(root, "wheel_reference", "", WHEEL_REFERENCES, "contact"),
            buses,
            sensors,
            text,
            folder,
            name,
        )
        reader.finish()
        return rig

    def sensor_of(self, channel: str) -> Sensor | None:
        """The sensor that measures `channel`, or None when the rig has none."""
        return next((sensor for sensor in self.sensors if channel in sensor.channels), None)

    def latency(self, channel: str) -> float:
        """Latency of a channel [s]."""
        sensor = self.sensor_of(channel)
        return sensor.latency if sensor else 0.0

    def noise(self, channel: str) -> float:
        """1 σ of a channel's white noise at its nominal rate, SI."""
        sensor, family = self.sensor_of(channel), CHANNELS[channel].family
        return sensor.noise.get(family, CHANNELS[channel].noise) if sensor else CHANNELS[channel].noise

    def tolerance(self, channel: str, what: str) -> float:
        """1 σ of an error of a channel or of its instrument, from the sensor sheet.

        `what` : the channel's ``zero`` (SI), ``gain`` (fraction), ``latency`` [s], ``drift`` (SI per minute) or
        ``crosstalk`` (fraction), or the instrument's ``misalignment`` [rad] or ``position`` [m].
        """
        sensor = self.sensor_of(channel)
        family = CHANNELS[channel].family
        key = "latency" if what == "latency" else f"{_instrument(family) if what in BY_INSTRUMENT else family}.{what}"
        default = DEFAULT_TOLERANCE.get(key, 0.0)
        return sensor.tolerance.get(key, default) if sensor else default


def _bus(reader: Reader, name: str, row: Any) -> Bus:
    place = f"bus.{name}"
    if not isinstance(row, dict):
        reader.fault(place, "must be a table")
        return Bus(name, "can")
    reader.known(row, ("kind", "bitrate", "baud", "device", "port"), place)

    def whole(key: str) -> int | None:
        value = row.get(key)
        if value is not None and (not isinstance(value, int) or isinstance(value, bool) or value <= 0):
            reader.fault(f"{place}.{key}", f"must be a positive whole number, found {value!r}")
            return None
        return value

    device = row.get("device")
    if device is not None and not isinstance(device, str):
        reader.fault(f"{place}.device", "must be a text")
        device = None
    kind = reader.choice(row, "kind", place, ("can", "serial", "udp"), "can")
    return Bus(name, kind, whole("bitrate"), whole("baud"), device, whole("port"))


_SENSOR_KEYS = (
    "name", "driver", "bus", "channels", "axes", "latency", "clock", "noise", "tolerance", "position",
    "position_from_wheel_centre", "orientation", "options", "description",
)  # fmt: skip
_LASERS = ("laser.ground", "laser.hub")
_DBC_KEYS = ("dbc", "signals", "sources", "counter", "checksum", "status")
"""Further keys of a row whose driver is ``dbc``: they are its options."""


def _sensor(reader: Reader, index: int, row: dict[str, Any], buses: Mapping[str, Bus]) -> Sensor:
    name = row.get("name") if isinstance(row.get("name"), str) else f"#{index + 1}"
    place = f"sensor {name}"
    by_dbc = row.get("driver") == "dbc"
    if not by_dbc and (those := [key for key in _DBC_KEYS if key in row]):
        reader.fault(f"{place}.{those[0]}", 'is for driver = "dbc", a bus by the DBC of its owner')
    reader.known(row, (*_SENSOR_KEYS, *_DBC_KEYS), place)
    reader.text(row, "name", place)
    options = dict(reader.table(row, "options", place))
    if by_dbc:
        options |= {key: row[key] for key in _DBC_KEYS if key in row}
    patterns = row.get("channels")
    if by_dbc and patterns is None:
        channels = _of_signals(reader, options.get("signals"), place)
    else:
        channels = _channels(reader, patterns, place)
    driver, bus = (reader.text(row, key, place) if key in row else None for key in ("driver", "bus"))
    if bus and bus not in buses:
        reader.fault(f"{place}.bus", f"there is no [bus.{bus}]{nearest(bus, buses)}")
    if (driver is None) != (bus is None):
        reader.fault(place, "driver and bus go together: give both, or neither for a sensor of exchange tables")
    families = {CHANNELS[channel].family for channel in channels}
    axes = _axes(reader, row, place, channels)
    from_centre = row.get("position_from_wheel_centre")
    if isinstance(from_centre, dict):
        by_corner = "position = { fl = [x, y, z], fr = … }, from the body's origin"
        reader.fault(
            f"{place}.position_from_wheel_centre", f"is one for all wheels; where they differ give {by_corner}"
        )
        from_centre = None
    return Sensor(
        name=str(name),
        channels=channels,
        driver=driver,
        bus=bus,
        axes=axes,
        latency=reader.number(row, "latency", place, 0.0, low=0.0),
        clock=reader.choice(row, "clock", place, ("arrival", "device", "steady"), "arrival"),
        noise=_sheet(reader, row, "noise", place, families),
        tolerance=_sheet(
            reader, row, "tolerance", place,
            _sheet_keys(families),
        ),
        position=_position(reader, row.get("position"), place, channels),
        from_wheel_centre=None
        if from_centre is None
        else reader.vector(from_centre, f"{place}.position_from_wheel_centre"),
        orientation=_orientation(reader, row, place, channels, axes),
        options=options,
    )  # fmt: skip


def _axes(reader: Reader, row: dict[str, Any], place: str, channels: Sequence[str]) -> str:
    """The axes of a row's values: if it says none, those of its first channel, of channels that have a choice."""
    first = next((c for c in channels if CHANNELS[c].family in AXES_OF), next(iter(channels), "imu.accel"))
    axes = reader.choice(row, "axes", place, AXES, CHANNELS[first].axes)
    for family in dict.fromkeys(CHANNELS[channel].family for channel in channels):
        if axes not in (allowed := AXES_OF.get(family, AXES)):
            says = f"{family} cannot be in {axes} axes: {' or '.join(allowed)}, in a row without channels in other axes"
            reader.fault(f"{place}.axes", says)
    return axes


def _channels(reader: Reader, patterns: Any, place: str) -> tuple[str, ...]:
    if not isinstance(patterns, list) or not patterns:
        reader.fault(f"{place}.channels", 'must be a list of channel names or patterns, e.g. ["wheel.*"]')
        return ()
    out: dict[str, None] = {}
    for pattern in patterns:
        matches = fnmatch.filter(CHANNELS, str(pattern))
        if not matches:
            reader.fault(f"{place}.channels", f"no channel is called {pattern!r}{nearest(str(pattern), CHANNELS)}")
        out.update(dict.fromkeys(matches))
    return tuple(out)


def _of_signals(reader: Reader, signals: Any, place: str) -> tuple[str, ...]:
    """The channels whose components ``signals`` gives, whole ones only."""
    if not isinstance(signals, dict) or not signals:
        reader.fault(f"{place}.signals", 'must say where channels come from: signals = { "imu.accel.y" = "LatAcc" }')
        return ()
    columns = dotted(signals, COLUMNS)
    out: dict[str, None] = {}
    for column in columns:
        if column in COLUMNS:
            out[COLUMNS[column][0].name] = None
        elif column in CHANNELS:
            reader.fault(f"{place}.signals.{column}", f"has components: write {', '.join(CHANNELS[column].columns)}")
        else:
            hint = f"{nearest(column, COLUMNS)} (lacet info --channels lists them)"
            reader.fault(f"{place}.signals.{column}", f"is not a channel{hint}")
    for name in out:
        if missing := [column for column in CHANNELS[name].columns if column not in columns]:
            reader.fault(f"{place}.signals", f"{name} needs all its components: {', '.join(missing)} is missing")
    return tuple(out)


def _check_drivers(reader: Reader, sensors: tuple[Sensor, ...], drivers: Collection[str]) -> None:
    for sensor in sensors:
        if sensor.driver is not None and sensor.driver not in drivers:
            reader.fault(
                f"sensor {sensor.name}.driver",
                f"no driver is called {sensor.driver!r}{nearest(sensor.driver, drivers)} (there are: "
                f"{', '.join(sorted(drivers))}; one of your own is drivers/{sensor.driver}.py beside the rig file)",
            )


def _sheet(reader: Reader, row: dict[str, Any], key: str, place: str, allowed: set[str]) -> dict[str, float]:
    table = reader.table(row, key, place)
    reader.known(table, sorted(allowed), f"{place}.{key}")
    return {name: reader.number(table, name, f"{place}.{key}", 0.0, low=0.0) for name in table if name in allowed}


def _instrument(family: str) -> str:
    """Instrument of a family of channels: ``imu`` of ``imu.accel``."""
    return family.partition(".")[0]


def _sheet_keys(families: set[str]) -> set[str]:
    """Keys that a sensor sheet may have for channels of these families."""
    by_family = {f"{family}.{what}" for family in families for what in ("zero", "gain", "drift")}
    mounted = {f"{_instrument(f)}.misalignment" for f in families} & set(DEFAULT_TOLERANCE)
    placed = {f"{_instrument(f)}.position" for f in families} & set(DEFAULT_TOLERANCE)
    crosstalk = {f"{family}.crosstalk" for family in families if family == "wheel.force"}
    return by_family | mounted | placed | crosstalk | {"latency"}


def _position(reader: Reader, value: Any, place: str, channels: tuple[str, ...]) -> dict[str, tuple[float, ...]]:
    if value is None:
        return {}
    if isinstance(value, dict):
        corners = {CHANNELS[channel].corner for channel in channels} - {None}
        reader.known(value, CORNERS, f"{place}.position")
        for corner in sorted(str(c) for c in corners if c not in value):
            reader.fault(f"{place}.position", f"corner {corner} is missing")
        return {corner: reader.vector(v, f"{place}.position.{corner}") for corner, v in value.items()}
    vector = reader.vector(value, f"{place}.position")
    corners = {CHANNELS[channel].corner for channel in channels if CHANNELS[channel].family in _LASERS}
    if len(corners) > 1:
        reader.fault(f"{place}.position", "is one each corner for lasers: { fl = [x, y, z], fr = …, rl = …, rr = … }")
    return {"": vector, **{str(corner): vector for corner in corners}}


def _orientation(
    reader: Reader, row: dict[str, Any], place: str, channels: Sequence[str], axes: str
) -> tuple[float, ...]:  # fmt: skip
    """Roll, pitch and yaw of a sensor, where its axes are its own."""
    found = reader.vector(row.get("orientation", [0.0, 0.0, 0.0]), f"{place}.orientation")
    if any(found) and (axes != "sensor" or not any(CHANNELS[channel].family in AXES_OF for channel in channels)):
        reader.fault(f"{place}.orientation", 'is of wheel loads, imu.* and correvit.speed with axes = "sensor" alone')
    return found


def _check_unique(reader: Reader, sensors: tuple[Sensor, ...]) -> None:
    seen: dict[str, str] = {}
    for sensor in sensors:
        for channel in sensor.channels:
            if channel in seen:
                reader.fault(f"sensor {sensor.name}", f"{channel} is already delivered by {seen[channel]}")
            seen[channel] = sensor.name
    names = [sensor.name for sensor in sensors]
    for name in sorted({n for n in names if names.count(n) > 1}):
        reader.fault(f"sensor {name}", "the name stands twice; names are unique in a rig")


def _check_lasers(reader: Reader, sensors: tuple[Sensor, ...]) -> None:
    """A corner's two lasers have one mount."""
    rows = {channel: sensor for sensor in sensors for channel in sensor.channels}
    for corner in CORNERS:
        both = [rows[name] for what in ("ground", "hub") if (name := f"laser.{corner}.{what}") in rows]
        mounts = {(row.position.get(corner), row.from_wheel_centre) for row in both} - {(None, None)}
        if len(mounts) > 1:
            where = f"sensor {both[0].name}.position"
            reader.fault(where, f"at {corner} is not that of {both[1].name}: both lasers of a corner have one mount")


assert set(DEFAULT_TOLERANCE) <= _sheet_keys({channel.family for channel in CHANNELS.values()})
