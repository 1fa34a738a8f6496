"""The run to drive next to distinguish effects, in sentences and a table."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from lacet.identify.design.discrimination import NEEDED, SHOWS, wrong_pick
from lacet.services.render import tables


class RecommendedRun(Protocol):
    """Properties of a possible run that its sentence shows."""

    @property
    def manoeuvre(self) -> str:
        """Manoeuvre, speed and amplitude in words."""
        ...

    @property
    def after(self) -> float:
        """Separation, or √λ of a single effect, after a run of the longest duration."""
        ...

    @property
    def seconds(self) -> float | None:
        """The shortest duration that suffices, or None."""
        ...

    @property
    def sentence(self) -> str:
        """The result expected of the run."""
        ...


def next_text(result: Mapping[str, Any], most: int) -> str:
    """The table of runs and the recommendation."""
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
        + ("as these runs have it" if e["found"] else "an ordinary size: these runs do not show it")
        for e in found["effects"]
    ]
    if alone:
        (e,) = found["effects"]
        sizes = [f"  largest plausible: {_values({**e, 'values': e['largest']})}; ordinary: {_values(e)}"]
    warnings = [f"! {warning}" for warning in found["warnings"]]
    return "\n".join([f"{title}:", *sizes, "", tables.table(head, rows, text_columns=2), "", *warnings, found["says"]])


def _maybe(x: float | None, digits: bool = False) -> str:
    return "-" if x is None else f"{x:.2g}" if digits else short(x)


def _values(effect: Mapping[str, Any]) -> str:
    parts = [f"{value:.3g} {unit}" for value, unit in zip(effect["values"], effect["units"], strict=True)]
    return ", ".join([*parts, *(f"{name} {value:g}" for name, value in effect["shape"].items())])


def hint(tied: bool, untestable: bool, unlisted: bool, laws: Sequence[str], folder: object) -> str:
    """The commands to type, one a line; an empty string where there are none.

    For what is not listed, of which `laws` are descriptions, best first; and for candidates that are tied, or cannot be
    tested.
    """
    out: list[str] = []
    if unlisted:
        out.append(f"When and where it remains: lacet where {folder}")
        if laws:
            line = shlex.quote(f"found = {_at_all_places(laws)}")
            out.append(f"To have the simple law among the effects: lacet effect {folder} {line}, then diagnose again")
    if tied:
        out.append(f"Which run tells them apart: lacet diagnose {folder} --next")
    elif untestable:
        out.append(f"Which run would show an effect that cannot be tested: lacet diagnose {folder} --next EFFECT")
    return "\n".join(out)


def _at_all_places(laws: Sequence[str]) -> str:
    """The first law; at both axles, without a place, where another is the same at the other one."""
    place, _, law = laws[0].partition(": ")
    kind = place.partition(".")[0]
    both = any(other.startswith(f"{kind}.") and other.partition(": ")[2] == law for other in laws[1:])
    return f"{kind}: {law}" if both and kind != "chassis" else laws[0]


def _names(keys: Sequence[str]) -> str:
    return f"tell {keys[0]} from {' and '.join(keys[1:])}" if len(keys) > 1 else f"show {keys[0]}"


def run_sentence(keys: Sequence[str], label: str, seconds: float, now: float, after: float, longest: float) -> str:
    """Result expected of `seconds` of a manoeuvre for the effects `keys`, `now` and `after` `longest` seconds."""
    if len(keys) == 1:
        return (
            f"To {_names(keys)}: drive {label}, {seconds:g} s (at its largest plausible size it would stand out "
            f"{short(after)} times its noise after {longest:g} s, at present {short(now)}; {SHOWS:g} are needed)."
        )
    return (
        f"To {_names(keys)}: drive {label}, {seconds:g} s (separation {short(after)} after {longest:g} s, at "
        f"present {short(now)}; {NEEDED:g} is needed)."
    )


def recommendation(keys: Sequence[str], now: float, best: RecommendedRun | None, tied_now: bool, why: str) -> str:
    """The run to drive, or that none is of use; `why` : reason why a single effect cannot be tested at present."""
    alone = len(keys) == 1
    needed = SHOWS if alone else NEEDED
    if now >= needed and alone and not why:
        return (
            f"To {_names(keys)} no further run is needed: at its largest plausible size it stands out "
            f"{short(now)} times its noise now ({needed:g} are needed)."
        )
    if now >= needed and not alone and not tied_now:
        return f"To {_names(keys)} no further run is needed (separation {short(now)} now; {needed:g} is needed)."
    if best is None:
        return "No manoeuvre of the library could be simulated."
    if now >= needed and not alone:
        return (
            f"The runs at hand could {_names(keys)} (separation {short(now)}; {needed:g} is needed), yet the "
            f"error falls equally with each: both may be missing, or neither. {best.manoeuvre} would show most "
            f"(separation {short(best.after)})."
        )
    if best.seconds is None:
        beginning = f"No manoeuvre of the library is enough to {_names(keys)}: the best is {best.manoeuvre}"
        if alone:
            return (
                f"{beginning}, with which it would stand out {short(best.after)} times its noise at its largest "
                f"plausible size, at present {short(now)}; {needed:g} are needed."
            )
        return (
            f"{beginning}, separation {short(best.after)}, at present {short(now)}; {needed:g} is needed: the wrong "
            f"one would still be picked with {percent(best.after)}."
        )
    if alone:
        return f"{best.sentence} Now: {why}" if why else best.sentence
    return f"{best.sentence} The wrong one is then picked with {percent(best.after)}, at present {percent(now)}."


def tried_words(tried: int, of: int, nothing: bool) -> str:
    """Why not the whole library of manoeuvres was tried."""
    if nothing:
        return f"The strongest manoeuvre of each kind shows nothing of it, so the other {of - tried} were not tried."
    return f"So far {tried} of {of} manoeuvres were tried, the strongest of each kind first; ask again for the others."


def short(x: float) -> str:
    """A separation or √λ in few digits."""
    return f"{x:.0f}" if x >= 10.0 else f"{x:.1f}"


def percent(separation: float) -> str:
    """Probability of choosing the wrong effect."""
    part = 100.0 * wrong_pick(separation)
    return "less than 0.1 %" if part < 0.1 else f"{part:.1f} %" if part < 10.0 else f"{part:.0f} %"
