"""What a recording shows each second: buses, losses, sensors, and what else it depends on."""

from __future__ import annotations

import textwrap

from lacet.services.acquisition.log_medium import remaining_text
from lacet.services.acquisition.recorder import Health
from lacet.services.acquisition.sensor_monitor import SensorState

COLUMNS = 100
"""Widest line [characters]."""
_TOGETHER = "\u00a0"  # a space at which no line is broken
_MANY = 6  # number of sources with the same loss from which they are summed
_LISTENERS = {True: "heard on the bus", False: "nobody listens on the bus", None: ""}


def live_text(health: Health) -> str:
    """Three lines, none wider than `COLUMNS`; more where much is wrong.

    The first has the buses with frames/s and load, and the losses; the second each sensor with its rate of its nominal
    one in samples/s, and its state where it does not run; the third the disk, the clock and who listens.
    """
    buses = ", ".join(
        f"{name} {rate:.0f}/s" + (f" {100 * health.load[name]:.0f} %" if name in health.load else "")
        for name, rate in health.frames.items()
    )
    down = f"DOWN: {', '.join(health.down)}" if health.down else ""
    lost = lost_text(health.losses)
    first = [f"{health.seconds:.0f} s: {buses}", down, f"LOST {lost}" if lost else "nothing lost"]
    third = [remaining_text(health.disk_seconds), f"clock {health.clock}", _LISTENERS[health.listened]]
    sensors = [_sensor(health, name).replace(" ", _TOGETHER) for name in health.sensors]
    lines = ["; ".join(filter(None, first)), "; ".join(sensors), "; ".join(filter(None, third))]
    return "\n".join(
        textwrap.fill(line, COLUMNS, initial_indent="  " if i else "", subsequent_indent="    ", break_on_hyphens=False)
        for i, line in enumerate(lines)
        if line
    ).replace(_TOGETHER, " ")


def _sensor(health: Health, name: str) -> str:
    state = health.sensors[name].state
    measured, nominal = health.rates.get(name, (0.0, None))
    said = "" if state in (SensorState.RUNNING, SensorState.WAITING) else f" {state.upper()}"
    return f"{name}{said} {measured:.0f}" + (f"/{nominal:.0f}" if nominal else "")


def lost_text(losses: dict[str, dict[str, int]]) -> str:
    """Losses as text, ``can0 kernel 12, serial0 bad_checksum 1``; a cause common to many sources is summed."""
    causes: dict[str, dict[str, int]] = {}
    for source, numbers in losses.items():
        for cause, number in numbers.items():
            causes.setdefault(cause, {})[source] = number
    return ", ".join(
        f"{cause} {sum(sources.values())} (of {len(sources)} buses and channels)"
        if len(sources) > _MANY
        else ", ".join(f"{source} {cause} {number}" for source, number in sources.items())
        for cause, sources in causes.items()
    )


def doubtful_counter_text(losses: dict[str, dict[str, int]], frames: dict[str, int]) -> str:
    """What to look at where more frames of a bus count as lost than came; empty without such a bus.

    A broken cable loses all frames and not every other one.
    """
    buses = [source for source, causes in losses.items() if causes.get("lost", 0) > frames.get(source, 0) > 0]
    if not buses:
        return ""
    return (
        f"Of {', '.join(buses)} more frames count as lost than came: two senders may share an identifier, or what the "
        "rig calls a counter is none."
    )
