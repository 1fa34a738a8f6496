"""Files replaced and deleted on the page, several sent at once."""

from __future__ import annotations

import re
import shutil
import tomllib
from pathlib import Path
from typing import Any

from tests.services.workbench.browser.bench import LONG, Bench, Watch, opening, serving
from tests.services.workbench.test_channel_maps import foreign_log


def test_files_are_replaced_and_deleted_after_a_question(
    browser: Any, ready: Bench, logs: dict[str, Path], tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(ready.folder, tmp_path / "small"))
    copies = [Path(shutil.copy(logs["sinus"], tmp_path / f"extra{k}.mcap")) for k in range(4)]
    with serving(folder, tmp_path) as bench, opening(browser, bench.address) as opened:
        watch = opened()
        watch.go("runs")
        watch.drop("drop-zone", *copies)
        for k in range(4):
            watch.expect(watch.at(f"run-row-extra{k}")).to_contain_text("the same samples", timeout=LONG)
        watch.at("delete-extra3").click()
        watch.expect(watch.at("ask")).to_contain_text("extra3.mcap")
        watch.picture("delete")
        watch.at("ask-no").click()
        watch.expect(watch.at("run-row-extra3")).to_be_visible()
        watch.at("delete-extra3").click()
        watch.at("ask-yes").click()
        watch.expect(watch.at("run-row-extra3")).to_have_count(0)
        assert len(list((folder / "removed").iterdir())) == 1
        watch.drop("drop-zone", copies[0], folder / "rig.toml")
        watch.expect(watch.at("replace-sent-rig.toml")).to_be_visible()
        watch.page.locator("li[data-file='rig.toml']").get_by_role("button", name="Close").click()
        watch.at("replace-sent-extra0.mcap").click()
        watch.at("ask-yes").click()
        watch.expect(watch.page.locator(".sent li")).to_have_count(0, timeout=LONG)
        assert len(list((folder / "removed").iterdir())) == 2
        watch.expect(watch.at("described")).to_contain_text("rig.toml")
        watch.at("replace-rig.toml").click()
        watch.expect(watch.at("ask")).to_contain_text("version 1 was fitted with the instruments")
        with watch.page.expect_file_chooser() as chooser:
            watch.at("ask-yes").click()
        text = (folder / "rig.toml").read_text(encoding="utf-8")
        (tmp_path / "rig.toml").write_text(f"{text}\n# mended\n", encoding="utf-8")
        chooser.value.set_files(tmp_path / "rig.toml")
        watch.expect(watch.page.locator(".sent li")).to_have_count(0, timeout=LONG)
        assert "# mended" in (folder / "rig.toml").read_text(encoding="utf-8")


def _open_map(watch: Watch, log: Path) -> None:
    """Drop a foreign log, and open its channel map."""
    watch.go("runs")
    watch.drop("drop-zone", log)
    watch.expect(watch.at("run-row-lap")).to_contain_text("cannot be read", timeout=LONG)
    watch.at("map-of-lap").click()
    watch.expect(watch.at("map-says")).to_contain_text("Makes", timeout=LONG)


def test_a_channel_map_is_made_on_the_page(browser: Any, tmp_path: Path) -> None:
    foreign_log(tmp_path / "lap.csv")
    with serving(tmp_path / "study", tmp_path) as bench, opening(browser, bench.address) as opened:
        watch = opened(1440, 900)
        _open_map(watch, tmp_path / "lap.csv")
        for axis, name in zip("xyz", ("LongAcc", "LatAcc", "VertAcc"), strict=True):
            column = f"imu.accel.{axis}"
            if not watch.at(f"map-{column}").count():
                watch.at("map-add").select_option(column)
            watch.at(f"map-{column}").fill(f"{name} + 3 mm" if axis == "y" else name)
        watch.expect(watch.at("map-state-imu.accel.y")).to_contain_text("\u2715")
        watch.expect(watch.at("map-keep")).to_be_disabled()
        watch.picture("channel-map")
        watch.at("map-imu.accel.y").fill("LatAcc")
        watch.expect(watch.at("map-state-imu.accel.y")).to_contain_text("m/s²")
        watch.at("map-imu.accel.y-more").click()
        watch.at("map-imu.accel.y-delay").fill("12")
        watch.expect(watch.at("map-state-imu.accel.y")).to_contain_text("must be a time with its unit")
        watch.at("map-imu.accel.y-delay").fill("12 ms")
        watch.expect(watch.at("map-state-imu.accel.y")).to_contain_text("m/s²")
        watch.at("map-keep").click()
        # the ends, which the delayed one lacks
        watch.expect(watch.at("run-row-lap")).to_contain_text("0.4 %", timeout=LONG)
        kept = tomllib.loads((tmp_path / "study" / "runs" / "lap.map.toml").read_text(encoding="utf-8"))
        assert kept["channels"]["imu.accel.y"] == {"from": "LatAcc", "delay": "12 ms"}
        watch.at("map-of-lap").click()
        watch.expect(watch.at("map-imu.accel.y-delay")).to_have_value("12 ms")
        watch.picture("channel-map-delay")
        _left_by_escape(watch)
        _left_by_its_button(watch)


def _left_by_escape(watch: Watch) -> None:
    """The first press leaves a field, the next closes what has no changes; with changes it takes one more."""
    press, panel = watch.page.keyboard.press, watch.page.locator("section.detail")
    watch.at("map-imu.accel.y-delay").focus()
    press("Escape")
    watch.expect(panel).to_be_visible()
    press("Escape")
    watch.expect(panel).to_be_hidden()
    watch.expect(watch.at("map-of-lap")).to_be_focused()
    watch.at("map-of-lap").click()
    watch.at("map-imu.accel.y-delay").fill("13 ms")
    press("Escape")
    press("Escape")
    watch.expect(watch.at("map-says")).to_contain_text("once more closes it without them")
    press("Escape")
    watch.expect(panel).to_be_hidden()


def _left_by_its_button(watch: Watch) -> None:
    """Close does as Escape does."""
    panel = watch.page.locator("section.detail")
    watch.at("map-of-lap").click()
    watch.at("map-imu.accel.y-delay").fill("13 ms")
    watch.at("map-close").click()
    watch.expect(watch.at("map-says")).to_contain_text("once more closes it without them")
    watch.expect(panel).to_be_visible()
    watch.at("map-close").click()
    watch.expect(panel).to_be_hidden()
    watch.expect(watch.at("map-of-lap")).to_be_focused()


def test_all_proposals_of_a_map_are_taken_at_once(browser: Any, tmp_path: Path) -> None:
    foreign_log(tmp_path / "lap.csv")
    with serving(tmp_path / "study", tmp_path) as bench, opening(browser, bench.address) as opened:
        watch = opened(1440, 900)
        _open_map(watch, tmp_path / "lap.csv")
        found = watch.page.evaluate("fetch('api/runs/lap/map').then((a) => a.json())")
        doubtful = [c for c, p in found["proposals"].items() if p["probability"] < found["accepted"]]
        assert doubtful
        watch.expect(watch.at("map-all")).to_contain_text(f"({len(doubtful)} more)")
        watch.at("map-all").click()
        for column, proposal in found["proposals"].items():
            watch.expect(watch.at(f"map-{column}")).to_have_value(proposal["expression"])
            mark = watch.page.locator("tr", has=watch.at(f"map-{column}")).locator("td.num span")
            watch.expect(mark).to_have_class("warn" if column in doubtful else "good")
            watch.expect(mark).to_have_text(re.compile(r"\d %"))
        watch.expect(watch.at("map-all")).to_be_disabled()
        watch.expect(watch.at("map-says")).to_contain_text("Makes a run")
        watch.picture("channel-map-all")
