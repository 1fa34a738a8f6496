"""What the sensor sheet would have to be wrong by for a model to be right."""

from __future__ import annotations

from daq.channels import CHANNELS
from identify.trials import TrialSpace


def excused(space: TrialSpace) -> dict[str, float]:
    """Entry of the sensor sheet → how many of its tolerances these runs would have it off, beside no candidate."""
    rig, layout, known = space.fitted.drives[0].recording.rig, space.layout, space.partialled
    columns, late = space.columns, space.reading.late
    out: dict[str, float] = {}
    for position, gain in enumerate(known.gain[:, layout.right]):
        place = int(known.taken[position])
        if place < layout.model:
            continue
        name, size = columns.sheet[place], float(gain) / columns.sigma[place]
        if place < layout.model + len(layout.sheet):
            entry = layout.sheet[place - layout.model]
            what, channel, k = entry
            if what == "latency":
                size += late.get(entry, 0.0) / rig.tolerance(channel, "latency")
                sensor = rig.sensor_of(channel)
                name = f"latency of {sensor.name if sensor else channel}"
            else:
                name = f"{what} of {CHANNELS[channel].columns[k]}"
        out[name] = size
    return out
