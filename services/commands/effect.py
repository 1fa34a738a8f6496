"""``lacet effect``: a user's own physical effect, written as one line."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from lacet.daq.errors import UsageError
from lacet.daq.formats.result import DONE, write_result
from lacet.identify.effects.language.compiled import OneLine
from lacet.identify.effects.language.linearity import FUNCTIONS
from lacet.identify.effects.language.misspelling import doubtful, doubtful_words
from lacet.identify.effects.language.parser import LineFault
from lacet.identify.effects.language.states import STATES, SUFFIXES
from lacet.services.commands.progress import Line
from lacet.services.render import tables
from lacet.services.render.effect_text import trial_outcome
from lacet.services.workspace.effect_trial import try_effect
from lacet.services.workspace.loading import load
from lacet.services.workspace.study import Study
from lacet.services.workspace.user_effects import (
    line_result,
    may_have,
    own_classes,
    own_folder,
    own_lines,
    put,
    take_out,
    with_name,
)

HELP = "add an effect of your own to the catalogue of a study, in one line"
DESCRIPTION = """\
An effect is a law with parameters to be found: parameter × something measured, in newtons (newton metres in rows of
moments). One line is enough. It is read (never run as a program), its units are checked, it is tried on the study's
first run and kept in DIR/effects/lines.txt; lacet diagnose then ranks it like every other.

  lacet effect --states                              what a law may use: states with units, functions
  lacet effect DIR "bump = suspension: p * travel**2 * sign(rate)"
  lacet effect DIR "bar = suspension: k * (travel - travel_other)"        coupled with the other side of the axle
  lacet effect DIR "dry = suspension: f * tanh(rate/v0), v0 = 0.01 0.02 0.04 m/s"      a constant that is searched
  lacet effect DIR "stop = suspension.rear: k * max(0, travel - 30 mm), k in 0..500 N/mm"      bounds of a parameter
  lacet effect DIR "drag = chassis.fx: d*speed*abs(speed); chassis.my: m*speed*abs(speed)"     two rows
  lacet effect DIR --try "bump = suspension: p * travel**2"      how a line is read, without keeping it
  lacet effect DIR                                   the study's own effects
  lacet effect DIR --remove bump

The line is  NAME = WHERE: LAW, constants and bounds  (# what it is):
  WHERE   suspension, tyre, spin (each axle and each corner is tried), suspension.front, .rear, .all or a corner
          (.fl .fr .rl .rr); chassis.fx … chassis.mz. Several rows are separated by ';'
  LAW     every free name is a parameter; the law must be linear in them. + - * / ** and the functions of --states;
          numbers may have units (0.02 m/s)
  after a comma: constants, with the values to try; bounds of a parameter, 'p in LOW..HIGH UNIT'
A force in a suspension or tyre row resists compression. A force on the body enters a chassis row with the opposite
sign, because the wheels must balance it: drag is positive in chassis.fx. Docs: effects.md."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("study", metavar="DIR", nargs="?", type=Path, help="the study's folder")
    parser.add_argument("line", metavar="LINE", nargs="?", help="the effect, in quotes")
    parser.add_argument("--states", action="store_true", help="list what a law may use")
    parser.add_argument("--try", dest="only_try", metavar="LINE", help="read a line and try it, do not keep it")
    parser.add_argument("--remove", metavar="NAME", help="remove one of the study's lines")


def run(args: argparse.Namespace) -> int:
    """List, parse, try, store or remove."""
    result: dict[str, Any] = {}
    if args.states:
        result = _states()
    elif args.study is None:
        raise UsageError("name a study, lacet effect DIR LINE, or list what a law may use: lacet effect --states")
    elif args.remove:
        if args.line or args.only_try:
            raise UsageError("either a line, or --remove")
        study = Study.open(args.study)
        take_out(study, args.remove)
        print(f"{args.remove} is removed from {own_folder(study)}.")
        result = {"removed": args.remove}
    elif args.line and args.only_try:
        raise UsageError("either a line that is kept, or --try LINE")
    elif args.line or args.only_try:
        result = _read(Study.open(args.study), args.line or args.only_try, args.line is None)
    else:
        result = _own(Study.open(args.study))
    write_result(args.json, "effect", result)
    return DONE


def _read(study: Study, text: str, only_try: bool) -> dict[str, Any]:
    try:
        cls, stored = with_name(text, study)
    except LineFault as fault:
        doubts = {name: state for name, state in doubtful_words(text).items() if state not in fault.says}
        meant = [f"Is '{name}' the state '{state}'?" for name, state in doubts.items()]
        if not meant:
            raise
        raise UsageError(f"{fault}\n{' '.join(meant)}") from None
    may_have(study, cls)
    found = _described(cls, study)
    first = study.paths()[0]
    with Line("effect") as line:
        line.show(f"trying it on {first.name}")
        loaded = load([first], study.folder / "rig.toml", study.folder / "vehicle.toml", study.filters)
        acts = try_effect(cls, loaded.prepared[0], loaded.vehicle, loaded.reference)
    print(f"  tried on {first.name}: {trial_outcome(acts)}")
    if not only_try:
        replaced = put(study, cls, stored)
        print(f"\n{'Replaced' if replaced else 'Kept'} in {own_folder(study)}. Rank it: lacet diagnose {study.folder}")
        print(f"Or add a variant: lacet add {study.folder} {acts[0]['effect']}")
    return {**found, "line": stored, "kept": not only_try, "tried": acts}


def _described(cls: type[OneLine], study: Study) -> dict[str, Any]:
    """The interpretation of a line."""
    line, effects = cls.line, cls.variants(study.vehicle, study.rig.wheel_reference)
    print(f"{cls.name}: {cls.about}")
    for law in line.rows:
        print(f"  row {law.named} [{law.dimension.unit}]: {law.text}")
    print(f"  variants: {', '.join(e.key for e in effects)}")
    for p in effects[0].parameters:
        name, given = p.name.rpartition(".")[2], "as given" if p.name.rpartition(".")[2] in line.bounds else "plausible"
        print(f"  parameter {name} [{p.unit}], {given} from {p.low:g} to {p.high:g}")
    for name, state in doubtful(line).items():
        print(f"  ! {name} is a parameter here: did you mean the state '{state}'?")
    for name, values in line.grids.items():
        unit = line.constants[name].unit
        print(f"  constant {name} [{unit}], tried: {', '.join(f'{v:g}' for v in values)}")
    for name, use in line.states.items():
        wheel = {"other": ", at the other wheel of the axle", "own": "", "": ""}.get(use.wheel, f", at {use.wheel}")
        print(f"  state {name} [{use.state.unit}]: {use.state.about}{wheel}")
    return line_result(cls, study.vehicle, study.rig.wheel_reference)


def _own(study: Study) -> dict[str, Any]:
    lines, files = own_lines(study), own_classes(study)
    if not lines and not files:
        print(f"The study has no effects of its own. One line makes one: lacet effect {study.folder} LINE")
        print('For instance "bump = suspension: p * travel**2 * sign(rate)"; lacet effect --help explains.')
    for cls in lines:
        print(cls.line.text + (f"  # {cls.line.about}" if cls.line.about else ""))
    for file, names in files.items():
        print(f"{own_folder(study) / file}: {', '.join(names)}")
    return {"lines": [{"effect": cls.name, "line": cls.line.text} for cls in lines], "files": files}


def _states() -> dict[str, Any]:
    wheel = [s for s in STATES.values() if s.wheel]
    body = [s for s in STATES.values() if s.body]
    suffixes = ", ".join(f"_{s}" for s in SUFFIXES)
    print(f"Of the wheel whose row it is; of another wheel with {suffixes} after the name:")
    print(tables.table(["state", "unit", "meaning"], [[s.name, s.unit, s.about] for s in wheel], text_columns=3))
    print("\nOf the body:")
    print(tables.table(["state", "unit", "meaning"], [[s.name, s.unit, s.about] for s in body], text_columns=3))
    print(
        f"\nFunctions: {', '.join(FUNCTIONS)} (min and max of two; lag(x, time), hysteresis(x, length)); "
        "+ - * / ** and brackets; pi."
    )
    return {
        "all_states": [{"name": s.name, "unit": s.unit, "about": s.about, "of": "wheel" if s.wheel else "body"}
                       for s in STATES.values()],
        "suffixes": list(SUFFIXES),
        "functions": list(FUNCTIONS),
    }  # fmt: skip
