"""What a report shows of a version of a study's model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol


class Version(Protocol):
    """Properties of a version of a study's model that a report shows."""

    @property
    def number(self) -> int:
        """Number of the version, from 1."""
        ...

    @property
    def note(self) -> str:
        """Description of the change."""
        ...

    @property
    def effects(self) -> Mapping[str, Mapping[str, float]]:
        """Effects beyond the base model."""
        ...

    @property
    def result(self) -> Mapping[str, Any]:
        """Fit and scores as plain data."""
        ...
