"""What a page does with the server, as tests need it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from fastapi.testclient import TestClient


class Page:
    """What a page does."""

    def __init__(self, client: TestClient):
        self.client = client

    @property
    def folder(self) -> Path:
        """The study's folder."""
        return Path(self.get("study")["folder"])

    def get(self, path: str, status: int = 200) -> Any:
        """An answer in JSON."""
        answer = self.client.get(f"/api/{path}")
        assert answer.status_code == status, answer.text
        return answer.json()

    def post(self, path: str, body: Any, status: int = 200) -> Any:
        """The same for a write."""
        answer = self.client.post(f"/api/{path}", json=body)
        assert answer.status_code == status, answer.text
        return answer.json()

    def start(self, do: str, **args: Any) -> int:
        """Start a job; its number."""
        return self.post("jobs", {"do": do, "args": args})["id"]

    def until_over(self, number: int, seconds: float = 60.0) -> Any:
        """A job once it is over."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            job = self.get(f"jobs/{number}")
            if job["state"] in ("done", "failed", "cancelled"):
                return job
            time.sleep(0.02)
        raise AssertionError(f"job {number} does not end: {job}")

    def run(self, do: str, **args: Any) -> Any:
        """A job's result."""
        job = self.until_over(self.start(do, **args))
        assert job["state"] == "done", job["error"]
        return job["result"]
