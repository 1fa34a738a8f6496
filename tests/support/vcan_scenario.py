"""Runs inside the guest kernel (tests/services/acquisition/test_vcan.py): the checks that need a real CAN interface.

    python -m tests.support.vcan_scenario FOLDER

Prints one line of JSON a check, `{"check": …, "ok": …, …}`.
"""

from __future__ import annotations

import json
import os
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path
from threading import Event, Thread

import numpy as np

from lacet.daq.bus.queue import BoundedQueue
from lacet.daq.formats.log import LogReader, LogWriter, StartRecord
from lacet.daq.frames import Frames
from lacet.daq.rig import Rig
from lacet.services.acquisition.player import replay
from lacet.services.acquisition.recorder import Recorder
from lacet.services.acquisition.stream_decoder import Decoder
from lacet.services.acquisition.transports.can import SocketCanSender, has_socketcan, socketcan_receiver
from lacet.services.acquisition.transports.endpoints import default_endpoint, open_receiver, open_sender
from lacet.services.acquisition.transports.reader import Reader


def say(check: str, ok: bool, **facts: object) -> None:
    """One line for the test outside."""
    print(json.dumps({"check": check, "ok": bool(ok), **facts}), flush=True)


def replay_into_record(folder: Path) -> None:
    """The capture's CAN buses over vcan0 and vcan1 into the recorder's loop; what is logged is the capture."""
    capture = LogReader(folder / "capture.mcap")
    rig = Rig.parse(capture.start.rig_text)
    stored = {name: capture.frames(name) for name in ("can0", "can1")}
    places = {name: default_endpoint(rig.buses, name, sending=True) for name in stored}
    say("vcan is chosen by itself", places == {"can0": "socketcan:vcan0", "can1": "socketcan:vcan1"}, places=places)
    senders = {name: open_sender(rig.buses[name], place) for name, place in places.items()}
    for sender in senders.values():
        sender.open()
    receivers = [open_receiver(rig.buses[name], default_endpoint(rig.buses, name, sending=False)) for name in stored]
    path = Path(os.environ.get("TMPDIR", "/tmp")) / "log.mcap"
    log = LogWriter(path, StartRecord("vcan", time.time_ns(), "", rig.text))
    recorder = Recorder(receivers, Decoder(rig), log, notify=lambda text: print(text, file=sys.stderr))
    ready = Event()

    def play() -> None:
        ready.wait(30.0)
        replay(stored, senders, 0.5)

    player = Thread(target=play)
    player.start()
    before = time.time_ns()
    summary = recorder.run(Event(), until_idle=3.0, on_ready=ready.set)
    player.join()
    got = LogReader(path)
    same = all(
        np.array_equal(got.frames(name).data, frames.data)
        and np.array_equal(got.frames(name).ident, frames.ident)
        and np.array_equal(got.frames(name).lengths, frames.lengths)
        and got.frames(name).t_ns[0] >= before
        and np.all(np.diff(got.frames(name).t_ns) >= 0)
        for name, frames in stored.items()
    )
    say("replay into record", same and not summary.losses, frames=summary.frames, losses=summary.losses)
    samples = {name: len(block) for name, block in got.blocks().items()}
    say("channels are decoded", len(samples) == 25 and min(samples.values()) > 0, samples=len(samples))


ERRORS = ((0x004, 0x10), (0x040, 0), (0x100, 0))
"""Error frames (class, state of the controller) of error passive, bus-off and restart; linux/can/error.h."""
DOWN_SECONDS = 3.0
ALMOST = 60
"""Most frames that are sent in the half second in which the interface is up and the recorder does not know yet, and in
the moment in which it goes down."""


def faults_in_mid_run(folder: Path) -> None:
    """Both buses at once: error frames on the first, the second one's interface down for 3 s and up again."""
    capture = LogReader(folder / "capture.mcap")
    rig = Rig.parse(capture.start.rig_text)
    stored = {name: capture.frames(name) for name in ("can0", "can1")}
    receivers = [open_receiver(rig.buses[name], default_endpoint(rig.buses, name, sending=False)) for name in stored]
    path = Path(os.environ.get("TMPDIR", "/tmp")) / "faults.mcap"
    told: list[str] = []
    log = LogWriter(path, StartRecord("faults", time.time_ns(), "", rig.text))
    recorder = Recorder(receivers, Decoder(rig), log, notify=told.append)
    ready = Event()
    unsent = dict.fromkeys(stored, 0)

    def play(name: str, frames: Frames) -> None:
        ready.wait(30.0)
        sender = SocketCanSender(name, f"v{name}")
        sender.open()
        begun, first = time.monotonic(), int(frames.t_ns[0])
        for i in range(len(frames)):
            time.sleep(max(0.0, begun + 3.0 * (int(frames.t_ns[i]) - first) / 1e9 - time.monotonic()))
            before = sender.unsent
            try:
                sender.send(frames[i : i + 1])
                unsent[name] += sender.unsent - before
            except OSError:  # the interface is down
                unsent[name] += 1
        sender.close()

    def disturb() -> None:
        ready.wait(30.0)
        time.sleep(1.0)
        with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as raw:
            raw.bind(("vcan0",))
            for bits, state in ERRORS:
                raw.send(struct.pack("=IB3x8s", 0x2000_0000 | bits, 8, bytes([0, state, 0, 0, 0, 0, 0, 0])))
        subprocess.run(["ip", "link", "set", "vcan1", "down"], check=True)
        time.sleep(DOWN_SECONDS)
        subprocess.run(["ip", "link", "set", "vcan1", "up"], check=True)

    threads = [Thread(target=play, args=item) for item in stored.items()] + [Thread(target=disturb)]
    for thread in threads:
        thread.start()
    summary = recorder.run(Event(), until_idle=4.0, on_ready=ready.set)
    for thread in threads:
        thread.join()
    got = LogReader(path)
    causes = {name: summary.losses.get(name, {}) for name in stored}
    whole = np.array_equal(got.frames("can0").data, stored["can0"].data) and unsent["can0"] == 0
    errors = {cause: causes["can0"].get(cause) for cause in ("error_passive", "bus_off", "restarted")}
    said = [line for line in told if line.startswith("can0: ") and ("bus-off" in line or "restart" in line)]
    say(
        "bus-off is said, and the data beside it is whole", whole and set(errors.values()) == {1} and len(said) >= 2,
        errors=errors, said=said, losses=causes["can0"],
    )  # fmt: skip
    states = [one.state for one in got.events() if one.name == "can1" and one.state in ("down", "up")]
    came = len(got.frames("can1"))
    lost = len(stored["can1"]) - came
    say(
        "a link that is down for 3 s costs only its own frames",
        causes["can1"].get("link_down") == 1 and states == ["down", "up"] and 0 < lost < len(stored["can1"])
        and unsent["can1"] <= lost <= unsent["can1"] + ALMOST,
        states=states, came=came, lost=lost, unsent=unsent, told=told[-12:],
    )  # fmt: skip


def extended_ids() -> None:
    """29-bit ids come through as themselves."""
    receiver, sender = socketcan_receiver("can0", "vcan0"), SocketCanSender("can0", "vcan0")
    receiver.open()
    sender.open()
    sender.send(Frames.from_iter("can0", [("can0", 0, 0x7FF, b"a"), ("can0", 0, 0x800, b"bc"), ("can0", 0, 1, b"")]))
    got = receiver.read(2.0)
    rows = [(frame.ident, frame.payload) for frame in got]
    say("standard and extended ids", rows == [(0x7FF, b"a"), (0x800, b"bc"), (1, b"")], rows=str(rows))
    receiver.close()
    sender.close()


def overflow() -> None:
    """What the kernel drops is counted to the frame."""
    receiver, sender = socketcan_receiver("can0", "vcan0"), SocketCanSender("can0", "vcan0")
    receiver.open()
    sender.open()
    receiver._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)  # type: ignore[union-attr]
    sender.send(Frames.from_iter("can0", [("can0", 0, i, b"12345678") for i in range(100)]))
    got = 0
    while number := len(receiver.read(0.5)):
        got += number
    lost = receiver.losses().get("kernel", 0)
    say("overflow is counted", 0 < got < 100 and got + lost == 100, received=got, lost=lost, unsent=sender.unsent)
    receiver.close()
    sender.close()


def link_down() -> None:
    """An interface that goes down is flagged, and found again when it is up."""
    queue: BoundedQueue[Frames] = BoundedQueue(100)
    told: list[str] = []
    reader = Reader(socketcan_receiver("can1", "vcan1"), queue, told.append)
    reader.start()
    up = reader.up.wait(10.0)
    subprocess.run(["ip", "link", "set", "vcan1", "down"], check=True)
    until = time.monotonic() + 10.0
    while reader.up.is_set() and time.monotonic() < until:
        time.sleep(0.05)
    down = not reader.up.is_set()
    time.sleep(1.5)
    stayed_down = not reader.up.is_set()
    subprocess.run(["ip", "link", "set", "vcan1", "up"], check=True)
    again = reader.up.wait(10.0)
    sender = SocketCanSender("can1", "vcan1")
    sender.open()
    sender.send(Frames.from_iter("can1", [("can1", 0, 5, b"back")]))
    frames = queue.get(10.0)
    reader.stop()
    reader.join()
    received = frames is not None and frames.frame(0).payload == b"back"
    ok = up and down and stayed_down and again and received and reader.losses() == {"link_down": 1}
    say("link down and up", ok, losses=reader.losses(), told=told)


def main() -> None:
    """Every check, one after the other."""
    say("there is a vcan", has_socketcan("vcan0") and not has_socketcan("vcan7"))
    extended_ids()
    overflow()
    link_down()
    replay_into_record(Path(sys.argv[1]))
    faults_in_mid_run(Path(sys.argv[1]))


if __name__ == "__main__":
    main()
