"""Sentences on physical consistency: whether a fit can exist, the nearest that can, and what the runs leave open."""

from __future__ import annotations

from lacet.identify.properties.consistent_fit import Consistency, ConsistentFit
from lacet.identify.regression.identifiability import explain_grouping, explain_weak
from lacet.identify.regression.information import Information
from lacet.identify.regression.wls import Fit


def left_open(fitted: Fit) -> list[str]:
    """What the runs of a fit merge or leave no better known than plausible, one line each; never empty."""
    known = Information.of(fitted)
    lines = explain_grouping(fitted.base, fitted.model, fitted.runs)
    lines += explain_weak(known.root, known.names, fitted.model, fitted.runs)
    return lines or ["nothing"]


def consistency_text(found: Consistency, mended: ConsistentFit) -> str:
    """In lines for a reader."""
    lines = [f"Physical consistency: {found.says}."]
    for body in found.bodies:
        if body.separable and not body.possible:
            sure = "" if body.clear else " (within its 95 % interval)"
            lines.append(f"  {body.name}: {body.fault}{sure}")
    grouped = [body.name for body in found.bodies if not body.separable]
    if grouped:
        lines.append(f"  not to be told body by body (counted together with others): {', '.join(grouped)}")
    lines += [f"  {name}: of the wrong sign by {far:.2g} σ" for name, far in found.wrong_sign.items()]
    if not found.consistent:
        price = mended.price
        row = max(price.rows, key=lambda name: price.rows[name])
        lines += [
            f"  The parameters are those of the nearest car that can exist. Price: {price.percent:+.2g} % of the "
            f"weighted residual, at most {price.rows[row]:+.2g} % of a row's ({row});",
            f"  {price.largest[0]} moved most, by {price.largest[1]:.2g} of its σ. Intervals are those of the fit "
            "without the constraint: what they hold of the impossible can be cut off.",
        ]
    return "\n".join(lines)
