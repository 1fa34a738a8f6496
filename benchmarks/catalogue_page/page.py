"""The text of ``docs/catalogue.md``: what the catalogue says of every effect, and the picture of each.

Nothing is simulated here. What the pictures show (row, error ÷ floor, state) is kept beside them in ``pictured.json``.
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from benchmarks.catalogue_page.cases import CAR, CASES, DURATION, RIG, SEED, Case
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.car.rows import ROWS
from lacet.identify.effects.base import Effect, Parameter, is_sensor_fault
from lacet.identify.effects.catalogue import catalogue, effect_classes
from lacet.identify.effects.excluded import EXCLUDED, ExcludedEffect
from lacet.simulate.linkage import SecondCar
from lacet.simulate.vehicle_file import vehicle_text

PAGE = Path(__file__).parents[2] / "docs" / "catalogue.md"
PICTURES = PAGE.parent / "images" / "effects"
PICTURED = Path(__file__).with_name("pictured.json")
GROUPS = (
    "Suspension", "Tyres", "Aerodynamics", "Body", "Kinematics", "Sensors", "Already measured", "Base model",
)  # fmt: skip
MEASURED = "Already measured"
"""The group of what the measurements hold."""
KINEMATICS = ("anti_dive", "jacking", "pitch_change", "wheel_turn")
"""Modules of effects that correct the bench table's kinematics."""
SIGNS = {"positive": "usually positive", "negative": "usually negative", "any": "either sign"}
NAMES_SHOWN = 3
RUNS = ("RUN", "OTHER")
"""Names of runs, for what differs from one to the next."""

HEAD = """# The catalogue of effects

Every effect `lacet diagnose` can name: its law, the [rows](rows.md) it acts on, and what it leaves in the residual of a
model that lacks it. `make catalogue` writes this page from `identify/effects`. An effect of your own:
[effects.md](effects.md).

**Pictures.** The base model is fitted to two runs of a simulated car ({car}, ordinary noise and zeros) that has the
effect. Left: the residual of one row of the first run ÷ its noise floor (RMS), ± 2 in grey. Right: the same against the
state it follows, its mean in red: a mean that leaves the grey band has the form of the missing law, less what the base
model absorbs (of friction, the damper absorbs the slope). Sizes are chosen to show the form; smaller ones are found.
“`--hide anti_roll_bar.front=15000` in `{run}`” stands for this command:

```sh
{command}
```

Of an effect that the simulator does not have, the force is added to a plain run instead, less what the base model
absorbs.

**Parameters** have the range that is plausible on any car; a value of the unusual sign points to another cause.
Constants that are not linear are tried at the values given.
"""
SHOWN = "anti_roll_bar"
"""The family of the command on top of the page."""


def page() -> str:
    """The whole page."""
    grouped: dict[str, list[type[Effect]]] = {group: [] for group in GROUPS if group != MEASURED}
    for cls in effect_classes().values():
        grouped[group_of(cls)].append(cls)
    found = variants()
    contents = {group: [(cls.name, cls.about) for cls in classes] for group, classes in grouped.items()}
    contents[MEASURED] = [(one.name, one.about) for one in EXCLUDED]
    entries = {
        group: [entry(cls, found.get(cls.name, [])) for cls in classes] for group, classes in grouped.items()
    } | {MEASURED: [excluded_entry(one) for one in EXCLUDED]}
    lines = [HEAD.format(car=CAR, run=_run(CASES[SHOWN]), command=command(CASES[SHOWN]))]
    for group in GROUPS:
        lines += [f"[{group}](#{group.lower().replace(' ', '-')}):", ""]
        lines += [*(f"- {_link(name)}: {about}" for name, about in contents[group]), ""]
    lines.pop()
    for group in GROUPS:
        lines += ["", f"## {group}"]
        for one in entries[group]:
            lines += ["", *one]
    return "\n".join(lines) + "\n"


def group_of(cls: type[Effect]) -> str:
    """The group an effect is listed in."""
    if cls.base:
        return "Base model"
    if is_sensor_fault(cls):
        return "Sensors"
    if cls.name.startswith("aero_"):
        return "Aerodynamics"
    if cls.__module__.rpartition(".")[2] in KINEMATICS:
        return "Kinematics"
    kinds = {row.kind for row in ROWS if row in cls.rows or row.kind in cls.rows}
    return "Body" if kinds == {"chassis"} else "Tyres" if kinds == {"tyre"} else "Suspension"


def variants() -> dict[str, list[Effect]]:
    """Every variant on the reference car, by family, wherever its loads are measured and in each of `RUNS`.

    Of families that it does not have, those of a car with bench tables.
    """
    vehicle, rig = Vehicle.load(CAR), Rig.load(RIG)
    benched = Vehicle.parse(vehicle_text(SecondCar.named("second")))
    out: dict[str, list[Effect]] = {}
    for car, at in ((vehicle, rig.wheel_reference), (vehicle, "hub"), (vehicle, "contact"), (benched, "contact")):
        before = set(out) if car is benched else set[str]()
        for effect in catalogue(car, at, runs=RUNS).values():
            known = out.setdefault(effect.name, [])
            if effect.name not in before and effect.key not in [one.key for one in known]:
                known.append(effect)
    return out


def rows_of(cls: type[Effect]) -> str:
    """The rows an effect acts on, in words."""
    return ", ".join(cls.rows) or "those its channels enter"


def entry(cls: type[Effect], found: list[Effect]) -> list[str]:
    """Everything about one family."""
    case = CASES.get(cls.name)
    lines = [f"### {cls.name}", "", *prose(cls), ""]
    needs = f"; needs {', '.join(f'`{channel}`' for channel in cls.needs)}" if cls.needs else ""
    lines += [f"- **rows**: {rows_of(cls)}; at {places(found)}{needs}", *parameters(found)]
    if found:
        lines += [_constant(found[0], name, values) for name, values in cls.grids.items()]
    lines += [f"- **in the residual**: {cls.signature}", f"- **shown by**: {cls.shown_by}"]
    if cls.looks_like:
        lines.append(f"- **resembles**: {', '.join(_link(name) for name in cls.looks_like)}")
    lines += [f"- **source**: {cls.source}", "", *picture(cls.name, case)]
    return lines


def excluded_entry(one: ExcludedEffect) -> list[str]:
    """Everything about an effect that the measurements hold."""
    return [
        f"### {one.name}", "", one.law, "",
        f"- **cannot be missing**: {one.measured_by}",
        f"- **source**: {one.source}", "", *picture(one.name, CASES.get(one.name)),
    ]  # fmt: skip


def prose(cls: type[Effect]) -> list[str]:
    """The class's docstring as Markdown: law and remarks."""
    return [line.replace("``", "`") for line in inspect.cleandoc(cls.__doc__ or "").splitlines()]


def places(found: list[Effect]) -> str:
    """Where an effect is tried."""
    if [effect.where for effect in found] == [*RUNS]:
        return "each run, by its name"
    named = [effect.where for effect in found if effect.where]
    if not named:
        return "the car as a whole"
    return ", ".join(f"`{name}`" for name in _corners_together(named))


def _corners_together(named: list[str]) -> list[str]:
    """Names with each full set of four corners as one, ``{c}``."""
    corners = ("fl", "fr", "rl", "rr")
    out: list[str] = []
    for name in named:
        parts = name.split(".")
        here = [i for i, part in enumerate(parts) if part in corners]
        short = ".".join("{c}" if i in here else part for i, part in enumerate(parts))
        full = here and all(short.replace("{c}", corner) in named for corner in corners)
        if (one := short if full else name) not in out:
            out.append(one)
    return out


def parameters(found: list[Effect]) -> list[str]:
    """A line for each kind of parameter: names, unit, range and sign, those that differ in the name alone together."""
    kinds: dict[tuple[str, float, float, str], list[str]] = {}
    for effect in found:
        for q in effect.parameters:
            names = kinds.setdefault((q.unit, q.low, q.high, q.expect), [])
            if (name := _short(q, effect)) not in names:
                names.append(name)
    out: list[str] = []
    for (unit, low, high, expect), names in kinds.items():
        shown = ", ".join(f"`{name}`" for name in names[:NAMES_SHOWN]) + (", …" if len(names) > NAMES_SHOWN else "")
        unit = "" if unit == "-" else f" {unit}"
        out.append(f"- {shown}: {_number(low)} to {_number(high)}{unit}, {SIGNS[expect]}")
    return out


def _short(q: Parameter, effect: Effect) -> str:
    return q.name.removeprefix(f"{effect.key}.")


def picture(name: str, case: Case | None) -> list[str]:
    """The picture with what it shows, or why there is none."""
    if case is None:
        return ["No picture: nobody has said yet how to hide it (`benchmarks/catalogue_page/cases.py`)."]
    if case.how == "none":
        return [f"No picture. {case.why}"]
    facts = pictured().get(name)
    if facts is None:
        return ["No picture yet: `python -m benchmarks.catalogue_page`."]
    row, ratio, state = facts["row"], facts["ratio"], facts["state"]
    shown = f"![{row} with {name}, over time and against {state}](images/effects/{name}.png)"
    return [shown, "", f"`{row}` at {ratio:g} floors: {_how(case)}; second run: `{case.beside}`."]


def _how(case: Case) -> str:
    if case.how == "share":
        return f"what the other terms of the base model leave in `{case.run}`"
    if case.how == "law":
        return f"force of `{case.option}` added to `{_run(case)}`"
    if not case.hidden:
        return f"nothing remains, and every simulated car has it: `{case.run}`"
    return f"`--hide {case.option}` in `{_run(case)}`{', not in the second run' if case.only_there else ''}"


def _run(case: Case) -> str:
    """Manoeuvre and settings of the first run, the duration among them."""
    return case.run if " duration=" in case.run else f"{case.run} duration={DURATION:g}"


def command(case: Case) -> str:
    """How to simulate the first run oneself."""
    name, *settings = _run(case).split()
    options = "".join(f" --set {setting}" for setting in settings)
    start = f"lacet simulate --rig {RIG} --manoeuvre {name}{options} --seed {SEED}"
    return f"{start} --hide {case.option} --format parquet -o runs"


def pictured() -> Mapping[str, Any]:
    """What each picture shows, by family."""
    return json.loads(PICTURED.read_text(encoding="utf-8")) if PICTURED.is_file() else {}


def _constant(effect: Effect, name: str, values: Iterable[float]) -> str:
    low, high = (f"{_number(bound)} {effect.grid_units[name]}".rstrip() for bound in effect.bounds_of(name))
    return f"- `{name}` tried at {_values(values)}; plausible: {low} to {high}"


def _values(values: Iterable[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _number(value: float) -> str:
    if value == int(value) and abs(value) < 1e7:
        return f"{int(value):,}".replace("-", "−")
    return f"{value:g}".replace("-", "−")


def _link(name: str) -> str:
    return f"[{name}](#{name})"
