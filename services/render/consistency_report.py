"""For the command line: whether a fit can exist, the nearest that can with its price, and what runs leave open."""

from __future__ import annotations

from typing import Any

from lacet.daq.formats.result import plain
from lacet.identify.progress import Progress, Stage, Step, silent
from lacet.identify.properties.consistent_fit import Consistency, ConsistentFit, consistency, consistent_fit
from lacet.identify.regression.identifiability import explain_grouping, explain_weak
from lacet.identify.regression.information import Information
from lacet.identify.regression.wls import Fit


def mend(fitted: Fit, progress: Progress = silent) -> tuple[Fit, dict[str, Any], str]:
    """The nearest consistent fit, what there is to say about it as data (``docs/json.md``) and as text.

    Raises UsageError without the extra ``consistency``, SolverError when the solver fails.
    """
    progress(Step(Stage.BODY_CONSISTENCY))
    found = consistency(fitted)
    progress(Step(Stage.CONSISTENT_FIT))
    mended = consistent_fit(fitted)
    return mended.fit, consistency_result(found, mended), consistency_text(found, mended)


def left_open(fitted: Fit) -> list[str]:
    """What the runs of a fit merge or leave no better known than plausible, one line each; never empty."""
    known = Information.of(fitted)
    lines = explain_grouping(fitted.base, fitted.model, fitted.drives)
    lines += explain_weak(known.root, known.names, fitted.model, fitted.drives)
    return lines or ["nothing"]


def consistency_result(found: Consistency, mended: ConsistentFit) -> dict[str, Any]:
    """As plain data."""
    price = mended.price
    return plain(
        {
            "consistent": found.consistent,
            "says": found.says,
            "distance_sigma": found.distance,
            "p": found.p,
            "bodies": [
                {
                    "name": body.name,
                    "separable": body.separable,
                    "shared": list(body.shared),
                    "possible": body.possible if body.separable else None,
                    "fault": body.fault if body.separable else "",
                }
                for body in found.bodies
            ],
            "alone_sigma": dict(found.alone),
            "wrong_sign_sigma": dict(found.wrong_sign),
            "price": {
                "quadratic": price.quadratic,
                "residual_percent": price.percent,
                "rows_percent": dict(price.rows),
                "largest_change": {"name": price.largest[0], "sigma": price.largest[1]},
            },
        }
    )


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
