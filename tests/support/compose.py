"""The compose files as the compose client would read them, without an engine."""

from __future__ import annotations

import re
import shlex
from typing import Any

import yaml

from tests.support.places import HOME


def compose_file(environment: dict[str, str] | None = None, name: str = "docker-compose.yml") -> dict[str, Any]:
    """A file with ``${NAME:-default}`` replaced as compose does (and ``$$`` for a dollar)."""
    given = environment or {}

    def value(match: re.Match[str]) -> str:
        if match[0] == "$$":
            return "$"
        return given.get(match[1]) or match[2] or ""

    text = (HOME / name).read_text(encoding="utf-8")
    return yaml.safe_load(re.sub(r"\$\$|\$\{(\w+)(?::-([^}]*))?\}", value, text))


def lacet_commands(service: dict[str, Any]) -> list[list[str]]:
    """Arguments of every ``lacet`` command a service runs, straight or in a shell script."""
    command = service.get("command", [])
    lines = [shlex.join(command)] if command[:1] == ["lacet"] else command[-1].splitlines() if command else []
    words = [shlex.split(line.partition("||")[0].rstrip().removesuffix("&")) for line in lines]
    return [line[1:] for line in words if line[:1] == ["lacet"]]
