"""The reference car's tables on the page: from an empty study, which says what to do, to what is missing."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from tests.services.workbench.browser.bench import FEW, LONG, Watch, opening, serving
from tests.support.tables import CAR, piece, written

_EMPTY = {
    "runs": "No runs yet",
    "compare": "choose runs in the view Runs",
    "where": "choose runs in the view Runs",
    "missing": "Choose the runs to fit it on in the view Runs",
    "falls": "choose runs first",
    "car": "choose runs in the view Runs",
    "live": "No recording is heard",
}
"""View → what it says in a study without runs."""


def test_from_an_empty_study_to_what_is_missing(browser: Any, tmp_path: Path) -> None:
    tables = [written(piece(run, 4.0, 12.0), tmp_path / f"{run}.parquet") for run in ("sine", "rough")]
    described = [Path(shutil.copy(CAR / name, tmp_path / name)) for name in ("rig.toml", "vehicle.toml")]
    with serving(tmp_path / "study", tmp_path, module=FEW) as bench, opening(browser, bench.address) as opened:
        watch = opened(1440, 900)
        _says_what_to_do(watch)
        _make_by_keyboard(watch, [*described, *tables])
        watch.go("where")
        watch.expect(watch.at("where-says")).to_contain_text("rows fail", timeout=LONG)
        watch.expect(watch.page.locator(".view-where")).to_contain_text("no run has three stretches of four seconds")
        watch.go("compare")
        watch.expect(watch.at("chart-measured").locator("canvas").first).to_be_visible(timeout=LONG)
        # the row that is farthest from its floor, in its worst run
        watch.expect(watch.at("row-select")).to_have_value("suspension.fl")
        watch.expect(watch.at("compare-run")).to_have_value("rough")
        watch.go("car")
        watch.expect(watch.at("values-fl")).to_contain_text("ride rate", timeout=LONG)
        watch.go("missing")
        watch.at("diagnose").click()
        watch.expect(watch.at("card")).to_contain_text("Missing: anti-roll bar", timeout=LONG)
        watch.expect(watch.at("add-best")).to_be_in_viewport(ratio=1.0)
        watch.expect(watch.at("signature-plot")).to_contain_text("law of anti-roll bar", timeout=LONG)
        watch.quiet()
        watch.picture("reference-car-missing")


def _says_what_to_do(watch: Watch) -> None:
    for view, words in _EMPTY.items():
        watch.go(view)
        watch.expect(watch.page.locator(f".view[data-view={view}]")).to_contain_text(words)
        watch.picture(f"empty-{view}")


def _make_by_keyboard(watch: Watch, files: list[Path]) -> None:
    """From files to a model without a mouse; that Tab reaches what is pressed is tested elsewhere."""
    watch.go("runs")
    watch.expect(watch.at("invite-tour")).to_be_visible()
    with watch.page.expect_file_chooser() as chooser:
        watch.at("choose-files").press("Space")
    chooser.value.set_files(files)
    for run, role in (("sine", "used"), ("rough", "held")):
        watch.expect(watch.at(f"run-row-{run}")).to_contain_text("good", timeout=LONG)
        watch.at(f"role-{run}-{role}").focus()
        watch.page.keyboard.press("Space")
        watch.expect(watch.at(f"role-{run}-{role}")).to_be_checked()
    watch.expect(watch.at("make-study")).to_be_enabled()
    watch.at("make-study").focus()
    watch.page.keyboard.press("Enter")
    watch.expect(watch.at("version")).to_contain_text("Version 1 of 1", timeout=LONG)
