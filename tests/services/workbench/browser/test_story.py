"""The whole story in a real browser: from logs dropped into an empty folder to the error at its floor."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from lacet.services.render.verdict_card import MOST_WORDS
from tests.services.workbench.browser.bench import LONG, Bench, Watch, opening, serving
from tests.support.processes import Command

FRONT, REAR = "anti_roll_bar.front", "anti_roll_bar.rear"
WRONG = "bump = suspension: p * (travel + rate)"
RIGHT = "bump = suspension: p * travel**2 * sign(rate)"


def test_from_dropped_logs_to_the_floor(browser: Any, logs: dict[str, Path], tmp_path: Path) -> None:
    with serving(tmp_path / "study", tmp_path) as bench, opening(browser, bench.address) as opened:
        watch = opened()
        _drop(watch, logs)
        _make(watch)
        _look(watch)
        _find_and_add(watch)
        _undo_and_return(watch)
        _own_effect(watch, bench)
        _reload(watch)
        _beside(watch, bench)
        _take_away(watch, tmp_path)


def _version(watch: Watch, number: int) -> None:
    watch.expect(watch.at("version")).to_contain_text(f"Version {number} of", timeout=LONG)


def _drop(watch: Watch, logs: dict[str, Path]) -> None:
    watch.page.goto(watch.address)
    watch.expect(watch.page).to_have_url(re.compile("#/runs"))
    watch.expect(watch.page.get_by_text("No runs yet")).to_be_visible()
    watch.picture("1-runs-empty")
    watch.drop("drop-zone", logs["rough"])
    watch.expect(watch.at("run-row-rough")).to_be_visible()
    with watch.page.expect_file_chooser() as chooser:
        watch.at("choose-files").click()
    # the second is a raw capture: it is decoded on arrival
    chooser.value.set_files([logs["sinus"], logs["spiral"]])
    for name in ("sinus", "spiral"):
        watch.expect(watch.at(f"run-row-{name}")).to_contain_text("good", timeout=LONG)
    watch.at("channels-sinus").click()
    watch.expect(watch.page.get_by_text("wheel.fl.force", exact=True)).to_be_visible()
    watch.at("channels-sinus").click()


def _make(watch: Watch) -> None:
    watch.expect(watch.at("make-study")).to_be_disabled()
    watch.at("role-rough-used").check()
    watch.at("role-sinus-used").check()
    watch.at("role-spiral-held").check()
    watch.picture("1-runs")
    watch.at("make-study").click()
    watch.expect(watch.at("job-cancel")).to_be_enabled()
    _version(watch, 1)
    watch.expect(watch.at("make-study")).to_have_text("Fit to this choice")


def _look(watch: Watch) -> None:
    """The rows that fail, and from the map to the place where they do."""
    for corner in ("fl", "fr", "rl", "rr"):
        watch.expect(watch.at(f"car-suspension.{corner}")).to_have_attribute("aria-label", re.compile("fails$"))
        watch.expect(watch.at(f"car-suspension.{corner}")).to_contain_text("!")
        watch.expect(watch.at(f"car-tyre.{corner}")).not_to_contain_text("!")
    watch.at("car-tyre.fl").click()
    watch.at("nav-where").click()
    drawing = watch.at("map")
    read = watch.page.locator(".map-read")
    watch.expect(watch.at("where-says")).to_contain_text("rows fail", timeout=LONG)
    box = drawing.bounding_box()
    assert box is not None
    for y in range(30, int(box["height"]), 6):
        drawing.hover(position={"x": 0.4 * box["width"], "y": y})
        if "suspension.rl" in read.inner_text():
            break
    assert "suspension.rl" in read.inner_text()
    watch.picture("3-where")
    drawing.click(position={"x": 0.4 * box["width"], "y": y})
    watch.expect(watch.page).to_have_url(re.compile(r"#/compare\?.*row=suspension\.rl.*t0="))
    watch.expect(watch.at("chart-measured")).to_be_visible(timeout=LONG)
    watch.expect(watch.at("row-select")).to_have_value("suspension.rl")
    watch.expect(watch.at("effect-layer").nth(2)).to_be_visible()
    watch.quiet()
    watch.picture("2-compare")


def _find_and_add(watch: Watch) -> None:
    """The front bar by hand, the rear one by itself, until nothing is missing."""
    watch.at("nav-missing").click()
    watch.at("diagnose").click()
    watch.expect(watch.at("job-bar")).to_contain_text("Looking for what is missing", timeout=LONG)
    watch.at("stop").click()
    watch.expect(watch.at("job-bar")).to_contain_text("cancelled", timeout=LONG)
    watch.expect(watch.at("verdict")).to_contain_text("Not looked for yet")
    watch.at("diagnose").click()
    _card(watch)
    _preview(watch)
    watch.at("add-best").click()
    _version(watch, 2)
    watch.expect(watch.at("last-change")).to_have_text(
        re.compile(r"Added anti_roll_bar\.front: suspension\.f[lr] [\d.]+ → [\d.]+ times its floor\."), timeout=LONG
    )
    assert _errors(watch)[1] < 0.8 * _errors(watch)[0]
    # the ranking goes on by itself, and can be stopped
    watch.expect(watch.at("job-bar")).to_contain_text("Looking for what is missing", timeout=LONG)
    watch.at("stop").click()
    watch.expect(watch.at("job-bar")).to_contain_text("cancelled", timeout=LONG)
    watch.expect(watch.at("verdict")).to_contain_text("Not looked for yet in version 2")
    watch.expect(watch.at(f"remove-{FRONT}")).to_be_enabled()
    watch.at("diagnose-auto").click()
    _version(watch, 3)
    watch.expect(watch.at("card")).to_contain_text("Nothing missing that these runs can show", timeout=LONG)
    watch.expect(watch.at("card")).to_contain_text(
        re.compile(r"\d+ effects untestable.*Would show most: \w+", re.DOTALL)
    )
    watch.expect(watch.at(f"remove-{REAR}")).to_be_visible()
    watch.picture("4-nothing-missing")
    used = _errors(watch)
    assert len(used) == 3
    assert used[2] < 1.1 < used[1]
    watch.expect(watch.at("car-suspension.fl")).not_to_contain_text("!")


def _card(watch: Watch) -> None:
    """Which effect, how sure, why not the next ones, in few words; what to press is in sight."""
    card = watch.at("card")
    watch.expect(card).to_contain_text("Missing: anti-roll bar, front", timeout=LONG)
    watch.expect(card).to_contain_text(re.compile(r"k = \d+ ± \d+ N/m \(95 %, with sheet\)"))
    watch.expect(card).to_contain_text(re.compile(r"Out: \S+: \w+"))
    assert len(card.inner_text().replace("!", "").split()) <= MOST_WORDS, card.inner_text()
    button = watch.at("add-best")
    watch.expect(button).to_have_text("Add anti-roll bar, front")
    watch.expect(button).to_be_in_viewport(ratio=1.0)
    watch.expect(watch.at("signature-plot")).to_contain_text("law of anti-roll bar, front", timeout=LONG)
    watch.expect(watch.at("signature-plot").get_by_role("img")).to_have_attribute(
        "aria-label", re.compile("travel difference across the axle")
    )
    candidate = watch.at(f"candidate-{FRONT}")
    watch.expect(candidate).to_contain_text("missing")
    watch.expect(candidate).to_contain_text("N/m, sign ✓")


def _preview(watch: Watch) -> None:
    """Of the effect's own row and its worst run, whatever is chosen elsewhere, and in sight beside a long list."""
    watch.at("car-tyre.rr").click()
    says = watch.at("preview-says")
    watch.expect(says).to_contain_text(re.compile(r"suspension\.f[lr] in .*% less"), timeout=LONG)
    watch.expect(watch.at("preview").locator("canvas").first).to_be_visible()
    watch.quiet()
    watch.picture("4-missing")
    watch.page.get_by_role("button", name="Show all").click()
    last = watch.page.locator("[data-testid^=candidate-]").last
    last.scroll_into_view_if_needed()
    watch.expect(last).to_be_in_viewport()
    watch.expect(watch.at("preview")).to_be_in_viewport(ratio=0.7)
    watch.at(f"candidate-{REAR}").click()
    watch.expect(says).to_contain_text(re.compile(r"suspension\.r[lr] in .*% less"), timeout=LONG)
    assert str(watch.at("preview").get_attribute("data-row")).startswith("suspension.r")


def _errors(watch: Watch) -> list[float]:
    """Error ÷ floor on the runs used, by version."""
    study = watch.page.evaluate("fetch('api/study').then((a) => a.json())")
    return [v["used_error"] for v in study["versions"]]


def _undo_and_return(watch: Watch) -> None:
    watch.at("undo").click()
    _version(watch, 2)
    watch.expect(watch.at(f"remove-{REAR}")).to_have_count(0)
    watch.at("nav-falls").click()
    watch.expect(watch.at("column-2")).to_have_attribute("aria-label", re.compile("present version"))
    watch.at("column-3").click()
    _version(watch, 3)
    watch.expect(watch.at("column-3")).to_have_attribute("aria-label", re.compile("present version"))
    watch.expect(watch.at(f"parameter-{FRONT}.k")).to_contain_text("N/m")
    watch.at("parameter-filter").fill("anti_roll")
    watch.expect(watch.at("parameters").locator("tbody tr")).to_have_count(2)
    watch.at("parameter-filter").fill("")
    watch.picture("5-falls")


def _own_effect(watch: Watch, bench: Bench) -> None:
    """Units are checked as the line is written; a wrong line cannot be kept."""
    watch.page.keyboard.press("Escape")  # leaves the filter, which would take the stroke as text
    watch.page.keyboard.press("/")
    line = watch.at("own-line")
    watch.expect(line).to_be_focused()
    line.fill(WRONG)
    watch.expect(watch.at("own-check")).to_contain_text("m/s")
    watch.expect(line).to_have_attribute("aria-invalid", "true")
    watch.expect(watch.at("own-add")).to_be_disabled()
    watch.picture("4-own-wrong-unit")
    line.fill("anti_roll_bar = suspension: p * travel")
    taken = "✕ there is another effect 'anti_roll_bar' already: give this one another name"
    watch.expect(watch.at("own-check")).to_have_text(taken)
    line.fill(RIGHT.replace("travel", "trafl"))
    watch.expect(watch.at("own-check")).to_contain_text("Did you mean travel?")
    watch.expect(watch.at("own-add")).to_be_disabled()
    watch.picture("4-own-asked")
    watch.at("own-state").click()
    watch.expect(line).to_have_value(RIGHT)
    watch.expect(watch.at("own-check")).to_contain_text("units agree")
    watch.expect(watch.at("own-check")).to_contain_text("N/m²")
    watch.expect(watch.at("own-add")).to_be_enabled()
    watch.at("own-keep").click()
    watch.expect(watch.page.get_by_text("Kept in the study: bump")).to_be_visible()
    assert "travel**2" in "".join(f.read_text() for f in (bench.folder / "effects").iterdir())
    # where it is added is chosen before; that it helps nobody is said, and can be undone at once
    watch.at("own-variant-bump.rear").check()
    watch.expect(watch.at("own-add")).to_have_text("Keep and add bump.rear")
    watch.at("own-add").click()
    _version(watch, 4)
    watch.expect(watch.at("last-change")).to_have_text(
        re.compile(r"Added bump\.rear: suspension\.r[lr] .* It helps no row: undo it\."), timeout=LONG
    )
    watch.expect(watch.at("undo-add")).to_be_in_viewport(ratio=1.0)
    watch.picture("4-helps-no-row")
    watch.at("undo-add").click()
    _version(watch, 3)


def _reload(watch: Watch) -> None:
    watch.at("nav-compare").click()
    watch.at("car-chassis.mx").click()
    watch.at("run-select").select_option("spiral")
    watch.expect(watch.page).to_have_url(re.compile(r"run=spiral.*row=chassis\.mx"))
    watch.page.reload()
    watch.expect(watch.at("row-select")).to_have_value("chassis.mx")
    watch.expect(watch.at("compare-run")).to_have_value("spiral")
    watch.expect(watch.at("validation")).to_contain_text("Cross validation", timeout=LONG)
    _version(watch, 3)


def _beside(watch: Watch, bench: Bench) -> None:
    """What another program does to the study is seen at once."""
    assert Command("undo", bench.folder, cwd=bench.folder.parent).wait(60.0) == 0
    _version(watch, 2)
    assert Command("study", bench.folder, "--version", "3", cwd=bench.folder.parent).wait(60.0) == 0
    _version(watch, 3)


def _take_away(watch: Watch, tmp_path: Path) -> None:
    watch.at("nav-falls").click()
    kinds = {"export-csv": "parameters.csv", "export-json": "study.json"}
    for testid, name in kinds.items():
        with watch.page.expect_download(timeout=LONG) as download:
            watch.at(testid).click()
        assert Path(download.value.suggested_filename).suffix == Path(name).suffix
        download.value.save_as(tmp_path / name)
    assert f"{FRONT}.k" in (tmp_path / "parameters.csv").read_text(encoding="utf-8")
    assert json.loads((tmp_path / "study.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", ["../outside.mcap", "notes.pdf"])
def test_a_file_that_is_no_run_is_refused_in_words(browser: Any, tmp_path: Path, name: str) -> None:
    (tmp_path / "notes.pdf").write_text("hello", encoding="utf-8")
    with serving(tmp_path / "study", tmp_path) as bench, opening(browser, bench.address) as opened:
        watch = opened()
        watch.go("runs")
        status = watch.page.evaluate(
            "(n) => fetch(`api/runs/${encodeURIComponent(n)}`, {method: 'PUT', body: 'x'}).then((a) => a.status)", name
        )
        assert 400 <= status < 500
        watch.drop("drop-zone", tmp_path / "notes.pdf")
        watch.expect(watch.page.locator(".sent")).to_contain_text("is no run")
        watch.errors[:] = [e for e in watch.errors if "status of 400" not in e]
        assert not list(tmp_path.rglob("outside.mcap"))
