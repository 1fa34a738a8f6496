"""A recording with wheel loads put in the place of measured ones, and the channels without which none can be found."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from lacet.daq.channels import CHANNELS, CORNERS
from lacet.daq.errors import NotIdentifiable
from lacet.daq.rig import Rig, Sensor
from lacet.identify.car.measured_rows import MeasuredRows
from lacet.identify.car.rows import CHASSIS_ROWS, Row
from lacet.identify.signals.reconstruct import Recording
from lacet.identify.wheel_loads.tyre_contact import WheelLoad, WheelLoads

LOADS = tuple(f"wheel.{c}.{what}" for c in CORNERS for what in ("force", "moment"))
"""Channels of the wheel loads."""


def vertical_rows(corner: str) -> tuple[Row, ...]:
    """The rows of a wheel's vertical force, one of which determines it."""
    return Row(f"suspension.{corner}"), Row(f"tyre.{corner}")


def as_measured(recording: Recording) -> Recording:
    """The recording without what was derived or assumed in it: without loads that is less than with them in place."""
    value = {name: series for name, series in recording.signals.value.items() if name not in recording.sources}
    signals = replace(recording.signals, value=value, assumed={})
    return replace(recording, signals=signals, sources={}, laws=(), tables=())


def placed(recording: Recording, loads: WheelLoads) -> Recording:
    """The recording with these loads, in body axes, as if they had been measured; 0 at corners without any."""
    n, values = recording.t.size, {k: v for k, v in recording.signals.value.items() if k not in LOADS}
    for c in CORNERS:
        load = loads.get(c, WheelLoad(np.zeros((3, n)), np.zeros((3, n))))
        values |= {f"wheel.{c}.force": load.force, f"wheel.{c}.moment": load.moment}
    everywhere = dict.fromkeys(LOADS, np.ones(n, bool))
    rates = {**{name: CHANNELS[name].rate for name in LOADS}, **recording.rates}
    return replace(
        recording, signals=replace(recording.signals, value=values), usable={**recording.usable, **everywhere},
        rates=rates, rig=_in_body_axes(recording.rig),
        laws=tuple(law for law in recording.laws if law.channel not in LOADS),
        sources={name: source for name, source in recording.sources.items() if name not in LOADS},
    )  # fmt: skip


def _in_body_axes(rig: Rig) -> Rig:
    """The rig with a sensor of wheel loads in body axes, with the noise of its own where it has one."""
    own = rig.sensor_of(LOADS[0])
    others = (replace(s, channels=tuple(c for c in s.channels if c not in LOADS)) for s in rig.sensors)
    loads = Sensor(
        name="wheel loads", channels=LOADS, driver=None, bus=None, axes="body", latency=0.0, clock="arrival",
        noise=own.noise if own else {}, tolerance=own.tolerance if own else {}, position={}, from_wheel_centre=None,
        orientation=(0.0, 0.0, 0.0),
    )  # fmt: skip
    return replace(rig, sensors=(*(s for s in others if s.channels), loads))


def rows_of(recording: Recording, identified: Collection[Row]) -> tuple[Row, ...]:
    """Rows that give wheel loads on a recording with loads `placed`, of those that the study has identified.

    Raises NotIdentifiable, with the channels to add, where the loads cannot be found: without the chassis' rows, or
    with a wheel that has neither a suspension's nor a tyre's row.
    """
    measured, where = MeasuredRows.of(recording), f"{recording.run}: no wheel loads"
    rows = tuple(row for row in measured.torques if row in identified and np.any(measured.usable[row]))
    if unknown := [row for row in CHASSIS_ROWS if row not in identified]:
        names = ", ".join(unknown)
        raise NotIdentifiable(
            f"{where}: the study has not identified {names}: its runs need dynamometers at all wheels"
        )
    vertical = list(map(vertical_rows, CORNERS))
    for either in vertical:
        if not any(row in identified for row in either):
            raise NotIdentifiable(f"{where}: the study has identified neither {' nor '.join(either)}")
    lost = [row for row in CHASSIS_ROWS if row not in rows]
    lost += [next(row for row in either if row in identified) for either in vertical if not set(either) & set(rows)]
    absent = dict.fromkeys(name for row in lost if row in measured.left_out for name in measured.left_out[row].channels)
    if absent:
        raise NotIdentifiable(f"{where}: not measured, and the least to be added: {', '.join(absent)}")
    if lost:
        raise NotIdentifiable(f"{where}: no usable sample of {', '.join(lost)} outside flagged intervals")
    return rows
