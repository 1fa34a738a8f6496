"""``lacet add``: add an effect to a study's model and report the change of the error."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from lacet.daq.errors import UsageError
from lacet.daq.formats.result import DONE, write_result
from lacet.identify.effects.catalogue import find_effect
from lacet.services.commands.progress import Line
from lacet.services.render import tables
from lacet.services.render.intervals import half_width, with_interval
from lacet.services.render.shape_constants import readable
from lacet.services.render.verdicts import print_change
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study

HELP = "add an effect to the model and see the error fall"
DESCRIPTION = """\
Add an effect to the study's present model, fit again and print the error before and after. The study keeps every
version; lacet undo DIR goes back, lacet remove DIR EFFECT removes any effect.

  lacet add DIR anti_roll_bar.front
  lacet add DIR --best                      what the last diagnosis proposed
  lacet add DIR bump_stop.front             its gap and exponent are those that fit these runs best
  lacet add DIR bump_stop.front --shape gap=0.03"""

FAR = 10.0
"""Factor over the largest usual value of a constant from which a wrong unit is suspected."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("study", metavar="DIR", type=Path, help="the study's folder")
    parser.add_argument("effect", metavar="EFFECT", nargs="?", help="an effect (lacet info --effects lists them)")
    parser.add_argument("--best", action="store_true", help="the one the last diagnosis proposed")
    parser.add_argument(
        "--shape", metavar="NAME=VALUE", action="append", default=[], help="a constant of the effect, SI units"
    )


def run(args: argparse.Namespace) -> int:
    """Add, fit, print."""
    study = Study.open(args.study)
    key = args.effect
    if args.best:
        key = (study.diagnosis() or {}).get("best")
        if key is None:
            raise UsageError(f"no diagnosis of version {study.current} proposes anything: lacet diagnose {args.study}")
    if key is None:
        raise UsageError("name an effect, or give --best")
    with Line("add") as line:
        session = Session(study, line.progress)
        known = session.study.effects(session.runs.reference(session.study.version()))
        effect = find_effect(key, known)
        shape = _shape(args.shape, {**{n: v[0] for n, v in effect.grids.items()}, **effect.shape}, effect.grids)
        before = study.version()
        after = session.add(key, shape or None)
        item = session.change(key, before, after)
    print_change(item)
    names = {p.name for p in effect.parameters}
    for p in after.result["parameters"]:
        if p["name"] in names:
            size = f"{with_interval(p['value'], p['half95_sheet'])} {p['unit']}"
            print(f"  {p['name']} = {size} (95 %, with sheet; of noise alone ± {half_width(p['half95'])})")
    for name, constant in after.effects[key].items():
        value, unit = readable(effect, name, constant)
        print(f"  {key}.{name} = {value:.3g} {unit}".rstrip() + ("" if shape else ", as these runs show it"))
    for p in after.result["not_identifiable"]:
        if p["name"] in names:
            print(f"  {p['name']}: not identifiable: {p['why']}")
    print("\n" + tables.history(session.study.versions()))
    write_result(args.json, "add", {"version": after.number, **item})
    return DONE


def _shape(words: list[str], known: dict[str, float], tried: Mapping[str, Sequence[float]]) -> dict[str, float]:
    out: dict[str, float] = {}
    for word in words:
        name, _, value = word.partition("=")
        if name not in known:
            raise UsageError(f"--shape {word}: the effect's constants are {', '.join(known) or 'none'}")
        try:
            out[name] = float(value)
            if not math.isfinite(out[name]):
                raise ValueError
        except ValueError:
            raise UsageError(f"--shape {word}: write {name}=NUMBER") from None
        usual = tried.get(name, ())
        if usual and abs(out[name]) > FAR * max(map(abs, usual)):
            raise UsageError(
                f"--shape {word}: constants are in SI units; {min(usual):g} to {max(usual):g} are usual for {name}"
            )
    return {**known, **out} if out else {}
