"""A full rig on four wires, and a synthetic capture of it made by the drivers' own encoders."""

from __future__ import annotations

import random
import socket
from contextlib import suppress
from pathlib import Path

import numpy as np

from lacet.daq.blocks import Block
from lacet.daq.channels import CHANNELS, Channel
from lacet.daq.formats.log import LogWriter, StartRecord
from lacet.daq.frames import Frames
from lacet.daq.rig import Rig
from lacet.drivers import open_driver

T0 = 1_700_000_000_000_000_000

RIG = """\
format = "lacet-rig 1"
name = "bench"
wheel_reference = "hub"
[bus.can0]
kind = "can"
bitrate = 1_000_000
[bus.can1]
kind = "can"
bitrate = 1_000_000
[bus.serial0]
kind = "serial"
baud = 460_800
device = "/dev/ttyUSB0"
[bus.udp0]
kind = "udp"
port = {udp_port}
[[sensor]]
name = "wheels"
driver = "igel"
bus = "can0"
channels = ["wheel.*"]
axes = "carrier"
[[sensor]]
name = "lasers"
driver = "lasers"
bus = "can1"
channels = ["laser.*"]
axes = "body"
position_from_wheel_centre = [0.0, 0.0, 0.30]
[[sensor]]
name = "correvit"
driver = "correvit"
bus = "can1"
channels = ["correvit.speed"]
axes = "sensor"
position = [-3.2, 0.0, 0.01]
[[sensor]]
name = "imu"
driver = "sagem"
bus = "serial0"
channels = ["imu.*"]
axes = "sensor"
position = [-1.35, 0.1, 0.31]
clock = "device"
[[sensor]]
name = "cameras"
driver = "zimmer"
bus = "udp0"
channels = ["camera.*"]
axes = "body"
"""

# Centre and swing of each family's synthetic values, SI: within every wire's range.
_SIZE = {
    "wheel.force": (3000.0, 900.0),
    "wheel.angle": (3.0, 2.9),
    "laser.ground": (0.5, 0.02),
    "laser.hub": (0.3, 0.02),
}


def rig_text(udp_port: int = 47110) -> str:
    """The rig file's text."""
    return RIG.format(udp_port=udp_port)


def free_port() -> int:
    """A port nobody has just now, for UDP and TCP alike; below those that the system gives to outgoing connections."""
    draw = random.SystemRandom()
    while True:
        port = draw.randrange(20_000, 32_000)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp, socket.socket() as tcp, suppress(OSError):
            udp.bind(("127.0.0.1", port))
            tcp.bind(("127.0.0.1", port))
            return port


def samples(channel: Channel, seconds: float, rate: float) -> Block:
    """Smooth values, different for every component, at `rate` [Hz]."""
    n = round(seconds * rate)
    t = np.arange(n) / rate
    centre, swing = _SIZE.get(channel.family, (0.0, 0.5))
    rng = np.random.default_rng(sum(map(ord, channel.name)))
    phase, frequency = rng.uniform(0, 6, channel.width), rng.uniform(0.3, 3.0, channel.width)
    values = centre + swing * np.sin(2 * np.pi * frequency * t[:, None] + phase)
    return Block(channel.name, T0 + (t * 1e9).astype(np.int64), values, np.zeros(n, np.uint8))


def make_frames(rig: Rig, seconds: float, scale: float = 1.0) -> dict[str, Frames]:
    """What the wires would carry for `seconds`, by bus, at the nominal rates times `scale`."""
    parts: dict[str, list[Frames]] = {}
    for sensor in rig.sensors:
        assert sensor.driver is not None
        assert sensor.bus is not None
        driver = open_driver(sensor.driver, sensor.bus, sensor.options, rig.folder)
        blocks = {name: samples(CHANNELS[name], seconds, CHANNELS[name].rate * scale) for name in driver.channels}
        parts.setdefault(sensor.bus, []).append(driver.encode(blocks))
    return {bus: _merged(bus, frames) for bus, frames in parts.items()}


def _merged(bus: str, parts: list[Frames]) -> Frames:
    if len(parts) == 1:
        return parts[0]
    rows = sorted((frame for part in parts for frame in part), key=lambda frame: frame.t_ns)
    return Frames.from_iter(bus, rows)


def make_capture(path: Path, seconds: float, udp_port: int = 47110, scale: float = 1.0) -> dict[str, Frames]:
    """Write a capture (raw frames only) of the bench rig; returns what is in it."""
    rig = Rig.parse(rig_text(udp_port))
    frames = make_frames(rig, seconds, scale)
    write_capture(path, rig, frames)
    return frames


def write_capture(path: Path, rig: Rig, frames: dict[str, Frames]) -> None:
    """Write frames as a capture."""
    with LogWriter(path, StartRecord("capture", T0, "", rig.text)) as log:
        for batch in frames.values():
            for begin in range(0, len(batch), 500):
                log.write_frames(batch[begin : begin + 500])
