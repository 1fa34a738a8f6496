"""The browser, the server and the logs that the page is tested with."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.services.workbench.browser.bench import DRAWS, FLAGS, Bench, Opened, chromium, missing, opening, serving
from tests.support.processes import ROOT, Command

CAPTURES = ROOT / "replay_logs" / "anti-roll-bars"


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """One headless Chromium for all tests."""
    program = chromium()
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        missing("Playwright is not installed: make test installs it (requirements/dev.txt)")
        raise
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=program, args=FLAGS)
        yield started
        started.close()


@pytest.fixture(scope="session")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Decoded logs of captures with two hidden anti-roll bars, by run; ``spiral`` stays a raw capture."""
    folder = tmp_path_factory.mktemp("logs")
    out = {"spiral": CAPTURES / "spiral.mcap"}
    for name in ("rough", "sinus"):
        out[name] = folder / f"{name}.mcap"
        assert Command("decode", CAPTURES / f"{name}.mcap", "-o", out[name], cwd=folder).wait(120.0) == 0
    return out


@pytest.fixture(scope="session")
def ready(tmp_path_factory: pytest.TempPathFactory, logs: dict[str, Path]) -> Iterator[Bench]:
    """A server on a small study that is there already: one run used, one held out, the base model."""
    cwd = tmp_path_factory.mktemp("ready")
    new = ("new", "small", "--use", logs["sinus"], "--hold", logs["rough"], "--draws", DRAWS)
    command = Command("study", *new, cwd=cwd)
    assert command.wait(180.0) == 0, command.text()
    with serving(cwd / "small", cwd) as bench:
        yield bench


@pytest.fixture
def opened(browser: Any, ready: Bench) -> Iterator[Opened]:
    """Opens pages of the small study; that nothing went wrong on any is checked at the end."""
    with opening(browser, ready.address) as pages:
        yield pages
