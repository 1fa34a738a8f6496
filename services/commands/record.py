"""``lacet record``: record the wires into a log and onto the bus."""

from __future__ import annotations

import argparse
import contextlib
import secrets
import signal
import time
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from threading import Event
from typing import Any

from lacet.daq.bus.certificates import Role
from lacet.daq.bus.credentials import check_endpoint
from lacet.daq.bus.link import Link
from lacet.daq.bus.publisher import RunPublisher
from lacet.daq.bus.session import ROUTER
from lacet.daq.bus.spool import Spool
from lacet.daq.errors import UsageError
from lacet.daq.formats.log import LogReader, LogWriter, StartRecord
from lacet.daq.formats.result import DONE, WITH_LOSSES, write_result
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.services.acquisition.delivery import EarlierRuns, note_delivery
from lacet.services.acquisition.host_clock import synchronisation
from lacet.services.acquisition.intake import QUEUE_FRAMES, RESUME_FRAMES, Intake
from lacet.services.acquisition.offer import keep_blocks
from lacet.services.acquisition.own_drivers import OPTION as TRUST
from lacet.services.acquisition.own_drivers import own_drivers
from lacet.services.acquisition.recorder import Recorder, Summary
from lacet.services.acquisition.resume import broken_run
from lacet.services.acquisition.run_log import Split
from lacet.services.acquisition.stream_decoder import Decoder
from lacet.services.acquisition.system_calls import require_linux
from lacet.services.acquisition.transports.base import Receiver
from lacet.services.acquisition.transports.endpoints import (
    default_endpoint,
    open_receiver,
    parse_assignments,
    read_endpoints,
    ready_file,
)
from lacet.services.commands.bus_options import add_keys, credentials_of, link_of, router_of
from lacet.services.commands.mark_key import marks_by_key
from lacet.services.commands.progress import Line
from lacet.services.render.live_line import doubtful_counter_text, live_text, lost_text

HELP = "record an instrumented car: log, decode, publish"
DESCRIPTION = """\
Record every bus of the rig: raw frames and decoded channels into one log (MCAP), decoded channels also onto the bus
(Zenoh), where workers (lacet worker) pick them up. The recorder is the bus's router; it listens on this machine only
by default. Ctrl-C ends the run: the log is closed, and the recorder stays until a worker has acknowledged the run, 30
s at most. Runs in the same folder that no worker has yet are offered too, meanwhile and later (or: lacet publish). A
dead link is reported and opened again; a full disk is reported and publishing goes on.

  lacet record --rig peugeot-406 --vehicle peugeot-406 -o run.mcap
  lacet record ... --manoeuvre slalom --brakes off --duration 60
  lacet record ... --split 10min                           run.mcap, run-2.mcap …: read as one run by every command
  lacet record ... -o logs/ --resume                       as a service (docs/in-the-car.md): goes on after a crash
  lacet record ... --endpoints wires.json --until-idle 2   what `lacet replay --endpoints wires.json` sends
  lacet record ... --from can0=socketcan:can1              a bus that is somewhere else today
  lacet record ... --listen tls/0.0.0.0:7447 --keys keys/peugeot     workers on other machines (lacet keys)
  lacet record ... --connect tls/10.0.0.9:7447 --keys keys/peugeot   through a router elsewhere

Exit code: 0, or 3 when frames were lost or none came; what was lost where is printed and in the log."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--rig", metavar="RIG", required=True, help="rig file, or the name of a shipped rig")
    parser.add_argument("--vehicle", metavar="VEHICLE", required=True, help="vehicle file, or a shipped vehicle's name")
    parser.add_argument(
        "-o",
        "--out",
        metavar="LOG",
        type=Path,
        required=True,
        help="log to write (.mcap); in a folder it gets the run's id as its name",
    )
    parser.add_argument("--manoeuvre", default="", help="what is driven, for the record")
    parser.add_argument("--brakes", choices=("off", "used", "unknown"), default="unknown", help="for the record")
    parser.add_argument("--notes", default="", help="anything worth keeping")
    parser.add_argument(
        "--from",
        dest="sources",
        metavar="BUS=ENDPOINT",
        action="append",
        default=[],
        help="where a bus is: socketcan:IFACE, multicast:[GROUP:]PORT, serial:DEVICE, udp:HOST:PORT; may be repeated",
    )
    parser.add_argument("--endpoints", metavar="FILE", type=Path, help="file that says so, as `lacet replay` writes it")
    parser.add_argument("--duration", metavar="S", type=float, help="stop after S seconds")
    parser.add_argument(
        "--split",
        metavar="10min|1GB",
        help="go on in a new file of the same run after a time (s, min, h) or size (MB, GB)",
    )
    parser.add_argument("--until-idle", metavar="S", type=float, help="stop when nothing has come for S seconds")
    place = parser.add_mutually_exclusive_group()
    place.add_argument("--listen", metavar="ENDPOINT", help=f"be the router at (default {ROUTER})")
    place.add_argument("--connect", metavar="ENDPOINT", help="use the router at ENDPOINT")
    place.add_argument("--no-bus", action="store_true", help="log only")
    add_keys(parser, Role.CAR)
    parser.add_argument(
        "--ack-wait", metavar="S", type=float, default=30.0, help="how long to wait for a worker at the end (30 s)"
    )
    parser.add_argument(TRUST, action="store_true", help="run the drivers of your own beside the rig file from now on")
    parser.add_argument(
        "--resume",
        action="store_true",
        help="a recording at LOG that broke off in the last two minutes goes on, in a new file of the same run",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace LOG if it exists")
    parser.add_argument("--drop-live", type=float, default=0.0, help=argparse.SUPPRESS)  # fault tests


def run(args: argparse.Namespace) -> int:
    """Record. Returns 0, or 3 when anything was lost, or nothing came."""
    require_linux("recordings")
    rig = Rig.load(args.rig)
    vehicle = Vehicle.load(args.vehicle)
    split = Split.parse(args.split) if args.split else None
    credentials = credentials_of(args, Role.CAR)
    check_endpoint(args.connect or args.listen or router_of(credentials), credentials)
    own = own_drivers(rig, args.trust)
    decoder = Decoder(rig, own=own.classes)
    receivers = _receivers(args, rig)
    start = StartRecord(
        run_id=f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-{secrets.token_hex(3)}",
        started_ns=time.time_ns(),
        vehicle_text=vehicle.text,
        rig_text=rig.text,
        documents=decoder.documents | dict(own.documents),
        vehicle=vehicle.name,
        manoeuvre=args.manoeuvre,
        wheel_reference=rig.wheel_reference,
        brakes=args.brakes,
        notes=args.notes,
        software=_software(),
        extra={"host_clock": synchronisation()},
    )
    axes = {channel: sensor.axes for sensor in rig.sensors for channel in sensor.channels}
    stop = Event()
    signals: list[int] = []

    def on_signal(number: int, frame: object) -> None:
        signals.append(number)
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, on_signal)
    if hasattr(signal, "SIGHUP"):  # the terminal may go, as a dropped ssh does: the recording stays
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with Line(period=0.5) as line, contextlib.ExitStack() as stack:
        intake = Intake(receivers, line.notify, capacity=RESUME_FRAMES if args.resume else QUEUE_FRAMES)
        if args.resume:
            intake.start()  # what comes while the earlier part is read waits
        broken = broken_run(args.out, rig.text, time.time_ns()) if args.resume else None
        start = start if broken is None else broken.start
        out = args.out / f"{start.run_id}.mcap" if args.out.is_dir() else args.out
        log = broken.next_file(axes) if broken else LogWriter(out, start, axes=axes, overwrite=args.overwrite)
        link = None if args.no_bus else link_of(args, credentials, line.notify)
        publisher = None
        if link is not None:
            stack.callback(link.close)
            car = rig.name if credentials is None else credentials.name
            publisher = _publisher(args, out, link, car, start, line, stack)
            note_delivery(out if broken is None else broken.files[0], start.run_id)
            name = None if credentials is None else credentials.name
            stack.enter_context(EarlierRuns(out.absolute().parent, link, name, start.run_id, line.notify))
            if broken is not None:
                keep_blocks(publisher, LogReader(broken.files[0]))
        recorder = Recorder(
            receivers,
            decoder,
            log,
            publisher,
            axes=axes,
            notify=line.notify,
            report=lambda health: line.show(live_text(health)),
            split=split,
            buses=rig.buses,
            intake=intake,
            resumed_ns=broken.last_ns if broken else None,
        )
        line.notify(f"run {start.run_id}: recording {', '.join(rig.buses)} to {log.path}")
        for note in (noted := decoder.notes):
            line.notify(note)
        with marks_by_key(recorder.mark) as keys:
            if keys:
                line.notify("Enter sets a marker, with the text typed before it; Ctrl-C ends the run")
            summary = recorder.run(stop, args.duration, args.until_idle, lambda: _ready(args))
        for note in decoder.notes:
            if note not in noted:
                line.notify(note)
        if args.endpoints is not None:
            ready_file(args.endpoints).unlink(missing_ok=True)
        line.notify(_closing(summary))
        acks: dict[str, Any] = {}
        if publisher is not None and link is not None:
            wait = args.ack_wait if link.made else 0.0
            line.notify(f"waiting up to {wait:g} s for a worker (Ctrl-C: not any longer)")
            before = len(signals)
            acks = publisher.wait_for_ack(wait, lambda: len(signals) > before)
            if acks:
                note_delivery(out if broken is None else broken.files[0], start.run_id, acks)
            for worker in acks:
                line.notify(f"worker {worker} has the run")
            if not acks:
                line.notify(f"no worker has taken the run yet; later: lacet publish {log.path}")
    write_result(
        args.json,
        "record",
        {
            "run_id": start.run_id,
            "log": log.path if broken is None else broken.files[0],
            "files": [*(broken.files if broken else ()), *summary.files],
            "reason": summary.reason,
            "seconds": summary.seconds,
            "frames": summary.frames,
            "samples": summary.samples,
            "losses": summary.losses,
            "log_error": summary.log_error,
            "acknowledged": acks,
        },
    )
    return WITH_LOSSES if summary.losses or summary.log_error or not any(summary.frames.values()) else DONE


def _receivers(args: argparse.Namespace, rig: Rig) -> list[Receiver]:
    if not rig.buses:
        raise UsageError(f"{args.rig}: the rig has no buses, so there is nothing to record")
    named: dict[str, str] = {}
    if args.endpoints is not None:
        until = time.monotonic() + 10.0
        while not args.endpoints.exists() and time.monotonic() < until:
            time.sleep(0.05)  # for a replay that is starting
        named = read_endpoints(args.endpoints)
    named.update(parse_assignments(args.sources, rig.buses, "--from"))
    if unknown := sorted(set(named) - set(rig.buses)):
        raise UsageError(f"{args.endpoints}: bus '{unknown[0]}' is not in the rig ({', '.join(rig.buses)})")
    return [
        open_receiver(bus, named.get(name) or default_endpoint(rig.buses, name, sending=False))
        for name, bus in rig.buses.items()
    ]


def _publisher(
    args: argparse.Namespace,
    out: Path,
    link: Link,
    car: str,
    start: StartRecord,
    line: Line,
    stack: contextlib.ExitStack,
) -> RunPublisher:
    """The run's publisher on the bus."""
    spool = Spool(out.absolute().parent)
    stack.callback(spool.close)
    publisher = RunPublisher(link.session, car, start, spool, args.drop_live, line.notify)
    stack.callback(publisher.close)
    link.add(publisher)
    return publisher


def _ready(args: argparse.Namespace) -> None:
    if args.endpoints is not None:
        with contextlib.suppress(OSError):
            ready_file(args.endpoints).touch()


def _closing(summary: Summary) -> str:
    lost = lost_text(summary.losses)
    if not lost and not any(summary.frames.values()):
        return f"{summary.reason}. NOTHING CAME: the log has no frame of any bus"
    frames = ", ".join(f"{name} {number}" for name, number in summary.frames.items())
    doubt = doubtful_counter_text(summary.losses, summary.frames)
    said = f"{summary.reason}. Frames: {frames or 'none'}. {'LOST: ' + lost if lost else 'Nothing was lost.'}"
    return f"{said}. {doubt}" if doubt else said


def _software() -> str:
    try:
        return f"lacet {version('lacet')}"
    except PackageNotFoundError:
        return "lacet (not installed)"
