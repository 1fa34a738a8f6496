"""A workbench to test: the server as a user starts it, a real browser, and what must never happen on any page."""

from __future__ import annotations

import base64
import os
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from tests.support.processes import LACET, ROOT, Command, commands

PICTURES = ROOT / "build" / "browser"
"""Where the pictures of each view are kept."""
DRAWS = 19
"""Noise-floor simulations: the least that a study takes."""
LONG = 180_000
"""Longest that a job may take on a busy machine [ms]."""
PATIENCE = 60_000
"""Longest that the page may take to show something, on a busy machine [ms]."""
FEW = "tests.support.few_effects"
"""The command line of a server that ranks few effects, in seconds."""
NO_CAR = ("--connect", "tcp/127.0.0.1:9")
"""Arguments of a server that hears no recording of this machine."""
FLAGS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip
_SHIFTS = """
window.lacetShifts = [];
new PerformanceObserver((list) => {
  for (const e of list.getEntries()) {
    if (e.hadRecentInput) continue;
    const what = (e.sources || []).map((s) => (s.node?.outerHTML || s.node?.textContent || '').slice(0, 120));
    window.lacetShifts.push({ value: e.value, what });
  }
}).observe({ type: 'layout-shift', buffered: true });
"""


def chromium() -> str:
    """The browser's program. Where there is none the test fails in CI with the remedy, and is skipped elsewhere."""
    found = next((p for p in map(shutil.which, ("chromium", "chromium-browser")) if p), None)
    if found is None:
        missing("the page is tested in Debian's Chromium, which is not here: apt-get install chromium")
    return str(found)


def missing(why: str) -> None:
    """Fail in CI, skip elsewhere."""
    if os.environ.get("CI") == "true":
        pytest.fail(why)
    pytest.skip(why)


_ENTRIES: dict[str, str] = {}
"""Address of a server → the one it printed, with its token."""


@dataclass
class Bench:
    """A server on a folder."""

    folder: Path
    address: str
    server: Command


@contextmanager
def serving(
    folder: Path, cwd: Path, port: int = 0, more: Sequence[str] = NO_CAR, module: str = LACET
) -> Iterator[Bench]:
    """``lacet ui FOLDER`` on a port, 0 for any that is free, with `more` arguments, as a process of its own.

    `module` is its command line, `FEW` one whose catalogue is small.
    """
    with commands() as running:
        server = Command("ui", folder, "--port", port, "--draws", DRAWS, *more, cwd=cwd, module=module)
        running.append(server)
        server.wait_for("Ctrl-C", 60.0)
        found = re.search(r"(http://127\.0\.0\.1:\d+)/\?token=\S+", server.text())
        assert found, server.text()
        _ENTRIES[found[1]] = found[0]
        yield Bench(folder, found[1], server)


@dataclass
class Watch:
    """A page with everything that it said and asked for."""

    page: Any
    address: str
    errors: list[str] = field(default_factory=list)
    elsewhere: list[str] = field(default_factory=list)

    def go(self, view: str) -> None:
        """Open a view as by its address."""
        self.page.goto(f"{self.address}/#/{view}")

    def at(self, testid: str) -> Any:
        """The element that tests know by this name."""
        return self.page.get_by_test_id(testid)

    def expect(self, target: Any) -> Any:
        """Playwright's assertions, which wait; loaded late, for Playwright may be missing."""
        from playwright.sync_api import expect

        expect.set_options(timeout=PATIENCE)
        return expect(target)

    def picture(self, name: str) -> None:
        """Keep a picture of what is seen."""
        PICTURES.mkdir(parents=True, exist_ok=True)
        self.page.screenshot(path=PICTURES / f"{name}.png")

    def quiet(self, milliseconds: int = 400) -> None:
        """Wait until nothing has been asked of the server for a while."""
        self.page.wait_for_timeout(milliseconds)

    def shifts(self) -> list[dict[str, Any]]:
        """How far things moved that nobody had touched, since the last question."""
        return list(self.page.evaluate("window.lacetShifts.splice(0)"))

    def drop(self, testid: str, *files: Path) -> None:
        """Drop files on an element, as a hand would from a file manager."""
        data = self.page.evaluate_handle(
            """(files) => {
                const data = new DataTransfer();
                for (const [name, text] of files) {
                    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
                    data.items.add(new File([bytes], name));
                }
                return data;
            }""",
            [[f.name, base64.b64encode(f.read_bytes()).decode()] for f in files],
        )
        for event in ("dragenter", "dragover", "drop"):
            self.at(testid).dispatch_event(event, {"dataTransfer": data})

    def clean(self) -> None:
        """Nothing was asked of another machine, and no error came up."""
        assert not self.elsewhere, self.elsewhere
        assert not self.errors, self.errors


Opened = Callable[..., Watch]


@contextmanager
def opening(browser: Any, address: str) -> Iterator[Opened]:
    """Opens pages; every one of them is checked at the end."""
    watches: list[Watch] = []
    contexts: list[Any] = []

    def opened(
        width: int = 1280, height: int = 720, theme: str = "light", touch: bool = False, locale: str = "en-GB"
    ) -> Watch:
        context = browser.new_context(
            viewport={"width": width, "height": height}, color_scheme=theme, has_touch=touch, locale=locale,
            accept_downloads=True, reduced_motion="reduce",
        )  # fmt: skip
        contexts.append(context)
        context.add_init_script(_SHIFTS)
        if address in _ENTRIES:  # sets the cookie, as opening the printed address does
            assert context.request.get(_ENTRIES[address]).ok
        page = context.new_page()
        page.set_default_timeout(PATIENCE)
        watch = Watch(page, address)
        page.on("console", lambda m: watch.errors.append(f"{m.text} {m.location}") if m.type == "error" else None)
        page.on("pageerror", lambda e: watch.errors.append(str(e)))
        page.on("request", lambda r: _elsewhere(watch, r.url))
        watches.append(watch)
        return watch

    try:
        yield opened
        for watch in watches:
            watch.clean()
    finally:
        for context in contexts:
            context.close()


def _elsewhere(watch: Watch, url: str) -> None:
    if not url.startswith((f"{watch.address}/", "data:", "blob:")):
        watch.elsewhere.append(url)
