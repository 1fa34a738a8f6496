"""What the live page says: the state of each channel and of all, and what to do where no recording is heard."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lacet.daq.bus.session import ROUTER
from lacet.services.acquisition.sensor_monitor import MISSED, RATE_TOLERANCE, SensorState

SILENT = 1.0
"""Time without a sample at the page from which a channel is silent [s]: the recorder's 0.5 s, batches and the bus."""


def channel_state(
    age: float | None, rate: float | None, expected: float | None, flagged: int, losses: int, recording: bool,
    fault: str = "",
) -> dict[str, str]:  # fmt: skip
    """State of a channel in words, and its `kind`: ``good``, ``warn`` or ``bad``.

    A fault that the recorder finds is the channel's state, so that channels and sensors agree, also on a page that was
    opened after the last sample; once the run is over, it is the state at its end.

    Parameters
    ----------
    age : time since its last sample came [s]; None where none has.
    rate, expected : samples/s of the last seconds, and nominal.
    flagged, losses : numbers of samples and of blocks.
    recording : whether it should be heard now.
    fault : state of its sensor, as the recorder said last, where the channel is at fault.
    """
    if age is None and not fault:
        return {"kind": "bad", "text": "never heard"}
    when = "" if recording else " at the end"
    late = age is not None and age > max(SILENT, MISSED / expected if expected else 0.0)
    if fault == SensorState.SILENT or (recording and late):
        return {"kind": "bad", "text": f"silent{when}"}
    if fault:
        return {"kind": "warn", "text": f"{fault}{when}"}
    if expected and rate is not None and abs(rate / expected - 1.0) > RATE_TOLERANCE:
        return {"kind": "warn", "text": "slow" if rate < expected else "babbling"}
    if flagged:
        return {"kind": "warn", "text": "flagged"}
    if losses:
        return {"kind": "warn", "text": "losses"}
    return {"kind": "good", "text": "good" if recording else "was good"}


def channels_text(states: Sequence[Mapping[str, str]], recording: bool) -> str:
    """How many channels there are, and how many of them are in which state other than good.

    Parameters
    ----------
    states : of the channels, as `channel_state` has them.
    recording : as there.
    """
    wrong = Counter(one["text"] for one in states if one["kind"] != "good")
    if not wrong:
        return f"{len(states)} channels, {'all' if recording else 'all were'} as they should be"
    return f"{len(states)} channels, {', '.join(f'{number} {text}' for text, number in wrong.most_common())}"


def first_steps(endpoint: str | None, capture: Path | None, why: str = "") -> list[dict[str, Any]]:
    """What to do to see a recording: steps with what they are for (`says`) and the `commands` of a terminal each.

    Parameters
    ----------
    endpoint : the router that is listened to.
    capture : an example that can be played; None where there is none.
    why : why the router was not reached; said of one on another computer, where it should have been.
    """
    elsewhere = {
        "says": "A recording on another computer, with keys for both (lacet keys): in the car, and here",
        "commands": [
            "lacet record --rig rig.toml --vehicle vehicle.toml -o run.mcap --listen tls/0.0.0.0:7447 --keys keys/car",
            "lacet ui STUDY --connect tls/10.0.0.7:7447 --keys keys/lab",
        ],
    }
    if endpoint is None or not endpoint.startswith("tcp/127."):
        return [*([{"says": why, "commands": []}] if why else []), elsewhere]
    listen = "" if endpoint == ROUTER else f" --listen {endpoint}"
    here = {
        "says": "A recording on this computer",
        "commands": [f"lacet record --rig rig.toml --vehicle vehicle.toml -o run.mcap{listen}"],
    }
    example = {
        "says": "To try it without a car: an example capture, played in one terminal and recorded in another",
        "commands": [
            f"lacet replay {capture} --endpoints wires.json --wait 60",
            "lacet record --rig peugeot-406 --vehicle peugeot-406 -o example.mcap --endpoints wires.json "
            f"--until-idle 2{listen}",
        ],
    }
    return [here, elsewhere, *([example] if capture else [])]
