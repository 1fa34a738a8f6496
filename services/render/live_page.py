"""What the live page says: the state of each channel, and what to do where no recording is heard."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lacet.daq.bus.session import ROUTER
from lacet.services.acquisition.sensor_monitor import MISSED, RATE_TOLERANCE

SILENT = 1.0
"""Time without a sample at the page from which a channel is silent [s]: the recorder's 0.5 s, batches and the bus."""


def channel_state(
    age: float | None, rate: float | None, expected: float | None, flagged: int, losses: int, recording: bool
) -> dict[str, str]:
    """State of a channel in words, and its `kind`: ``good``, ``warn`` or ``bad``.

    Parameters
    ----------
    age : time since its last sample came [s]; None where none has.
    rate, expected : samples/s of the last seconds, and nominal.
    flagged, losses : numbers of samples and of blocks.
    recording : whether it should be heard now.
    """
    if age is None:
        return {"kind": "bad", "text": "never heard"}
    if recording and age > max(SILENT, MISSED / expected if expected else 0.0):
        return {"kind": "bad", "text": "silent"}
    if expected and rate is not None and abs(rate / expected - 1.0) > RATE_TOLERANCE:
        return {"kind": "warn", "text": "slow" if rate < expected else "babbling"}
    if flagged:
        return {"kind": "warn", "text": "flagged"}
    if losses:
        return {"kind": "warn", "text": "losses"}
    return {"kind": "good", "text": "good" if recording else "was good"}


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
