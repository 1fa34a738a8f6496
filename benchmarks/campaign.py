"""Cost of a campaign against its number of runs, on two workers of which one is killed in the middle.

Each number of runs is fitted by a process of its own; processor time is that of the process (scheduler and client) and
of all its workers, those killed included. The page is docs/benchmarks/campaign.md.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.services.campaign.cluster import Cluster, connected
from lacet.services.campaign.fitting import Campaign, fit_campaign
from lacet.services.campaign.run_reference import Settings
from lacet.services.progress import AnyStep, ServiceStage
from tests.support.places import HOME
from tests.support.short_runs import CAR, write_short_runs

PAGE = HOME / "docs" / "benchmarks" / "campaign.md"
SECONDS = 4.0
"""Length of a run [s]."""
WORKERS = 2
PASS_OF_THE_KILL = 4
"""In the middle of this pass over the runs, of seven, a worker is killed."""


def main() -> None:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--counts", default="1,10,100,1000", help="numbers of runs")
    parser.add_argument("--folder", type=Path, help="where the runs and what was measured are kept (default: nowhere)")
    parser.add_argument("--one", type=int, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.one:
        print(json.dumps(measured(args.one, args.folder)))
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        found: dict[int, dict[str, Any]] = {}
        for count in map(int, args.counts.split(",")):
            file = folder / f"measured-{count}.json"
            if not file.exists():
                words = [sys.executable, "-P", __file__, "--one", str(count), "--folder", str(folder)]
                file.write_text(subprocess.run(words, check=True, capture_output=True, text=True).stdout)
            found[count] = json.loads(file.read_text())
            print(count, found[count], flush=True)
    PAGE.write_text(page(found), encoding="utf-8")


def measured(count: int, folder: Path) -> dict[str, Any]:
    """A campaign of so many runs, one worker killed."""
    runs = write_short_runs(folder / f"runs-{count}", count, SECONDS)
    settings = Settings(Rig.load(CAR / "rig.toml").text, Vehicle.load(CAR / "vehicle.toml").text)
    before, begin, killed = processor_time(), time.monotonic(), list[int]()
    with connected(None, WORKERS) as client:
        ready = time.monotonic()
        started = processor_time()

        def progress(step: AnyStep) -> None:
            """Kill a worker in the middle of a pass."""
            here = step.stage is ServiceStage.CAMPAIGN_PASS and cluster.passes == PASS_OF_THE_KILL
            if here and not killed and step.done >= max(1, step.total // 2):
                killed.append(next(iter(client.run(os.getpid).values())))
                os.kill(killed[0], signal.SIGKILL)

        cluster = Cluster(client, progress)
        found = fit_campaign(cluster, Campaign.of(cluster, [str(run) for run in runs], settings))
        wall = time.monotonic() - ready
        own = resource.getrusage(resource.RUSAGE_SELF)
    after = processor_time()
    return {
        "runs": count,
        "used": len(found.campaign.runs),
        "killed": len(killed),
        "lost": cluster.deaths,
        "passes": cluster.passes,
        "sums": cluster.sums,
        "wall": wall,
        "start": ready - begin,
        "scheduler": own.ru_utime + own.ru_stime - started["own"],
        "workers": after["children"] - before["children"],
        "memory": own.ru_maxrss / 1024.0,
        "largest_sigma": float(max(found.fitted.sigma.values())),
    }


def processor_time() -> dict[str, float]:
    """Processor time of this process and of its children that have ended [s]."""
    own, children = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return {"own": own.ru_utime + own.ru_stime, "children": children.ru_utime + children.ru_stime}


def page(found: dict[int, dict[str, Any]]) -> str:
    """The page."""
    lines = [
        "# Cost of a campaign",
        "",
        f"Written by `benchmarks/campaign.py`: runs of {SECONDS:g} s (windows of the reference car's tables), the base",
        f"model, {WORKERS} local workers, of which one is killed (SIGKILL) in the middle of pass {PASS_OF_THE_KILL}.",
        "Processor time, user and system; that of the workers has their start in it (NumPy, SciPy and lacet loaded in",
        "each, once more in the one that replaces the killed one); that of scheduler and client grows with the time on",
        "the clock, too, because both look after their connections while they wait. Where other programs share the",
        "processors, processor time is longer as well: in a process by itself the tasks of one run take 1.2 s.",
        "",
        "| runs | used | killed | passes over runs | over sums | workers [s] | a run [s] "
        "| scheduler and client [s] | a run [s] | memory [MB] |",
        "|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for one in found.values():
        n = one["runs"]
        lines.append(
            f"| {n} | {one['used']} | {one['killed']} | {one['passes']} | {one['sums']} | {one['workers']:.1f} | "
            f"{one['workers'] / n:.2f} | {one['scheduler']:.1f} | {one['scheduler'] / n:.3f} | {one['memory']:.0f} |"
        )
    big = list(found.values())[-2:]
    if len(big) == 2 and big[1]["runs"] > big[0]["runs"]:
        more = big[1]["runs"] - big[0]["runs"]
        slopes = {who: (big[1][who] - big[0][who]) / more for who in ("workers", "scheduler")}
        lines += [
            "",
            f"Between {big[0]['runs']} and {big[1]['runs']} runs a further one costs {slopes['workers']:.2f} s of a "
            f"worker and {1e3 * slopes['scheduler']:.0f} ms of the scheduler and the client together.",
        ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
