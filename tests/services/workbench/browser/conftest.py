"""The browser, the server and the logs that the page is tested with."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.services.workbench.browser.bench import DRAWS, FLAGS, Bench, Opened, chromium, missing, opening, serving
from tests.support.once import folder_once
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


def decoded_and_fitted(folder: Path) -> None:
    """Logs of captures with two hidden anti-roll bars, and a small study: one run used, one held out."""
    logs, cwd = folder / "logs", folder / "ready"
    logs.mkdir()
    cwd.mkdir()
    for name in ("rough", "sinus"):
        assert Command("decode", CAPTURES / f"{name}.mcap", "-o", logs / f"{name}.mcap", cwd=cwd).wait(120.0) == 0
    new = ("new", "small", "--use", logs / "sinus.mcap", "--hold", logs / "rough.mcap", "--draws", DRAWS)
    command = Command("study", *new, cwd=cwd)
    assert command.wait(180.0) == 0, command.text()


@pytest.fixture(scope="session")
def logs_and_study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """This process's copy of them; they are made once, by whichever process of the run needs them first."""
    folder = tmp_path_factory.getbasetemp()
    shutil.copytree(folder_once("browser", decoded_and_fitted), folder, dirs_exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def logs(logs_and_study: Path) -> dict[str, Path]:
    """Decoded logs of captures with two hidden anti-roll bars, by run; ``spiral`` stays a raw capture."""
    decoded = {name: logs_and_study / "logs" / f"{name}.mcap" for name in ("rough", "sinus")}
    return {"spiral": CAPTURES / "spiral.mcap", **decoded}


@pytest.fixture(scope="session")
def ready(logs_and_study: Path) -> Iterator[Bench]:
    """A server on a small study that is there already: one run used, one held out, the base model."""
    cwd = logs_and_study / "ready"
    with serving(cwd / "small", cwd) as bench:
        yield bench


@pytest.fixture
def opened(browser: Any, ready: Bench) -> Iterator[Opened]:
    """Opens pages of the small study; that nothing went wrong on any is checked at the end."""
    with opening(browser, ready.address) as pages:
        yield pages
