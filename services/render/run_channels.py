"""The channels of a run as text: one line a sensor, with what it measures, its samples and rates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from lacet.daq.pauses import pauses
from lacet.daq.run import Signal
from lacet.daq.stuck import instrument
from lacet.identify.signals.own_rate import at_own_rate
from lacet.services.render import tables
from lacet.services.render.pauses import pause_lines


def channels_text(signals: Mapping[str, Signal]) -> str:
    """One line a sensor, those at the wheels together; below them channels with unusable samples, or with pauses.

    Samples and rates [Hz] are the lowest to the highest of its channels where they differ; a channel that is slower
    than its table has those between its empty cells.
    """
    signals = {name: at_own_rate(signal) for name, signal in signals.items()}
    groups: dict[str, list[str]] = {}
    for name in signals:
        groups.setdefault(instrument(name)[0], []).append(name)
    lines = [
        [
            sensor,
            _measured(names),
            _span([float(len(signals[name].t)) for name in names], 0),
            _span([_rate(signals[name]) for name in names], 1),
        ]
        for sensor, names in groups.items()
    ]
    unusable = {name: int((~s.usable).sum()) for name, s in signals.items()}
    parts = [f"{name} {number} of {len(signals[name].t)}" for name, number in unusable.items() if number]
    text = tables.table(["sensor", "channels", "samples", "Hz"], lines, text_columns=2)
    listed = ", ".join(parts) or "none"
    paused = pause_lines({name: pauses(signal.t) for name, signal in signals.items()})
    lines_below = [f"  unusable samples: {listed}", *(f"  {line}" for line in paused)]
    return "\n".join([text, *(tables.wrapped(line, 4) for line in lines_below)])


def _measured(names: Sequence[str]) -> str:
    """Quantities of a sensor, and at which corners each is there."""
    corners: dict[str, list[str]] = {}
    for name in names:
        sensor, corner = instrument(name)
        corners.setdefault(name.removeprefix(f"{sensor}.").removeprefix(f"{corner}."), []).append(corner or "")
    alike: dict[tuple[str, ...], list[str]] = {}
    for quantity, where in corners.items():
        alike.setdefault(tuple(where), []).append(quantity)
    return "; ".join(f"{' '.join(where)} {', '.join(quantities)}".strip() for where, quantities in alike.items())


def _rate(signal: Signal) -> float:
    """Mean rate [Hz]; 0 of a single sample."""
    return (len(signal.t) - 1) / (signal.t[-1] - signal.t[0]) if len(signal.t) > 1 else 0.0


def _span(values: Sequence[float], digits: int) -> str:
    low, high = f"{min(values):.{digits}f}", f"{max(values):.{digits}f}"
    return low if low == high else f"{low} to {high}"
