"""Effects in words: labels, the catalogue, channels that a run lacks for one, the outcome of a trial."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from lacet.identify.car.motion import GroundLaserOffset
from lacet.identify.effects.base import Effect, Parameter, is_sensor_fault
from lacet.identify.effects.excluded import ExcludedEffect
from lacet.identify.regression.prepared_run import Unmeasured
from lacet.services.render.rows import CORNER_WORDS
from lacet.services.render.shape_constants import unit_of

_MEASURED = "Already measured: cannot be missing here"
"""Heading of what the measurements hold."""


def effect_label(key: str) -> str:
    """An effect's key in words: ``anti_roll_bar.front`` is ``anti-roll bar, front``."""
    family, *place = key.split(".")
    name = family.replace("anti_roll", "anti-roll").replace("_", " ")
    return ", ".join([name, *(CORNER_WORDS.get(part, part.replace("_", " ")) for part in place)])


def not_measured(lacking: Unmeasured | None) -> str:
    """Channels that an effect needs and a run lacks, in words; an empty string where it lacks none."""
    if lacking is None:
        return ""
    return f"{', '.join(_need(one) for one in lacking.needs)} not measured in {lacking.run}"


_PLAIN = {
    "correvit.speed": "the speed forwards and to the left",
    "imu.attitude": "an attitude, or the speed forwards and to the left",
    "brake.pressure": "the brake pressure",
    "steering.angle": "the steering wheel's angle",
}


def needed(lacking: Unmeasured | None) -> str:
    """What an effect needs and a run lacks, in everyday words where there are."""
    if lacking is None:
        return ""
    return ", ".join(_PLAIN.get(one, one) if isinstance(one, str) else _need(one) for one in lacking.needs)


def _need(one: str | GroundLaserOffset) -> str:
    if isinstance(one, GroundLaserOffset):
        return f"the road under the wheels (lasers stand {1e3 * abs(one.ahead):.0f} mm from their centres)"
    return one


def why_not(lacking: Unmeasured | None, acts_on: Sequence[str]) -> str:
    """Why a run cannot test an effect: what it lacks, or no row acted on; an empty string where it can."""
    if lacking is None and not acts_on:
        return "it never acts in a row that this run has"
    return not_measured(lacking)


def trial_outcome(tried: Sequence[Mapping[str, Any]]) -> str:
    """Outcome of trying a user's effect (``docs/json.md``, ``effect``, `tried`), in a few words."""
    acts = [item["effect"] for item in tried if not item["why_not"]]
    cannot = [f"{item['effect']} cannot be tested ({item['why_not']})" for item in tried if item["why_not"]]
    if not cannot:
        return "acts, with finite values"
    return "; ".join([*([f"acts: {', '.join(acts)}"] if acts else []), *cannot])


def catalogue_text(
    families: Sequence[type[Effect]], variants: Sequence[Effect], measured: Sequence[ExcludedEffect], reference: str
) -> str:
    """Families of the catalogue under their headings, and what the measurements hold under its own.

    `variants` : of all families, on a vehicle whose wheel loads are given at `reference`.
    """
    out: list[str] = []
    heading = ""
    for family in families:
        title = _title(family)
        if title != heading:
            out += _underlined(title)
            heading = title
        out.append(family_text(family, variants, reference))
    out += _underlined(_MEASURED)
    return "\n".join([*out, *(excluded_text(one) for one in measured)])


def family_text(family: type[Effect], variants: Sequence[Effect], reference: str) -> str:
    """A family of effects: where it acts, parameters, what it needs, looks like and is shown by; ends in a line feed.

    `variants` : its own, among others or not, on a vehicle whose wheel loads are given at `reference`.
    """
    own = [effect for effect in variants if effect.name == family.name]
    out = [f"{family.name}: {family.about}"]
    if not own:
        return "\n".join([*out, f"    where: nowhere with {reference} loads", f"    source: {family.source}\n"])
    out.append(f"    where: {_places(own) or 'the whole car'}")
    out.append(f"    rows: {', '.join(family.rows or ('those its channels enter',))}")
    out += [f"    parameter: {parameter}" for parameter in _parameters(own)]
    for shape, values in family.grids.items():
        tried = f"{', '.join(f'{value:g}' for value in values)} {unit_of(family, shape)}".rstrip()
        out.append(f"    tried: {shape} {tried}, plausible {_range(own[0], shape)}")
    if family.needs:
        out.append(f"    needs: {', '.join(family.needs)}")
    out += [f"    seen as: {family.signature}", f"    shown by: {family.shown_by}"]
    if family.looks_like:
        out.append(f"    looks like: {', '.join(family.looks_like)}")
    return "\n".join([*out, f"    source: {family.source}\n"])


def excluded_text(one: ExcludedEffect) -> str:
    """An effect that the measurements hold already, and why; ends in a line feed."""
    return f"{one.name}: {one.about}\n    why not: {one.measured_by}\n    source: {one.source}\n"


def _title(family: type[Effect]) -> str:
    if family.base:
        return "Base model"
    return "Faults of the instruments" if is_sensor_fault(family) else "Effects that may be missing"


def _underlined(title: str) -> list[str]:
    return [title, "-" * len(title)]


def _places(variants: Sequence[Effect]) -> str:
    """Places with what they have in common said once: ``wheel.fl.force.x y z``."""
    groups: dict[str, list[str]] = {}
    for effect in variants:
        head, _, last = effect.where.rpartition(".")
        groups.setdefault(head, []).append(last)
    parts = [
        f"{head}.{{{', '.join(last)}}}" if head and len(last) > 1 else _joined(head, last)
        for head, last in groups.items()
    ]
    return ", ".join(part for part in parts if part)


def _joined(head: str, last: Sequence[str]) -> str:
    return ", ".join(f"{head}.{one}" if head else one for one in last)


def _parameters(variants: Sequence[Effect]) -> list[str]:
    """Each parameter once, with unit, plausible range and sign; those of bodies are listed by `lacet info --model`."""
    if variants[0].name == "body":
        return ["XX … M of every body (lacet info --model)"]
    return list(dict.fromkeys(_parameter(effect, parameter) for effect in variants for parameter in effect.parameters))


def _range(effect: Effect, constant: str) -> str:
    low, high = effect.bounds_of(constant)
    return f"{low:g} to {high:g}"


def _parameter(effect: Effect, parameter: Parameter) -> str:
    sign = "" if parameter.expect == "any" else f", usually {parameter.expect}"
    short = parameter.name.removeprefix(f"{effect.key}.")
    return f"{short} [{parameter.unit}], {parameter.low:g} to {parameter.high:g}{sign}"
