"""Files replaced and deleted on the page, several sent at once."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from tests.services.workbench.browser.bench import LONG, Bench, opening, serving


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
        watch.drop("drop-zone", copies[0])
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
        watch.errors[:] = [e for e in watch.errors if "status of 409" not in e]
