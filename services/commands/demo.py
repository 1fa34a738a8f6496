"""``lacet demo``: the whole chain on committed captures, from bytes on wires to the missing effects and the report."""

from __future__ import annotations

import argparse
import json
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path

from lacet.daq.errors import UsageError
from lacet.daq.formats.log import LogReader
from lacet.daq.formats.open_run import open_run
from lacet.daq.formats.result import DONE, WITH_LOSSES, write_result
from lacet.daq.parts import require
from lacet.identify.selection.diagnosis import Diagnosis
from lacet.identify.validation.noise_floor import DEFAULT_DRAWS
from lacet.identify.validation.score import failing_rows, pooled_ratio, worst_row
from lacet.services.commands import decode
from lacet.services.commands.progress import Line
from lacet.services.render import tables
from lacet.services.render.intervals import with_interval
from lacet.services.render.verdicts import print_change, print_diagnosis
from lacet.services.workspace.loading import find_rig, find_vehicle
from lacet.services.workspace.report import write_report
from lacet.services.workspace.results import diagnosis_result
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study

HELP = "run the whole chain on committed captures: wires, log, bus, worker, fit, missing effects, report"
DESCRIPTION = """\
Play a capture over virtual CAN, a pseudo-terminal and UDP into a recorder, which logs it and publishes it to a worker;
the worker assembles the run and fits the base model. The other captures are decoded from their files. Then the model is
compared with the measurement, the missing effects are ranked and added one by one, and a report is written.

  lacet demo                                        the captures with hidden anti-roll bars
  lacet demo --captures replay_logs/nothing-hidden  nothing should be found
  lacet demo --out DIR                              where everything goes (default: demo-out)"""

_ROOT = Path(__file__).resolve().parents[2]
_LIVE, _HELD = "sinus", ("spiral", "braking")
DRAWS = 39


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "--captures", metavar="DIR", type=Path, default=_ROOT / "replay_logs" / "anti-roll-bars", help="raw captures"
    )
    parser.add_argument("--out", metavar="DIR", type=Path, default=Path("demo-out"), help="where everything goes")
    parser.add_argument("--draws", type=int, default=DRAWS, help=f"noise-floor simulations (default {DRAWS})")


def run(args: argparse.Namespace) -> int:
    """Run the demonstration."""
    require("plots")
    captures = {file.stem: file for file in sorted(args.captures.glob("*.mcap"))}
    if _LIVE not in captures or len(captures) < 2:
        raise UsageError(f"{args.captures} does not hold captures ({_LIVE}.mcap and others); run it in lacet's folder")
    began = time.monotonic()
    out: Path = args.out
    _make_room(out)
    print(f"1. {_LIVE}.mcap goes over the wires at 1×: replay → recorder → log and bus → worker.", flush=True)
    status = _over_the_wires(captures[_LIVE], out, [file for name, file in captures.items() if name != _LIVE])
    _report_of_worker(out)
    print("\n2. A study: the base model against the measurement.", flush=True)
    runs = {name: out / f"{name}.mcap" for name in captures}
    used = [file for name, file in runs.items() if name not in _HELD]
    held = [file for name, file in runs.items() if name in _HELD]
    first = open_run(used[0])
    study = Study.create(out / "study", used, held, find_rig(first, None), find_vehicle(first, None), draws=args.draws)
    with Line("demo") as line:
        session = Session(study, line.progress)
        version = session.record({}, "base model")
        rows = version.result["rows"]
        where, ratio = worst_row(rows["used"])
        failing = failing_rows(rows["used"])
        print(
            f"   Error ÷ noise floor: {pooled_ratio(rows['used']):.2f} on the runs used, "
            f"{pooled_ratio(rows['held']):.2f} on those held out."
        )
        print(
            f"   Rows that fail: {', '.join(failing) or 'none'}"
            + (f" (most: {where}, {ratio:.1f} times)" * bool(failing))
        )
        print(
            f"\n3. What is missing? ({args.draws} noise-floor simulations here; a study does {DEFAULT_DRAWS}.)",
            flush=True,
        )
        added = session.add_missing(
            diagnosed=_show,
            added=print_change,
        ).changes
        print("4. How the error fell.\n" + tables.history(session.study.versions()), flush=True)
        report = out / "report.html"
        write_report(session, report)
    seconds = time.monotonic() - began
    print(f"\nDone in {seconds:.0f} s.\n  report: {report}\n  logs:   {', '.join(str(f) for f in runs.values())}")
    print(f"\nTry next:\n{_next(called(), out / 'study')}")
    write_result(args.json, "demo", {"added": added, "report": report, "logs": runs, "seconds": seconds})
    return status


def called() -> str:
    """How the shell calls this program: its name where that finds it, else the path that it was started by."""
    started, found = Path(sys.argv[0]), shutil.which("lacet")
    here = started.stem != "lacet" or (found is not None and Path(found).samefile(started))
    return "lacet" if here else str(started)


def _next(program: str, study: Path) -> str:
    nothing = _ROOT / "replay_logs" / "nothing-hidden"
    if nothing.is_relative_to(Path.cwd()):
        nothing = nothing.relative_to(Path.cwd())
    lines = {
        f"ui {study} --open": "the same on a page in the browser",
        f"compare {study}": "every row, with pictures",
        f"undo {study}": "go back, then add another effect",
        f"demo --captures {nothing} --out demo-nothing": "a car that lacks nothing",
        "--help": "all commands",
    }
    short = [f"{program} {words}" for words in lines]
    width = max(len(line) for line in short)
    return "\n".join(f"  {line:<{width}}   {about}" for line, about in zip(short, lines.values(), strict=True))


def _make_room(out: Path) -> None:
    if out.exists() and any(out.iterdir()) and not (out / ".lacet-demo").exists():
        raise UsageError(f"{out} holds other files; choose another folder with --out")
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    (out / ".lacet-demo").touch()


def _over_the_wires(capture: Path, out: Path, others: list[Path]) -> int:
    """Replay, record and identify in three processes, while the other captures are decoded in this one."""
    wires, router = out / "wires.json", f"tcp/127.0.0.1:{_free_port()}"
    start = LogReader(capture).start
    (out / "rig.toml").write_text(start.rig_text, encoding="utf-8")
    (out / "vehicle.toml").write_text(start.vehicle_text, encoding="utf-8")
    log = out / f"{capture.stem}.mcap"
    recorder = _lacet(
        out, "record", "--rig", out / "rig.toml", "--vehicle", out / "vehicle.toml", "-o", log, "--endpoints", wires,
        "--until-idle", "2", "--listen", router, "--manoeuvre", start.manoeuvre, "--brakes", start.brakes,
    )  # fmt: skip
    worker = _lacet(out, "worker", "--connect", router, "--out", out / "worker", "--once")
    player = _lacet(out, "replay", capture, "--endpoints", wires, "--wait", "30")
    processes = {"replay": player, "record": recorder, "worker": worker}
    status = DONE
    try:
        for file in others:
            parser = argparse.ArgumentParser()
            decode.add_arguments(parser)
            arguments = parser.parse_args([str(file), "-o", str(out / file.name)])
            arguments.json = None
            status = max(status, decode.run(arguments))
        for name, process in processes.items():
            code = _wait(name, process)
            if code:
                print(f"   {name} ended with exit code {code}: see {out / f'{name}.txt'}", flush=True)
                status = WITH_LOSSES
            if name == "record" and not log.exists():
                break  # nothing will reach the worker
    finally:
        for process in processes.values():
            if process.poll() is None:
                process.terminate()
    if not log.exists():
        raise UsageError(f"nothing was recorded: see {out / 'record.txt'}")
    print("   " + "\n   ".join((out / "record.txt").read_text(encoding="utf-8").splitlines()[-3:]))  # how it ended
    return status


def _lacet(out: Path, command: str, *arguments: object) -> subprocess.Popen[bytes]:
    """Start a sub-command in a process of its own; its output goes to ``out/COMMAND.txt``."""
    (out / "worker").mkdir(exist_ok=True)
    text = (out / f"{command}.txt").open("wb")
    return subprocess.Popen(
        [sys.executable, "-m", "lacet", command, *map(str, arguments)],
        stdout=text, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
    )  # fmt: skip


def _wait(name: str, process: subprocess.Popen[bytes], limit: float = 120.0) -> int:
    began = reported = time.monotonic()
    while process.poll() is None:
        if time.monotonic() - began > limit:
            process.terminate()
            return 1
        if time.monotonic() - reported > 5.0:
            reported = time.monotonic()
            print(f"   {name} is at work ({reported - began:.0f} s)", flush=True)
        time.sleep(0.1)
    return process.returncode


def _report_of_worker(out: Path) -> None:
    results = sorted((out / "worker").glob("*.result.json"), key=lambda file: file.stat().st_mtime)
    if not results:
        print(f"   The worker gave no result: see {out / 'worker.txt'}")
        return
    result = json.loads(results[-1].read_text(encoding="utf-8"))
    result = result["result"]
    if "error" in result:
        print(f"   The worker could not fit this run: {result['error']}")
        return
    mass = next((w for w in result.get("whole_vehicle") or [] if w["name"] == "mass"), None)
    if mass is not None:
        print(
            f"   The worker fitted the base model to this run alone: {len(result['parameters'])} parameters, "
            f"mass {with_interval(mass['value'], mass['half95_sheet'])} kg."
        )


def _show(diagnosis: Diagnosis) -> None:
    print()
    print_diagnosis(diagnosis_result(diagnosis), most=4, why=False)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
