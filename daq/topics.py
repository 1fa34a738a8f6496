"""Names inside a log: topics, metadata records, profile."""

from __future__ import annotations

PROFILE = "lacet"
START = "/lacet/start"
STOP = "/lacet/stop"
MANIFEST = "/lacet/manifest"
EVENTS = "/lacet/events"
RAW = "/raw/"
DECODED = "/decoded/"

META_START = "lacet.start"
META_STOP = "lacet.stop"
META_RECOVERED = "lacet.recovered"


def raw_topic(source: str) -> str:
    """Topic of a bus's raw frames."""
    return RAW + source


def decoded_topic(channel: str) -> str:
    """Topic of a channel's blocks; slashes make viewers show a tree."""
    return DECODED + channel.replace(".", "/")
