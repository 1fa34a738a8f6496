"""Verdicts with a sensor sheet whose noise is wrong by a half and by two, each family alone and all together.

Run: ``python benchmarks/sheet_factors.py`` goes on where it was cut off, in ``sheet_factors.jsonl`` beside it, and
writes ``docs/benchmarks/sheet-factors.md``. The reference car's sine and rough runs of ``tests/data/car``, with a
complete model, in which nothing is missing, and without the rear anti-roll bar, which must be named.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

from lacet.daq.channels import CHANNELS
from lacet.daq.rig import Rig
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.regression.model import Model
from lacet.identify.regression.wls import fit
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.validation.noise_floor import floor_of
from lacet.services.one_thread import one_thread
from lacet.services.workspace.loading import load

CAR = Path(__file__).parents[1] / "tests" / "data" / "car"
RESULTS = Path(__file__).with_suffix(".jsonl")
PAGE = Path(__file__).parents[1] / "docs" / "benchmarks" / "sheet-factors.md"
DRAWS = 199
FRONT, REAR = "anti_roll_bar.front", "anti_roll_bar.rear"
HEAD = """# Verdicts with a wrong sensor sheet

`python benchmarks/sheet_factors.py`: the reference car's sine and rough runs, whose noise is that of the sheet, read
with a sheet that states a half or twice of it. *Nothing missing*: the model is complete, and nothing may be named.
*Bar missing*: the model lacks the rear anti-roll bar, which must be named. *Reported*: families whose sheet
lacet calls wrong. The same two runs throughout: it shows what a wrong sheet changes, not how often noise misleads.
A ground laser on the rough road keeps a wrong sheet: motion reaches the band that shows whether its noise is white."""


def families() -> list[str]:
    """Families of channels of the rig, in its order."""
    rig = Rig.load(CAR / "rig.toml")
    return list(dict.fromkeys(CHANNELS[channel].family for sensor in rig.sensors for channel in sensor.channels))


def trial(names: list[str], factor: float, complete: bool) -> dict[str, Any]:
    """The verdict with the sheet's noise of these families times `factor`."""
    text = (CAR / "rig.toml").read_text(encoding="utf-8")
    for name in names:
        text = re.sub(
            rf'("{re.escape(name)}" = )([\d.e-]+)', lambda found: f"{found[1]}{factor * float(found[2]):.6g}", text
        )
    with tempfile.TemporaryDirectory() as folder:
        rig = Path(folder) / "rig.toml"
        rig.write_text(text, encoding="utf-8")
        loaded = load([CAR / "sine.parquet", CAR / "rough.parquet"], rig, CAR / "vehicle.toml")
    known = catalogue(loaded.vehicle, loaded.reference)
    model = Model.of(base_model(loaded.vehicle, loaded.reference)) + known[FRONT]
    fitted = fit(model + known[REAR] if complete else model, loaded.prepared)
    found = diagnose(fitted, floor_of(fitted, DRAWS), [effect for effect in known.values() if not effect.base])
    return {
        "families": "all" if len(names) > 1 else names[0],
        "factor": factor,
        "complete": complete,
        "named": found.best.key if found.best else None,
        "verdict": str(found.verdict),
        "worst": max(found.ratios.values()),
        "told": len(loaded.sheet),
    }


def page(trials: list[dict[str, Any]]) -> str:
    """The page in Markdown."""
    lines = [HEAD, ""]
    for complete, title in ((True, "Nothing missing"), (False, "Bar missing")):
        some = [one for one in trials if one["complete"] is complete]
        right = sum(one["named"] == (None if complete else REAR) for one in some)
        lines += [f"## {title}: right in {right} of {len(some)}", ""]
        lines += [
            "| families | stated ÷ true | named | verdict | worst row ÷ floor | reported |",
            "|---|---:|---|---|---:|---:|",
        ]
        lines += [
            f"| {one['families']} | {one['factor']:g} | {one['named'] or 'nothing'} | {one['verdict']} | "
            f"{one['worst']:.2f} | {one['told']} |"
            for one in some
        ]
        lines.append("")
    return "\n".join(lines).rstrip() + "\n"


def main() -> None:
    """Run what is missing, then write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.parse_args()
    every = families()
    known = [json.loads(line) for line in RESULTS.read_text().splitlines()] if RESULTS.exists() else []
    done = {(one["families"], one["factor"], one["complete"]) for one in known}
    for names in (every, *([name] for name in every)):
        for factor in (0.5, 2.0):
            for complete in (True, False):
                if ("all" if len(names) > 1 else names[0], factor, complete) in done:
                    continue
                with one_thread():
                    found = trial(names, factor, complete)
                with RESULTS.open("a") as file:
                    file.write(json.dumps(found) + "\n")
                known.append(found)
                print(found, file=sys.stderr, flush=True)
                PAGE.write_text(page(known), encoding="utf-8")
    PAGE.write_text(page(known), encoding="utf-8")


if __name__ == "__main__":
    main()
