"""From the question what is missing to the effect in the model and back, by keyboard alone."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from tests.services.workbench.browser.bench import LONG, Bench, opening, serving


def test_the_story_by_keyboard_alone(browser: Any, ready: Bench, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(ready.folder, tmp_path / "small"))
    with serving(folder, tmp_path) as bench, opening(browser, bench.address) as opened:
        watch = opened()
        watch.go("compare")
        press = watch.page.keyboard.press
        watch.expect(watch.at("version")).to_contain_text("Version 1 of 1", timeout=LONG)
        press("d")
        watch.expect(watch.at("diagnose")).to_be_focused(timeout=LONG)
        press("Enter")
        watch.expect(watch.at("add-best")).to_be_focused(timeout=LONG)
        press("Enter")
        watch.expect(watch.at("version")).to_contain_text("Version 2 of 2", timeout=LONG)
        watch.expect(watch.at("undo")).to_be_enabled(timeout=LONG)  # the ranking that went on by itself has ended
        watch.expect(watch.page.locator("[data-testid=add-best]:focus, [data-testid=diagnose]:focus")).to_be_visible()
        press("u")
        watch.expect(watch.at("version")).to_contain_text("Version 1 of 2", timeout=LONG)
