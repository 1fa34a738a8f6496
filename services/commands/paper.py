"""``lacet paper``: reproduce the paper's tables, side by side with its own values."""

from __future__ import annotations

import argparse
import json
import shutil
import time
from pathlib import Path
from typing import Any

from scipy.stats import binom

from lacet.daq.errors import UsageError
from lacet.daq.formats.result import DONE, WITH_LOSSES, plain, write_result
from lacet.daq.parts import require
from lacet.identify.validation.score import worst_row
from lacet.services.commands.progress import Line
from lacet.services.progress import planned
from lacet.services.reproduction.campaigns import (
    PAPER,
    Campaign,
    Places,
    campaigns_of,
    drive_all,
    identify,
    reproduction_plan,
)
from lacet.services.reproduction.published_tables import LINES
from lacet.services.reproduction.scores import MISSED, WITHOUT, Scored, print_tables, score
from lacet.simulate.engine import engine_library
from lacet.simulate.linkage import SECOND_CARS

HELP = "repeat the paper's tables 1 to 7 on the simulated car, side by side with the paper's"
DESCRIPTION = """\
Repeat the paper. Section 4: the simulated Peugeot 406, with the paper's a-priori values, is driven through sinus
steering and a sudden lift-off, the model is fitted, and tables 1 to 4 are printed beside the paper's numbers. A line is
met when our error is no larger than the paper's own or than our 95 % half-width. Section 6: a car with the values of
tables 5 to 7 (friction, anti-roll bars, four corners that differ) is measured with the experimental instruments, over
their bytes; a line is met when the value put in lies in our 95 % interval, which 1 in 20 misses by chance. Figures 4
to 10: measurement and model of the runs used, and beside them of one held out, in validation.html of each campaign's
folder.

  lacet paper                            all tables; what was driven and fitted is kept in paper-out
  lacet paper --tables simulation        tables 1 to 4 alone
  lacet paper --out DIR --seed 7         another folder, other noise, zeros and road
  lacet paper --car second               a car that is not of the model's class, with its bench's tables
  lacet paper --refit                    fit again (after changing lacet) what was driven before
  lacet paper --quick --out quick        runs of 8 s: a trial in a minute, with wider intervals

A second call goes on where the first was stopped. Needs MuJoCo (extra sim) and matplotlib (extra plots).
Exit code 3: a line of tables 1 to 4 is missed, or more of tables 5 to 7 than chance explains."""

QUICK = 8.0
"""Duration of the runs with --quick [s]."""
RARE = 0.01
"""Probability below which the number of lines missed in tables 5 to 7 is no chance."""
MARKER = ".lacet-paper"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--tables", choices=("simulation", "experiment"), help="1 to 4 or 5 to 7 alone (default: all)")
    parser.add_argument("--out", metavar="DIR", type=Path, default=Path("paper-out"), help="default: paper-out")
    parser.add_argument(
        "--car", choices=(PAPER, *SECOND_CARS), default=PAPER, help="the paper's, or a car on linkages (default paper)"
    )
    parser.add_argument("--seed", type=int, default=1, help="of noise, zeros, clocks and road (default 1)")
    parser.add_argument("--quick", action="store_true", help=f"runs of {QUICK:g} s")
    parser.add_argument("--refit", action="store_true", help="fit again what was driven before")
    parser.add_argument("--force", action="store_true", help="drive and fit everything again")


def run(args: argparse.Namespace) -> int:
    """Drive, fit, score; 3 when lines are missed."""
    engine_library()
    require("plots")
    began = time.monotonic()
    campaigns = [c for c in campaigns_of(args.car) if args.tables in (None, c.name)]
    settings = {"seed": args.seed, "quick": args.quick}
    _make_room(args.out, settings if args.car == PAPER else {**settings, "car": args.car}, args.force)
    status, results = DONE, []
    with Line("paper") as line:
        if args.quick:
            campaigns = [campaign.shortened(QUICK) for campaign in campaigns]
        if args.refit:
            for campaign in campaigns:
                Places.of(args.out, campaign).fit.unlink(missing_ok=True)
        line.progress(planned(one for c in campaigns for one in reproduction_plan(c, Places.of(args.out, c))))
        for campaign in campaigns:
            places = Places.of(args.out, campaign)
            drive_all(campaign, places, args.seed, line.progress)
            fitted = identify(campaign, places, line.progress)
            truth = json.loads(places.truth.read_text(encoding="utf-8"))["runs"][0]
            ours = campaign.name == "simulation"
            lines = [one for one in LINES if one.table in campaign.tables]
            scored = [score(one, truth, fitted, ours) for one in lines if args.car == PAPER or not one.of_friction]
            says, failed = _verdict(scored, ours)
            tables = print_tables(scored, ours, args.car != PAPER)
            print(f"{campaign.about[0].upper()}{campaign.about[1:]}.\n\n{tables}\n", flush=True)
            where, ratio = worst_row(fitted["rows"]["used"])
            if args.car != PAPER:
                asked = [one.within for one in scored if one.within is not None]
                print(f"In our 95 % interval, whatever the paper's error: {sum(asked)} of {len(asked)} lines.")
            beside, cross = worst_row(fitted["rows"]["held"])
            print(f"{says}\nWorst row: {where}, {ratio:.2f} times its noise floor.")
            print(f"Held out (cross validation): {beside}, {cross:.2f} times. Figures: {places.figures}", flush=True)
            print(f"{_laws(fitted['shapes'], truth['hidden'])}\n", flush=True)
            status = max(status, WITH_LOSSES if failed else DONE)
            results.append(_result(campaign, scored, fitted, says, failed))
    seconds = time.monotonic() - began
    print(f"Done in {seconds:.0f} s. Runs, fits and truth are in {args.out}.")
    write_result(args.json, "paper", {"campaigns": results, "folder": args.out, "seconds": seconds})
    return status


def _verdict(scored: list[Scored], ours: bool) -> tuple[str, bool]:
    """The verdict on all lines in words, and whether it is a failure."""
    asked = [s for s in scored if s.verdict != WITHOUT]
    missed = [s.line.name for s in asked if s.verdict == MISSED]
    without = [s.line.name for s in scored if s.verdict == WITHOUT]
    text = f"{len(asked) - len(missed)} of {len(asked)} lines met"
    text += f"; missed: {', '.join(missed)}" * bool(missed)
    text += f"; not identifiable: {', '.join(without)}" * bool(without)
    if ours:
        return f"{text}.", bool(missed)
    chance = float(binom.sf(len(missed) - 1, len(asked), 0.05)) if missed else 1.0
    return f"{text}. So many or more by chance: {100 * chance:.2g} % (95 % intervals).", chance < RARE


def _laws(shapes: dict[str, dict[str, float]], hidden: list[dict[str, Any]]) -> str:
    """Shape constants found by search beside the true ones; lines with equal laws are grouped."""
    alike: dict[str, list[str]] = {}
    for name, shape in shapes.items():
        real = next((effect["shape"] for effect in hidden if effect["name"] == name), {})
        given = {k: f" ({real[k]:g} put in)" if k in real else "" for k in shape}
        text = ", ".join(f"{k} = {v:g} found by search{given[k]}" for k, v in shape.items())
        alike.setdefault(text, []).append(name)
    return "\n".join(f"{', '.join(names)}: {text}" for text, names in alike.items())


def _result(
    campaign: Campaign, scored: list[Scored], fitted: dict[str, Any], says: str, failed: bool
) -> dict[str, Any]:
    return {
        "name": campaign.name,
        "about": campaign.about,
        "lines": [s.result() for s in scored],
        "shapes": fitted["shapes"],
        "says": says,
        "failed": failed,
    }


def _make_room(out: Path, settings: dict[str, Any], force: bool) -> None:
    marker = out / MARKER
    if out.exists() and any(out.iterdir()) and not marker.is_file():
        raise UsageError(f"{out} holds other files; choose another folder with --out")
    if force:
        shutil.rmtree(out, ignore_errors=True)
    text = json.dumps(plain(settings))
    if marker.is_file() and marker.read_text(encoding="utf-8") != text:
        was = json.loads(marker.read_text(encoding="utf-8"))
        had = f"seed {was.get('seed')}{' and --quick' * bool(was.get('quick'))}"
        had += f" and --car {was['car']}" if "car" in was else ""
        raise UsageError(f"{out} was made with {had}: give the same, another folder with --out, or --force")
    out.mkdir(parents=True, exist_ok=True)
    marker.write_text(text, encoding="utf-8")
