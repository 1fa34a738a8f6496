"""``lacet diagnose --next``: its arguments, its part of the result, and the table."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from lacet.daq.formats.result import plain
from lacet.identify.design.discrimination import NEEDED, SHOWS, Compared, wrong_pick
from lacet.identify.progress import Progress
from lacet.identify.selection.diagnose import Diagnosis
from lacet.services.planning.separation import Recommendation, percent, recommend, short, tied
from lacet.services.render import tables
from lacet.services.workspace.session import Work


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the next run."""
    parser.add_argument(
        "--next", metavar="EFFECT", nargs="*",
        help="which run to drive next: to tell apart the best candidate and those tied with it, or the effects named; "
        "of one effect named, to show it",
    )  # fmt: skip
    parser.add_argument(
        "--without", metavar="NAMES", default="", help="with --next: manoeuvres that cannot be driven, by commas"
    )


def next_of(args: argparse.Namespace, work: Work, diagnosis: Diagnosis, progress: Progress) -> dict[str, Any]:
    """What ``--next`` adds to the result, ready to print; nothing where it was not asked for."""
    if args.next is None:
        return {}
    without = [word.strip() for word in args.without.split(",") if word.strip()]
    found = recommend(work, diagnosis, args.next, without=without, progress=progress)
    return {"next": next_result(found) if found else None}


def next_result(found: Recommendation) -> dict[str, Any]:
    """A recommendation as plain data (``docs/json.md``, ``diagnose``)."""

    def smallest(stands: float, c: Compared) -> float | None:
        single = found.alone and len(c.effect.parameters) == 1 and stands > 0.0
        return c.effect.parameters[0].largest * SHOWS / stands if single else None

    return plain(
        {
            "says": found.says,
            "quantity": "size" if found.alone else "separation",
            "needed": found.needed,
            "now": found.now,
            "effects": [
                {
                    "effect": c.effect.key,
                    "shape": dict(c.effect.shape),
                    "values": list(c.values),
                    "largest": [q.largest for q in c.effect.parameters],
                    "units": [q.unit for q in c.effect.parameters],
                    "found": real,
                    "size": size,
                }
                for c, real, size in zip(found.compared, found.found, found.each, strict=True)
            ],
            "runs": [
                {
                    "run": one.run.label,
                    "manoeuvre": one.run.manoeuvre,
                    "settings": {key: value for key, value in one.run.settings.items() if key != "duration"},
                    "after": one.after,
                    "seconds": one.seconds,
                    "wrong_pick": None if found.alone else wrong_pick(one.after),
                    "ordinary": one.ordinary,
                    "smallest": smallest(one.after, found.compared[0]),
                    "says": one.sentence,
                }
                for one in found.runs
            ],
            "warnings": list(found.warnings),
        }
    )


def next_text(result: Mapping[str, Any], most: int) -> str:
    """The table and the sentence."""
    if "next" not in result:
        return ""
    found = result["next"]
    if found is None:
        return "Nothing is tied with the best candidate. Name effects to tell apart (--next A B), or one to show."
    alone = found["quantity"] == "size"
    runs = found["runs"][:most]
    if alone:
        unit = found["effects"][0]["units"][0]
        head = ["", "run", "√λ now", "largest", "ordinary", f"shows from [{unit}]", "s"]
        cells = [
            [short(found["now"]), short(r["after"]), _maybe(r["ordinary"]), _maybe(r["smallest"], True)] for r in runs
        ]
        title = f"{found['effects'][0]['effect']}: how far it would stand out of its noise ({SHOWS:g} are needed)"
    else:
        head = ["", "run", "T now", "T then", "wrong pick", "s"]
        cells = [[short(found["now"]), short(r["after"]), percent(r["after"])] for r in runs]
        title = f"Separation of {', '.join(e['effect'] for e in found['effects'])} ({NEEDED:g} is needed)"
    rows = [
        [str(i), r["run"], *cell, "-" if r["seconds"] is None else f"{r['seconds']:.0f}"]
        for i, (r, cell) in enumerate(zip(runs, cells, strict=True), 1)
    ]
    sizes = [
        f"  {e['effect']} taken at {_values(e)}, "
        + ("as these runs have it" if e["found"] else "an ordinary size: these runs do not tell it")
        for e in found["effects"]
    ]
    if alone:
        (e,) = found["effects"]
        sizes = [f"  largest plausible: {_values({**e, 'values': e['largest']})}; ordinary: {_values(e)}"]
    warnings = [f"! {warning}" for warning in found["warnings"]]
    return "\n".join([f"{title}:", *sizes, "", tables.table(head, rows, left=2), "", *warnings, found["says"]])


def _maybe(x: float | None, digits: bool = False) -> str:
    return "-" if x is None else f"{x:.2g}" if digits else short(x)


def _values(effect: Mapping[str, Any]) -> str:
    parts = [f"{value:.3g} {unit}" for value, unit in zip(effect["values"], effect["units"], strict=True)]
    return ", ".join([*parts, *(f"{name} {value:g}" for name, value in effect["shape"].items())])


def hint(diagnosis: Diagnosis, folder: object) -> str:
    """What to type when candidates are tied, or cannot be tested; or nothing."""
    if tied(diagnosis):
        return f"Which run tells them apart: lacet diagnose {folder} --next"
    if any(c.answer == "not testable" for c in diagnosis.candidates):
        return f"Which run would show an effect that cannot be tested: lacet diagnose {folder} --next EFFECT"
    return ""
