"""Results as plain text tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from services.fitting import overall


def table(head: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1) -> str:
    """Columns aligned: the first `left` to the left, the others to the right."""
    widths = [max(len(line[k]) for line in (head, *rows)) for k in range(len(head))]

    def line(cells: Sequence[str]) -> str:
        parts = [c.ljust(w) if k < left else c.rjust(w) for k, (c, w) in enumerate(zip(cells, widths, strict=True))]
        return "  " + "  ".join(parts).rstrip()

    return "\n".join([line(head), line(["-" * w for w in widths]), *(line(row) for row in rows)])


def number(value: float, half: float | None = None) -> str:
    """A value to the digits its interval justifies."""
    if half is None or not 0.0 < half < float("inf"):
        return f"{value:.5g}"
    digits = max(0, 1 - _exponent(half))
    return f"{value:.{digits}f}"


def _exponent(value: float) -> int:
    return int(f"{value:e}".split("e")[1])


def parameters(result: Mapping[str, Any]) -> str:
    """The parameters of a fit, with what cannot be identified below."""
    rows = [
        [
            p["name"],
            number(p["value"], p["half95"]),
            f"± {number(p['half95'], p['half95'])}",
            p["unit"],
            f"{p['sxr_percent']:.2f}" if p["sxr_percent"] is not None and p["sxr_percent"] < 1e3 else "-",
            "" if p["group"] == p["name"] else p["group"],
        ]
        for p in result["parameters"]
    ]
    text = table(["parameter", "value", "95 %", "unit", "sxr %", "stands for"], rows)
    if result["whole_vehicle"]:
        whole = [
            [w["name"], number(w["value"], w["half95"]), f"± {number(w['half95'], w['half95'])}", w["unit"]]
            if w["identifiable"]
            else [w["name"], "not identifiable", "", w["unit"]]
            for w in result["whole_vehicle"]
        ]
        about = "inboard of the dynamometers" if result["wheel_reference"] == "hub" else "wheels included"
        text += f"\n\nWhole vehicle at design height ({about}):\n" + table(["value", "", "95 %", "unit"], whole)
    return text


def unknowns(result: Mapping[str, Any]) -> str:
    """What is not identifiable, and why."""
    lines = [f"  {item['name']}: {item['why']}" for item in result["not_identifiable"]]
    return "\n".join(lines)


def left_out(result: Mapping[str, Any]) -> str:
    """The rows without a measured left side by run, those with the same reason together."""
    alike: dict[tuple[str, str], list[str]] = {}
    for place, why in result["rows_left_out"].items():
        run, row = place.rsplit(": ", 1)
        alike.setdefault((run, why), []).append(row)
    return "\n".join(f"  {run}: {', '.join(rows)}: {why}" for (run, why), rows in alike.items())


def rows(scored: Mapping[str, Mapping[str, Any]]) -> str:
    """Scores of every row of every run."""
    lines = [
        [
            run, row, number(s["rms"], s["rms"]), s["unit"], f"{s['nrmse']:.2f}", f"{s['vaf']:.2f}",
            number(s["floor"], s["floor"]), f"{s['ratio']:.2f}" + (" !" if s["ratio"] > 1.2 else "  "),
        ]
        for run, part in scored.items()
        for row, s in part.items()
    ]  # fmt: skip
    return table(["run", "row", "rms", "unit", "NRMSE %", "VAF %", "floor", "rms ÷ floor"], lines, left=2)


def worst(scored: Mapping[str, Mapping[str, Any]]) -> tuple[str, float]:
    """The row farthest above its floor, as ``run: row``, and its ratio."""
    found = [(f"{run}: {row}", s["ratio"]) for run, part in scored.items() for row, s in part.items()]
    return max(found, key=lambda item: item[1], default=("none", 0.0))


def candidates(result: Mapping[str, Any], most: int = 12) -> str:
    """The ranking of a diagnosis."""
    lines = [
        [
            c["effect"], c["answer"], f"{100 * c['gain']:.1f}", f"{c['gain_rms']:.3g}", f"{c['p']:.3f}",
            f"{c['coverage']:.0f}", ", ".join(t["effect"] for t in c["ties"]) or "-",
        ]
        for c in result["candidates"]
        if c["answer"] != "not testable"
    ][:most]  # fmt: skip
    text = table(["effect", "answer", "gain %", "gain N", "p", "blocks", "cannot be told apart from"], lines, left=2)
    rest = [c["effect"] for c in result["candidates"] if c["answer"] == "not testable"]
    if rest:
        text += f"\n  not testable with these runs: {', '.join(rest)}"
    return text


def history(versions: Sequence[Any]) -> str:
    """How the error fell, version by version."""
    lines: list[list[str]] = []
    for v in versions:
        used, held = v.result["rows"]["used"], v.result["rows"]["held"]
        lines.append(
            [
                str(v.number), v.note, f"{overall(used):.2f}", f"{worst(used)[1]:.2f}",
                f"{overall(held):.2f}" if held else "-", f"{worst(held)[1]:.2f}" if held else "-",
            ]
        )  # fmt: skip
    head = ["version", "what changed", "used", "worst row", "held out", "worst row"]
    return table(head, lines, left=2) + "\n  (residual ÷ noise floor, root mean square over rows; 1.00 is the floor)"
