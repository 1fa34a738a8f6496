"""The page: goals and what was reached, every case with its sizes, what went wrong with what was named instead."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta

from benchmarks.blind.cases import BANDS, CAMPAIGN, UNSIZED, Cell, Part, cells
from benchmarks.blind.making import HOME
from lacet.identify.intervals import TWO_SIDED_95

PAGE = HOME / "docs" / "benchmarks" / "blind.md"
LOUD = "noise twice the sheet"
HELD_LIMIT = 1.10
KNOWN_WHY = {
    "anti_roll_bar.front+coulomb.front": "Large, the best set explains 72 to 86 % of the residual beside the friction; "
    "the text names the bar as a possible cause in its rows.",
    "aero_side": "At 10 N·s²/m² the plausible range ends; an estimate beyond it (12.2 ± 1.4) is called implausible.",
    "coulomb.rl": "The best set explains 67 to 74 % of the excess; three quarters were asked for.",
    "anti_dive.front": "It takes less than 1 % off each of many rows: reported as beyond chance and too small.",
    "engine_mount": "No row stands above its floor beside the sheet's tolerances; one candidate then takes off what "
    "chance does once in 67 runs.",
    "liquid_load": "The excess over the floor is little more than its own scatter.",
    "sensor_gain.hub.fl": "The sheet leaves this scale open by ± 0.0067 (95 %): 0.011 hidden are three of its own σ.",
    "spring_cubic.front+sensor_gain.hub.fl": "The spring is found; the scale as under sensor_gain.hub.fl.",
}
"""What is known of why a case is missed, by its name."""
Record = Mapping[str, Any]


def bounds(hits: int, of: int, confidence: float = 0.95) -> tuple[float, float]:
    """One-sided Clopper–Pearson bounds of a rate, each with this confidence."""
    alpha = 1.0 - confidence
    low = float(beta.ppf(alpha, hits, of - hits + 1)) if hits else 0.0
    high = float(beta.ppf(1.0 - alpha, hits + 1, of - hits)) if hits < of else 1.0
    return low, high


def named(record: Record, step: int = 0) -> set[str]:
    """What a diagnosis proposed, with what it said cannot be told apart."""
    steps = record.get("steps", [])
    if step >= len(steps) or not steps[step]["best"]:
        return set()
    return {steps[step]["best"], *steps[step]["ties"]}


def hit(record: Record) -> bool:
    """A single effect: the first proposal, or tied with it."""
    return record["keys"][0] in named(record)


def both(record: Record) -> bool:
    """A pair: each by one of the first two proposals."""
    first, second = named(record, 0), named(record, 1)
    a, b = record["keys"]
    return (a in first and b in second) or (b in first and a in second)


def alarm(record: Record) -> bool:
    """A null: anything proposed, or a cause told that is not listed."""
    return bool(named(record)) or unlisted(record)


def unlisted(record: Record) -> bool:
    """An unlisted cause: said so, before or after something else was added."""
    return any(step["verdict"] == "unlisted cause" for step in record.get("steps", []))


def declared(record: Record) -> bool:
    """An unlisted cause: said so at once, and nothing named."""
    return unlisted(record) and not named(record)


def held_right(record: Record) -> bool:
    """The model found leaves no more than 10 % above what the true model leaves of the runs held out."""
    return record["held"]["found"] <= HELD_LIMIT * record["held"]["true"]


def inside(record: Record, parts: Sequence[Part]) -> bool | None:
    """Whether the added effect's parameter holds the truth; None where it was not added or the laws differ.

    What the sheet allows of a fault is in the instrument on top of what was hidden, and in the interval.
    """
    part = parts[0]
    if not part.values or not any(key == part.key for key, _ in record.get("added", [])):
        return None
    found = [value for name, value in record["parameters"].items() if name.startswith(f"{part.key}.")]
    true = part.values[0] * record["hidden"][0][1]
    return abs(found[0][0] - true) <= float(np.hypot(found[0][1], TWO_SIDED_95 * record.get("tolerance", 0.0)))


@dataclass(frozen=True)
class Goal:
    """A goal of the benchmark, and the count it is judged by; `upper`: its upper bound must be below the limit."""

    text: str
    hits: int
    of: int
    limit: float
    upper: bool = False

    def line(self) -> str:
        """A row of the table."""
        if not self.of:
            return f"| {self.text} | – | – | not run |"
        low, high = bounds(self.hits, self.of)
        rate = self.hits / self.of
        met = high <= self.limit if self.upper else rate >= self.limit
        missed = "too few trials to tell" if self.upper and rate <= self.limit else "**missed**"
        band = f"≤ {100 * high:.1f}" if self.upper else f"≥ {100 * low:.1f}"
        return f"| {self.text} | {self.hits} of {self.of}, {100 * self.hits / self.of:.1f} | {band} | " + (
            "met |" if met else f"{missed} |"
        )


def goals(records: Sequence[Record], parts: Mapping[str, Sequence[Part]]) -> list[Goal]:
    """Every goal with its count."""
    ran = [r for r in records if "steps" in r]
    single, pair = [r for r in ran if r["kind"] == "single"], [r for r in ran if r["kind"] == "pair"]
    nulls, causes = [r for r in ran if r["kind"] == "null"], [r for r in ran if r["kind"] == "unlisted"]
    calm, loud = [r for r in nulls if r["band"] != LOUD], [r for r in nulls if r["band"] == LOUD]
    right = [r for r in single if hit(r)]
    told = [value for r in single if (value := inside(r, parts[r["cell"]])) is not None]
    return [
        Goal("the hidden effect, or its tie set, first (≥ 95 %)", _count(single, hit), len(single), 0.95),
        *(
            Goal(f"… {band}, √λ {low:g} to {high:g}", _count(some, hit), len(some), 0.95)
            for band, (low, high, _) in BANDS.items()
            for some in [[r for r in single if r["band"] == band]]
        ),
        Goal("both of a pair (≥ 90 %)", _count(pair, both), len(pair), 0.90),
        Goal("false alarms, noise as the sheet says (95 % bound ≤ 8 %)", _count(calm, alarm), len(calm), 0.08, True),
        Goal("false alarms, noise twice the sheet (95 % bound ≤ 12 %)", _count(loud, alarm), len(loud), 0.12, True),
        Goal("unlisted causes declared unlisted (≥ 90 %)", _count(causes, declared), len(causes), 0.90),
        Goal("… and no effect named with confidence (100 %)", _count(causes, lambda r: not named(r)), len(causes), 1.0),
        Goal(
            "held-out residual within 10 % of the true model's (hits, ≥ 95 %)",
            _count(right, held_right),
            len(right),
            0.95,
        ),
        Goal("the added parameter inside its 95 % interval (same law, ≥ 90 %)", sum(told), len(told), 0.90),
    ]


def _count(records: Iterable[Record], what: Callable[[Record], bool]) -> int:
    return sum(what(r) for r in records)


def instead(records: Iterable[Record], right: Callable[[Record], bool]) -> str:
    """What was said first in the trials that went wrong, most frequent first."""
    said: Counter[str] = Counter()
    for r in records:
        if "failed" in r:
            said["failed"] += 1
        elif not right(r):
            step = r["steps"][0]
            answers = {c["key"]: c["answer"] for c in step["candidates"]}
            what = step["best"] or step["verdict"]
            if r["kind"] == "single" and answers.get(r["keys"][0]) == "not testable":
                what += " (truth: not testable)"
            if r["kind"] == "pair" and named(r) & set(r["keys"]):
                what = f"{step['best']}, then " + (r["steps"][1]["best"] or r["steps"][1]["verdict"])
            said[what] += 1
    return ", ".join(f"{what} × {count}" if count > 1 else what for what, count in said.most_common(4)) or "–"


def size_text(cell: Cell) -> str:
    """Size and √λ of what is hidden."""
    return "; ".join(f"{h.size:.3g} (√λ {root:.0f})" for h, root in zip(cell.hidden, cell.root_lambda, strict=True))


def case_table(
    chosen: Sequence[Cell], by_cell: Mapping[str, list[Record]], right: Callable[[Record], bool]
) -> list[str]:
    """One line a cell."""
    lines = [
        "| hidden, band | size (oracle's √λ) | right | held out ÷ true | said instead |",
        "|---|---|---:|---:|---|",
    ]
    for cell in chosen:
        some = by_cell.get(cell.name, [])
        ran = [r for r in some if "steps" in r]
        if cell.left_out:
            what = "not run" if cell.left_out == UNSIZED else "left out"
            lines.append(f"| {cell.name} | {what}: {cell.left_out} | | | |")
        elif not some:
            lines.append(f"| {cell.name} | {size_text(cell)} | not run | | |")
        else:
            ratios = [r["held"]["found"] / r["held"]["true"] for r in ran if "true" in r["held"]]
            ratio = f"{np.median(ratios):.2f}" if ratios else ""
            lines.append(
                f"| {cell.name} | {size_text(cell)} | {_count(ran, right)} of {len(some)} | {ratio} | "
                f"{instead(some, right)} |"
            )
    return lines


def null_table(chosen: Sequence[Cell], by_cell: Mapping[str, list[Record]]) -> list[str]:
    """False alarms by kind of null."""
    lines = ["| kind | false alarms | 95 % bound | of these unlisted | named |", "|---|---:|---:|---:|---|"]
    for kind in dict.fromkeys(cell.band for cell in chosen):
        some = [r for cell in chosen if cell.band == kind for r in by_cell.get(cell.name, []) if "steps" in r]
        if some:
            hits = _count(some, alarm)
            lines.append(
                f"| {kind} | {hits} of {len(some)} | {100 * bounds(hits, len(some))[1]:.1f} % | "
                f"{_count(some, unlisted)} | {_names(some)} |"
            )
    return lines


def _names(records: Iterable[Record]) -> str:
    said = Counter(r["steps"][0]["best"] for r in records if named(r))
    return ", ".join(f"{key} × {count}" for key, count in said.most_common(6)) or "–"


def missed(records: Sequence[Record], found: Sequence[Goal]) -> list[str]:
    """Where a goal is missed: which cells and what was said, in order of what they cost."""
    if all(not g.of or "**missed**" not in g.line() for g in found):
        return []
    tests = {"single": hit, "pair": both, "unlisted": declared, "null": lambda r: not alarm(r)}
    wrong: dict[str, list[Record]] = {}
    for r in records:
        if "failed" in r or not tests[r["kind"]](r):
            wrong.setdefault(r["cell"].rpartition("/")[0] if r["kind"] != "null" else r["band"], []).append(r)
    lines = ["", "## Where goals are missed", ""]
    for name, some in sorted(wrong.items(), key=lambda item: -len(item[1]))[:20]:
        why = f" {KNOWN_WHY[name]}" if name in KNOWN_WHY else ""
        lines.append(f"- {name}: {len(some)} wrong; said instead: {instead(some, tests[some[0]['kind']])}.{why}")
    return lines


def sharing(records: Sequence[Record]) -> str:
    """Whether trials with a noise floor of their own, as users have it, go as well as those that share one."""
    single = [r for r in records if r["kind"] == "single" and "steps" in r]
    own, shared = ([r for r in single if r.get("shared", False) is told] for told in (False, True))
    if not own or not shared:
        return ""
    return (
        f"A hidden effect was first, or tied, in {_count(own, hit)} of {len(own)} with a floor of their own and "
        f"in {_count(shared, hit)} of {len(shared)} that share one."
    )


def page(results: Mapping[tuple[str, int], Record]) -> str:
    """The page's text."""
    known = cells()
    tried = [cell for cell in known.values() if cell.left_out in ("", UNSIZED)]
    wanted = {(cell.name, seed) for cell in tried for seed in range(1, cell.seeds + 1)}
    records = [results[key] for key in sorted(results) if key in wanted]
    by_cell: dict[str, list[Record]] = {}
    for r in records:
        by_cell.setdefault(r["cell"], []).append(r)
    kinds = {kind: [c for c in known.values() if c.kind == kind] for kind in ("single", "pair", "unlisted", "null")}
    found = goals(records, {cell.name: cell.parts for cell in known.values()})
    seconds = [r["total"] for r in records if "total" in r]
    versions = len({r["code"] for r in records})
    failed = sum("failed" in r for r in records)
    return "\n".join(
        [
            "# The blind benchmark", "",
            "Effects are hidden in an independent simulated car; lacet gets exchange tables, rig and vehicle file, and "
            "says what is missing. Written by `make blind`.", "",
            f"**{len(records)} of {len(wanted)} trials run**" + (f", {failed} of them failed" if failed else "")
            + (f", by {versions} versions of the sources" if versions > 1 else "")
            + ("; what is not run counts for nothing below" if len(records) < len(wanted) else "")
            + (f"; {np.median(seconds):.0f} s of processor time each (median)." if seconds else ".")
            + " Each is a line of [trials.jsonl](../../benchmarks/blind/trials.jsonl).", "",
            f"Car `{CAMPAIGN.car}` (its sides differ, so that no symmetry hides a fault), rig `{CAMPAIGN.rig}`. Runs "
            f"of {CAMPAIGN.duration:g} s: {', '.join(CAMPAIGN.used)} used; {', '.join(CAMPAIGN.held)} held out. Each "
            "trial draws noise, zeros, gains and latencies from the sensor sheet. √λ: how far the effect stands out of "
            "the noise for an oracle that knows its law, beside model, zeros and sheet. Sensor faults are at least 5 "
            "tolerances.", "",
            "A hit: the truth is proposed first, or tied with the first; \"not testable\" is a miss. Bounds are "
            "one-sided 95 % (Clopper–Pearson). Trials of a cell share its motion, "
            f"and {sum(r.get('shared', False) for r in records)} share the noise floor and noise moments of their "
            "cell's first trial. " + sharing(records), "",
            "| goal | reached, % | 95 % bound, % | |", "|---|---|---|---|",
            *(goal.line() for goal in found),
            *missed(records, found), "",
            "## One effect hidden", "", *case_table(kinds["single"], by_cell, hit), "",
            "## Two effects hidden", "", *case_table(kinds["pair"], by_cell, both), "",
            "## Nothing to be found", "", *null_table(kinds["null"], by_cell), "",
            "*Already measured*: rolling resistance, camber thrust and steering compliance, which are in the measured "
            "loads and angles. *Offsets and drift*: a second draw of each zero in every run, drifting as the sheet "
            "allows.", "",
            "## Causes that are not listed", "",
            "Candidates of the family are not offered. Size: √ of what the cause leaves in runs without noise.", "",
            *case_table(kinds["unlisted"], by_cell, declared), "",
        ]
    )  # fmt: skip


def write_page(results: Mapping[tuple[str, int], Record], target: Path | None = None) -> None:
    """Write and print the page."""
    text = page(results)
    target = target or PAGE
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(text, encoding="utf-8")
    print(text)
