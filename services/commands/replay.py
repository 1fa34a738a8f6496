"""``lacet replay``: send a capture on the wires again."""

from __future__ import annotations

import argparse
import contextlib
import signal
import sys
import time
from pathlib import Path
from threading import Event

from lacet.daq.errors import UsageError, nearest
from lacet.daq.formats.log import LogReader
from lacet.daq.formats.result import DONE, WITH_LOSSES, write_result
from lacet.daq.frames import Frames
from lacet.daq.rig import Rig
from lacet.daq.sources.bus_log import KINDS, is_raw_log, read_bus_log
from lacet.daq.sources.frames import Beside
from lacet.services.acquisition.other_logs import OPTION, frames_for
from lacet.services.acquisition.player import Progress, replay
from lacet.services.acquisition.system_calls import require_linux
from lacet.services.acquisition.transports.base import Sender
from lacet.services.acquisition.transports.endpoints import (
    default_endpoint,
    open_sender,
    parse_assignments,
    ready_file,
    write_endpoints,
)
from lacet.services.acquisition.transports.serial import PtySender
from lacet.services.commands.progress import Line

HELP = "play the raw frames of a run, or of another tool's bus log, onto the wires"
DESCRIPTION = """\
Play the raw frames of a capture (or of any log) onto the wires, so that `lacet record` or any other program receives
them as if the car were there: CAN on vcan where there is one, otherwise as python-can's udp_multicast on this machine;
serial on a pseudo-terminal; UDP on loopback. Values, counters and order are those of the capture; a receiver's stamps
are arrival times. (To keep the stamps, decode the capture instead: lacet decode.)

  lacet replay run.mcap --endpoints wires.json --wait 10 &
  lacet record --rig peugeot-406 --vehicle peugeot-406 -o log.mcap --endpoints wires.json --until-idle 2

  lacet replay run.mcap --speed 4                 four times as fast
  lacet replay run.mcap --speed max               as fast as receivers on this machine read
  lacet replay run.mcap --to can0=socketcan:can0  on a real bus
  lacet replay run.mcap --loop                    again and again, until Ctrl-C

A bus log of another tool (candump, BLF, ASC, TRC, or an MDF bus log) is played in the same way onto the CAN buses of
a rig:

  lacet replay drive.log --rig rig.toml                     buses of the same name, or the only one
  lacet replay drive.mf4 --rig rig.toml --as 2=can0         the log's second bus is the rig's can0"""


_LINGER = 10.0  # s; longest time that the wires stay open after the last frame, for a recorder that waits for silence


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "capture", metavar="CAPTURE", type=Path,
        help="log with raw frames (.mcap), or a bus log (candump, .blf, .asc, .trc, .mf4)",
    )  # fmt: skip
    parser.add_argument(
        "--rig", metavar="RIG", help="rig whose wires a bus log is played onto (default: the capture's)"
    )
    parser.add_argument(
        OPTION, metavar="LOGBUS=BUS", dest="buses", action="append", default=[],
        help="which bus of the rig a bus of the bus log is; may be repeated, others are not played",
    )  # fmt: skip
    parser.add_argument(
        "--to",
        metavar="BUS=ENDPOINT",
        action="append",
        default=[],
        help="where to send a bus: socketcan:IFACE, multicast:[GROUP:]PORT, pty[:LINK], serial:DEVICE, udp:HOST:PORT "
        "(default: see above); may be repeated",
    )
    parser.add_argument("--bus", metavar="BUS", action="append", help="play this bus only; may be repeated")
    parser.add_argument("--speed", metavar="N", default="1", help="factor on the capture's time, or max (default 1)")
    parser.add_argument("--loop", action="store_true", help="begin again at the end, until stopped")
    parser.add_argument("--endpoints", metavar="FILE", type=Path, help="write where each bus is, for `lacet record`")
    parser.add_argument(
        "--wait",
        metavar="S",
        type=float,
        default=0.0,
        help="wait up to S seconds for a recorder given the same --endpoints file to listen",
    )


def run(args: argparse.Namespace) -> int:
    """Replay. Returns 0 when every frame was sent, 3 when some were not or it was stopped."""
    require_linux("replays")
    speed = _speed(args.speed)
    if args.wait and args.endpoints is None:
        raise UsageError("--wait waits for a recorder that was given the same --endpoints FILE: give that as well")
    rig, frames = _frames(args)
    to = parse_assignments(args.to, rig.buses, "--to")
    stop = Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with contextlib.ExitStack() as stack:
        senders = {name: _open(rig, name, to, stack) for name in frames}
        endpoints = {name: sender.endpoint for name, sender in senders.items()}
        print("\n".join(f"{name}: {endpoint}" for name, endpoint in endpoints.items()), file=sys.stderr)
        if args.endpoints is not None:
            ready_file(args.endpoints).unlink(missing_ok=True)
            write_endpoints(args.endpoints, endpoints)
            stack.callback(args.endpoints.unlink, missing_ok=True)
        if args.wait:
            _wait(args, senders, stop)
        with Line("replay") as line:
            progress = replay(frames, senders, speed, args.loop, stop, lambda now: line.show(_describe(now)))
        _linger(args, senders, stop)
    unsent = {name: sender.unsent for name, sender in senders.items() if sender.unsent}
    done = progress.rounds > 0 and (args.loop or progress.sent == progress.total)
    print(_summary(progress, unsent), file=sys.stderr)
    write_result(
        args.json,
        "replay",
        {
            "endpoints": endpoints,
            "frames": progress.total,
            "sent": progress.sent,
            "rounds": progress.rounds,
            "unsent": unsent,
            "complete": done and not unsent,
        },
    )
    return DONE if done and not unsent else WITH_LOSSES


def _frames(args: argparse.Namespace) -> tuple[Rig, dict[str, Frames]]:
    """The rig, and the frames to be sent by its buses."""
    if is_raw_log(args.capture):
        if args.rig is None:
            raise UsageError(f"{args.capture}: a bus log says nothing of wires; give the rig they are in: --rig FILE")
        rig = Rig.load(args.rig)
        damage: list[str] = []
        beside = Beside()
        frames = frames_for(args.capture, rig, args.buses, damage, beside)
        for line in [*damage, *beside.lines()]:
            print(line, file=sys.stderr)
        if unknown := sorted(set(args.bus or ()) - set(frames)):
            raise UsageError(f"--bus {unknown[0]}: played are {', '.join(frames)}{nearest(unknown[0], frames)}")
        return rig, {name: batch for name, batch in frames.items() if name in (args.bus or frames)}
    if args.buses:
        raise UsageError(f"{OPTION} {args.buses[0]}: is for bus logs ({KINDS}); a capture of lacet's knows its buses")
    if args.capture.is_file() and args.capture.suffix.lower() != ".mcap":
        read_bus_log(args.capture)  # raises with what can be played
    log = LogReader(args.capture)
    if not log.sources():
        raise UsageError(f"{args.capture}: no raw frames in it, only decoded samples; a capture is needed")
    if args.rig is not None:
        rig = Rig.load(args.rig)
    else:
        rig = Rig.parse(log.start.rig_text, f"{args.capture} (rig in its start record)")
    chosen = args.bus or log.sources()
    if unknown := sorted(set(chosen) - set(log.sources())):
        known = log.sources()
        raise UsageError(f"--bus {unknown[0]}: the capture has {', '.join(known)}{nearest(unknown[0], known)}")
    if foreign := sorted(set(chosen) - set(rig.buses)):
        raise UsageError(f"{args.capture}: frames of '{foreign[0]}', which is not a bus of its rig; choose with --bus")
    return rig, {source: log.frames(source) for source in chosen}


def _speed(word: str) -> float | None:
    if word == "max":
        return None
    try:
        speed = float(word)
        if not 0.0 < speed < 1e6:
            raise ValueError
    except ValueError:
        raise UsageError(f"--speed {word}: a number greater than 0, or max") from None
    return speed


def _open(rig: Rig, name: str, to: dict[str, str], stack: contextlib.ExitStack) -> Sender:
    sender = open_sender(rig.buses[name], to.get(name) or default_endpoint(rig.buses, name, sending=True))
    try:
        sender.open()
    except OSError as error:
        raise UsageError(f"{name}: cannot send to {sender.endpoint}: {error}") from None
    stack.callback(sender.close)
    return sender


def _wait(args: argparse.Namespace, senders: dict[str, Sender], stop: Event) -> None:
    until = time.monotonic() + args.wait
    while not ready_file(args.endpoints).exists():
        if time.monotonic() > until:
            print(f"no recorder after {args.wait:g} s; playing all the same", file=sys.stderr)
            return
        if stop.wait(0.02):
            return


def _linger(args: argparse.Namespace, senders: dict[str, Sender], stop: Event) -> None:
    """Keep the wires open until the recorder has finished: closing a pseudo-terminal discards its waiting bytes."""
    if args.endpoints is not None:
        until = time.monotonic() + _LINGER
        while ready_file(args.endpoints).exists() and time.monotonic() < until and not stop.wait(0.05):
            pass
    elif any(isinstance(sender, PtySender) and sender.has_reader for sender in senders.values()):
        stop.wait(0.3)


def _describe(progress: Progress) -> str:
    again = f", round {progress.rounds + 1}" if progress.rounds else ""
    return (
        f"{progress.capture_seconds:.1f} of {progress.capture_length:.1f} s, {progress.sent} of {progress.total} "
        f"frames{again}"
    )


def _summary(progress: Progress, unsent: dict[str, int]) -> str:
    lines = [f"played {progress.sent} of {progress.total} frames"]
    lines += [f"{name}: {number} frames that nobody took" for name, number in unsent.items()]
    return "\n".join(lines)
