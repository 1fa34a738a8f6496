"""Model of a car in print: its tree, its parameters, and which of them are identified."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lacet.services.render import tables
from lacet.services.render.row_sources import assumptions_table, sources_table


def print_model(model: Mapping[str, Any]) -> None:
    """Print the tree and the parameters of a model."""
    _print_tree(model)
    _print_parameters(model)


def _print_tree(model: Mapping[str, Any]) -> None:
    print(f"{model['vehicle']}: 42 bodies in a tree, {model['wheel_reference']} wheel loads\n")
    rows = [
        [
            str(k["number"]), str(k["antecedent"]), k["corner"] or "-", k["name"], f"{k['kind']} {k['axis']}",
            k["body"] or "-", k["follows"],
        ]
        for k in model["tree"]
    ]  # fmt: skip
    print(tables.table(["joint", "on", "corner", "what it is", "moves", "carries", "follows"], rows, text_columns=7))
    print(
        "\n  Axes at zero angles: x forward, y left, z up. Bodies without a name have no mass. Suspension springs and\n"
        "  dampers act on damper clearance, tyres on tyre deflection."
    )


def _print_parameters(model: Mapping[str, Any]) -> None:
    lines, runs = model["parameters"], model["runs"]
    print(
        f"\nIn principle (any motion, brakes {model['brakes']}): {len(lines)} parameters, of which the equations can "
        f"determine {model['base_rank']}\n(smallest pivot kept ÷ largest dropped: {model['singular_gap']:.1e})."
    )
    for why, rows in _alike(model["rows_left_out"]).items():
        print(tables.wrapped(f"  rows not formed: {', '.join(rows)}: {why}", 4))
    if runs:
        identified = sum(line["with_runs"] not in (None, "no") for line in lines)
        print(f"With {', '.join(runs)}: {identified}.")
    if model["row_sources"]:
        print(f"\n{sources_table(model['row_sources'])}")
        if assumed := assumptions_table(model["row_sources"]):
            print(f"\n{assumed}")
    if model["wheel_reference"] == "hub":
        print("  Axles and wheels are the parts inboard of the dynamometers: spin inertia of rim and tyre is not seen.")
    head = ["parameter", "unit", "effect", "in principle", *(["with runs"] if runs else []), "stands for"]
    body = [
        [
            line["name"], line["unit"], line["effect"], line["in_principle"], *([line["with_runs"]] if runs else []),
            line["group"] if line["group"] != line["name"] else "",
        ]
        for line in lines
    ]  # fmt: skip
    room = tables.WIDTH - sum(max(len(row[k]) for row in (head, *body)) + 2 for k in range(len(head) - 1)) - 2
    cut = [[*row[:-1], row[-1] if len(row[-1]) <= room else row[-1][: room - 2] + " …"] for row in body]
    print("\n" + tables.table(head, cut, text_columns=len(head)))
    for title, asked_for in (
        ("No value of their own, whatever the runs", lambda line: line["in_principle"] == "no"),
        ("Not with these runs", lambda line: line["in_principle"] != "no" and line["with_runs"] == "no"),
    ):
        reasons = _alike({line["name"]: line["why"] for line in lines if asked_for(line)})
        if reasons:
            print(f"\n{title}:")
        for why, names in reasons.items():
            print(tables.wrapped(f"  {', '.join(names)}: {why}", 4))
    for line in (*model["warnings"], *model["notes"]):
        print(tables.wrapped(f"! {line}", 2))


def _alike(reasons: Mapping[str, str]) -> dict[str, list[str]]:
    """Names grouped by their reason."""
    out: dict[str, list[str]] = {}
    for name, why in reasons.items():
        out.setdefault(why, []).append(name)
    return out
