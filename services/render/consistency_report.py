"""Sentences on the physical consistency of a fit, the nearest consistent one, and what the runs do not determine."""

from __future__ import annotations

from lacet.identify.multibody.pseudo_inertia import BodyFault, MassFault, MomentFault, TriangleFault
from lacet.identify.properties.consistent_fit import Consistency, ConsistentFit
from lacet.identify.regression.identifiability import explain_grouping, explain_weak
from lacet.identify.regression.information import Information
from lacet.identify.regression.wls import Fit
from lacet.services.render.identifiability import open_direction


def left_open(fitted: Fit) -> list[str]:
    """Parameters that the runs of a fit merge or leave no better known than plausible, one line each; never empty."""
    known = Information.of(fitted)
    found = [
        *explain_grouping(fitted.base, fitted.model, fitted.runs),
        *explain_weak(known.root, known.names, fitted.model, fitted.runs),
    ]
    return [open_direction(one) for one in found] or ["nothing"]


def consistency_words(found: Consistency) -> str:
    """Whether rigid bodies with the fitted values exist, in one line."""
    if not found.judged:
        return "cannot be judged: these runs determine no body's parameters"
    if found.consistent:
        return "consistent: bodies with these values can exist"
    if found.noise_explains:
        return (
            f"not consistent as it stands, by {found.distance:.2g} σ; a consistent car is estimated that far out in "
            f"{100 * found.p:.0f} % of such campaigns, so noise explains it"
        )
    return (
        f"inconsistent by {found.distance:.2g} σ (p = {found.p:.2g}): noise does not explain it; "
        f"most in {found.worst}. Find what the model lacks, and check the instruments"
    )


def body_fault_words(fault: BodyFault | None) -> str:
    """The condition that a body violates; an empty string where there is none."""
    match fault:
        case None:
            return ""
        case MassFault(mass):
            return f"its mass is {mass:.4g} kg"
        case MomentFault(moment):
            return f"a moment of inertia about its centre of gravity is {moment:.4g} kg·m²"
        case TriangleFault(largest, others):
            return (
                f"its largest moment of inertia about its centre of gravity, {largest:.4g} kg·m², is more than the "
                f"other two together, {others:.4g} kg·m²"
            )


def consistency_text(found: Consistency, mended: ConsistentFit) -> str:
    """The consistency analysis as lines of text."""
    lines = [f"Physical consistency: {consistency_words(found)}."]
    for body in found.bodies:
        if body.separable and not body.possible:
            sure = "" if body.clear else " (within its 95 % interval)"
            lines.append(f"  {body.name}: {body_fault_words(body.fault)}{sure}")
    grouped = [body.name for body in found.bodies if not body.separable]
    if grouped:
        lines.append(f"  not separable body by body (counted together with others): {', '.join(grouped)}")
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
