"""Configuration file of a Zenoh router (zenohd), where neither recorder nor worker is one."""

from __future__ import annotations

import base64
import json
import os
from pathlib import Path
from typing import Any

from lacet.daq.bus.credentials import Credentials
from lacet.daq.bus.session import common_settings

ROUTER_FILE = "router.json5"
"""The file in the folder of a router's keys, with everything in it."""
ROUTER_LISTEN = "tls/0.0.0.0:7447"
"""Where a router listens: on every address of its machine."""


def write_router(credentials: Credentials, listen: str) -> Path:
    """Write the configuration of a Zenoh router with these credentials: ``zenohd --config FILE`` needs nothing else."""
    settings = credentials.settings()
    tls = settings["transport/link/tls"]
    for setting, value in list(tls.items()):
        if isinstance(value, str):
            tls[f"{setting}_base64"] = base64.b64encode(Path(tls.pop(setting)).read_bytes()).decode()
    content: dict[str, Any] = {"mode": "router", "listen/endpoints": [listen], **common_settings(), **settings}
    nested: dict[str, Any] = {}
    for key, value in content.items():
        *groups, last = key.split("/")
        target = nested
        for group in groups:
            target = target.setdefault(group, {})
        target[last] = value
    path = credentials.folder / ROUTER_FILE
    path.unlink(missing_ok=True)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
        json.dump(nested, file, indent=1)
    return path
