"""Bias and coverage of ``lacet paper``'s tables 5 to 7 over seeds: road, noise, zeros and clocks drawn anew.

Run: ``python benchmarks/paper_seeds.py`` goes on where it was cut off, in the file ``paper_seeds.jsonl`` beside it, and
writes ``docs/benchmarks/paper-seeds.md`` from what is there; ``--page`` only writes.

Three kinds of trial: *noise*, as ``lacet paper``, judged by the interval of noise and zeros; *sheet*, gains and
latencies drawn from the sensor sheet as well, judged by the interval that includes them; *long*, as *noise*, ten times
as long: its own noise is small enough to show a bias.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from lacet.daq.formats.log_run import build_run
from lacet.daq.formats.result import plain
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.progress import silent
from lacet.identify.properties.whole_vehicle import whole_vehicle
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.validation.parameter_estimates import estimates
from lacet.services.acquisition.capture import encode_rig, simulated_start
from lacet.services.acquisition.stream_decoder import Decoder, decode_frames
from lacet.services.one_thread import one_thread
from lacet.services.reproduction.campaigns import HOUR_NS, RUN_STEP, experiment, fit_campaign
from lacet.services.reproduction.published_tables import LINES
from lacet.services.reproduction.scores import score
from lacet.services.workspace.results import parameter_results
from lacet.simulate import START_NS, Sheet, find_car, make_manoeuvre, measure
from lacet.simulate import run as drive
from lacet.simulate.vehicle_file import vehicle_text

RESULTS = Path(__file__).with_suffix(".jsonl")
PAGE = Path(__file__).parents[1] / "docs" / "benchmarks" / "paper-seeds.md"
KINDS = {"noise": 20, "sheet": 20, "long": 2}
LONG = 600.0
GROUPS = {
    "friction fs": ("fs",),
    "dampers h": ("h",),
    "springs ks": ("ks",),
    "static loads off": ("off",),
    "bars k": ("kar",),
    "tyres kt": ("kt",),
    "whole vehicle": ("XX", "ZZ", "XZ", "X_", "Y_", "Z_", "M6"),
}


def trial(kind: str, seed: int) -> dict[str, Any]:
    """One campaign: each line's truth, estimate and half of its 95 % interval, and the friction's v0 found."""
    began = time.process_time()
    campaign, sheet = experiment(), Sheet(gains=kind == "sheet", latencies=kind == "sheet", seed=seed)
    if kind == "long":
        campaign = campaign.shortened(LONG)
    car, rig = find_car(campaign.car), Rig.load(campaign.rig)
    text = vehicle_text(car)
    vehicle, runs, truth = Vehicle.parse(text), list[PreparedRun](), dict[str, Any]()
    for index, (name, settings) in enumerate(campaign.manoeuvres):
        run_seed, start_ns = seed + RUN_STEP * index, START_NS + index * HOUR_NS
        motion = drive(car, make_manoeuvre(name, **settings), campaign.hidden, run_seed)
        truth = truth or plain(motion.truth())
        blocks = measure(motion, rig, run_seed, sheet=sheet, start_ns=start_ns)
        frames, documents = encode_rig(blocks, rig)
        decoded = decode_frames(Decoder(rig, documents), list(frames.values()))
        run = build_run(name, simulated_start(name, motion, rig, text, start_ns), decoded)
        runs.append(PreparedRun.of(run, vehicle, rig))
    fitted = fit_campaign(campaign, vehicle, rig.wheel_reference, runs, silent)
    found = plain(parameter_results(fitted, estimates(fitted, runs=fitted.runs), whole_vehicle(fitted, vehicle)))
    for part in (*found["parameters"], *found["whole_vehicle"]) if kind == "sheet" else ():
        part["half95"] = part["half95_sheet"]
    scored = [score(line, truth, {**found, "rows_left_out": {}}, False) for line in LINES if line.table >= 5]
    return {
        "kind": kind,
        "seed": seed,
        "v0": next(effect.shape["v0"] for effect in fitted.model.effects if effect.name == "coulomb"),
        "lines": {s.line.name: [s.truth, s.estimate, s.half95] for s in scored if s.estimate is not None},
        "seconds": round(time.process_time() - began),
    }


def done() -> list[dict[str, Any]]:
    """The trials on file."""
    return [json.loads(line) for line in RESULTS.read_text().splitlines()] if RESULTS.exists() else []


def page(trials: Sequence[dict[str, Any]]) -> str:
    """The page in Markdown."""
    parts = [HEAD]
    for kind, goal in KINDS.items():
        some = [one for one in trials if one["kind"] == kind]
        if some:
            parts.append(_section(kind, some, goal))
    return "\n\n".join(parts) + "\n"


HEAD = """# Tables 5 to 7 of the paper over seeds: bias and coverage

`python benchmarks/paper_seeds.py` draws road, noise, zeros and clocks of `lacet paper`'s experiment anew, seed by seed,
over the instruments' bytes and the drivers, and compares the estimates with what was put in. Friction has a band of
5 mm/s, below the noise of the travel rate (7 mm/s). *Bias* is the mean error over seeds, with its 95 % interval; *z*
the mean of error ÷ σ, which is 0 ± 2/√n without bias; *held* how often the 95 % interval held the truth, with the
interval of that share (Clopper and Pearson). Each seed is a line of
[paper_seeds.jsonl](../../benchmarks/paper_seeds.jsonl)."""

ABOUT = {
    "noise": "## Noise, zeros and clocks drawn\n\nThe interval is that of noise and zeros (`95 %`).",
    "sheet": "## Gains and latencies drawn too\n\nFrom the sensor sheet; the interval includes them (`with sheet`).",
    "long": f"## Runs ten times as long\n\nTwo runs of {LONG:g} s, noise, zeros and clocks drawn.",
}


def _section(kind: str, some: Sequence[dict[str, Any]], goal: int) -> str:
    lines = [
        ABOUT[kind],
        "",
        f"Seeds measured: {len(some)} of {goal}. v0 found: "
        + ", ".join(f"{1000 * v:g} mm/s in {n}" for v, n in _counts([one["v0"] for one in some]))
        + ".",
        "",
        "| values | bias | z | held |",
        "|---|---:|---:|---:|",
    ]
    names = list(some[0]["lines"])
    for title, starts in GROUPS.items():
        group = [name for name in names if name.startswith(starts)]
        whole = title == "whole vehicle"
        lines.append(_row(f"**{title}**", some, group, relative=not whole))
        lines += [_row(name, some, [name], relative=name not in ("XZ_G", "Y_G")) for name in group]
    lines.append(_row("**all**", some, names, relative=False))
    return "\n".join(lines)


def _counts(values: Sequence[float]) -> list[tuple[float, int]]:
    return [(v, values.count(v)) for v in sorted(set(values))]


def _row(title: str, some: Sequence[dict[str, Any]], names: Sequence[str], relative: bool) -> str:
    found = np.array([[one["lines"][name] for name in names] for one in some], float)
    truth, estimate, half = np.moveaxis(found, -1, 0)
    error, z = estimate - truth, TWO_SIDED_95 * (estimate - truth) / half
    bias = ""
    if relative:
        # Of the mean over the group's places, whose errors in one seed are not independent.
        each = 100.0 * np.mean(error / truth, axis=1)
        doubt = f" ± {TWO_SIDED_95 * np.std(each, ddof=1) / np.sqrt(len(each)):.2f}" if len(each) > 1 else ""
        bias = f"{np.mean(each):+.2f}{doubt} %"
    held, count = int(np.count_nonzero(np.abs(z) <= TWO_SIDED_95)), z.size
    low, high = binomtest(held, count).proportion_ci()
    share = f"{held} of {count}" + (f" ({100 * low:.0f} to {100 * high:.0f} %)" if count > 1 else "")
    return f"| {title} | {bias} | {np.mean(z):+.2f} | {share} |"


def main(argv: Sequence[str] | None = None) -> None:
    """Run what is missing, then write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--kinds", nargs="+", choices=[*KINDS], default=[*KINDS])
    parser.add_argument("--page", action="store_true", help="only write the page")
    args = parser.parse_args(argv)
    known = {(one["kind"], one["seed"]) for one in done()}
    for kind in args.kinds if not args.page else ():
        for seed in range(1, KINDS[kind] + 1):
            if (kind, seed) not in known:
                with one_thread():
                    found = trial(kind, seed)
                with RESULTS.open("a") as file:
                    file.write(json.dumps(found) + "\n")
                print(f"{kind} {seed}: {found['seconds']} s", file=sys.stderr, flush=True)
                PAGE.write_text(page(done()), encoding="utf-8")
    PAGE.write_text(page(done()), encoding="utf-8")


if __name__ == "__main__":
    main()
