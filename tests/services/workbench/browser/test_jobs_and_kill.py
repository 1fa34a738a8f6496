"""The bar of work: rebuilt from the server at every connection, also after it was killed; cancelled from any tab."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

from tests.services.workbench.browser.bench import LONG, Bench, Watch, opening, serving

_START = """async () => { for (const job of ["diagnose", "report"]) await fetch("api/jobs", { method: "POST",
headers: { "Content-Type": "application/json" }, body: JSON.stringify({ do: job, args: {} }) }); }"""


def _state(watch: Watch, state: str) -> None:
    watch.expect(watch.at("job-bar")).to_have_attribute("data-state", state, timeout=LONG)


def _seconds(watch: Watch) -> int:
    """Seconds since the work began, as the bar says."""
    watch.expect(watch.at("job-time")).to_have_text(re.compile(r"\d+ s"))
    found = re.search(r"(\d+) s", watch.at("job-time").inner_text())
    assert found
    return int(found[1])


def test_no_job_is_shown_that_the_server_does_not_have(browser: Any, ready: Bench, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(ready.folder, tmp_path / "small"))
    with serving(folder, tmp_path) as bench, opening(browser, bench.address) as opened:
        one, other = opened(), opened()
        one.go("missing")
        one.page.evaluate(_START)
        _state(one, "running")
        one.quiet(2500)
        other.go("compare")
        _state(other, "running")
        assert _seconds(other) >= 2  # counted by the server, not since this page was opened
        other.expect(other.page.get_by_role("button", name="Try again")).to_have_count(0)
        other.picture("job-running")
        other.at("job-cancel").click()
        one.expect(one.at("job-bar")).to_contain_text("Writing the report", timeout=LONG)
        one.at("job-cancel").click()
        for watch in (one, other):
            _state(watch, "idle")

        one.page.evaluate(_START)
        _state(one, "running")
        bench.server.process.kill()
        bench.server.process.wait(10.0)
        _state(one, "down")
        one.expect(one.at("job-cancel")).to_be_disabled()
        one.picture("job-down")
        with serving(folder, tmp_path, int(bench.address.rpartition(":")[2])):
            for watch in (one, other):
                _state(watch, "lost")
                watch.expect(watch.at("job-bar")).to_contain_text("Looking for what is missing; Writing the report")
                watch.expect(watch.at("job-cancel")).to_be_hidden()
            one.picture("job-lost")
            one.page.reload()
            _state(one, "lost")
            one.at("job-again").click()
            _state(other, "running")
            other.at("job-cancel").click()
            other.expect(other.at("job-bar")).to_contain_text("Writing the report", timeout=LONG)
            other.at("job-cancel").click()
            for watch in (one, other):
                _state(watch, "idle")
        for watch in (one, other):
            watch.errors[:] = [e for e in watch.errors if "ERR_" not in e]
