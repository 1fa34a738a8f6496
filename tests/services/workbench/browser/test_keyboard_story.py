"""From the question what is missing to the effect in the model and back, by keyboard alone."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.services.workbench.browser.bench import FEW, LONG, Bench, Watch, opening, serving


@pytest.mark.slow  # three minutes; its steps by mouse are in make test
def test_the_story_by_keyboard_alone(browser: Any, ready: Bench, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(ready.folder, tmp_path / "small"))
    with serving(folder, tmp_path, module=FEW) as bench, opening(browser, bench.address) as opened:
        watch = opened()
        watch.go("compare")
        press = watch.page.keyboard.press
        watch.expect(watch.at("version")).to_contain_text("Version 1 of 1", timeout=LONG)
        # Before the view is drawn the page may not yet listen to keys.
        watch.expect(watch.page.locator("[role=listbox] [role=option]").first).to_be_visible(timeout=LONG)
        press("d")
        watch.expect(watch.at("diagnose")).to_be_focused(timeout=LONG)
        press("Enter")
        watch.expect(watch.at("add-best")).to_be_focused(timeout=LONG)
        _preview_that_nobody_waits_for(watch)
        watch.at("add-best").focus()
        press("Enter")
        watch.expect(watch.at("version")).to_contain_text("Version 2 of 2", timeout=LONG)
        watch.expect(watch.at("undo")).to_be_enabled(timeout=LONG)  # the ranking that went on by itself has ended
        watch.expect(watch.page.locator("[data-testid=add-best]:focus, [data-testid=diagnose]:focus")).to_be_visible()
        press("u")
        watch.expect(watch.at("version")).to_contain_text("Version 1 of 2", timeout=LONG)
        _next_run_of_an_effect_that_none_shows(watch)


def _next_run_of_an_effect_that_none_shows(watch: Watch) -> None:
    """It says so after one manoeuvre of each kind, with progress before; a slow machine has to be asked again."""
    choice, go = watch.at("next-run").get_by_role("combobox"), watch.at("next-run-go")
    watch.expect(go).to_be_enabled(timeout=LONG)
    choice.select_option("sensor_gain.speed")
    go.focus()
    says = watch.at("next-run").locator(".next-says")
    again = "ask again for the others"
    while True:
        watch.page.keyboard.press("Enter")
        watch.expect(says).to_contain_text("simulating", timeout=LONG)
        watch.expect(says).to_contain_text("tried", timeout=LONG)
        if again not in says.inner_text():
            break
    watch.expect(says).to_contain_text("shows nothing of it, so the other")
    watch.expect(says).to_contain_text("it would stand out 0.0 times its noise")
    watch.picture("next-run")


def _jobs(watch: Watch) -> dict[str, str]:
    """Effect → state of the fits for previews that the server knows of."""
    found = watch.page.evaluate("fetch('api/jobs').then((a) => a.json())")
    return {job["args"]["effect"]: job["state"] for job in found if job["do"] == "preview"}


def _until(watch: Watch, effect: str, state: str) -> None:
    for _ in range(200):
        if _jobs(watch).get(effect) == state:
            return
        watch.quiet(100)
    raise AssertionError((effect, state, _jobs(watch)))


def _preview_that_nobody_waits_for(watch: Watch) -> None:
    """Two candidates chosen one after the other while other work is done: the first is not fitted any more."""
    post = "fetch('api/jobs', { method: 'POST', headers: { 'Content-Type': 'application/json' }, body: %r })"
    watch.page.evaluate(post % '{"do": "next", "args": {"effects": ["chassis_torsion"]}}')
    keys = watch.page.evaluate(
        "[...document.querySelectorAll('[data-testid^=candidate-]')].map((e) => e.dataset.testid.slice(10))"
    )
    first, second = keys[5:7]
    watch.at(f"candidate-{first}").focus()
    _until(watch, first, "waiting")
    watch.page.keyboard.press("ArrowDown")
    _until(watch, first, "cancelled")
    _until(watch, second, "waiting")
    watch.at("job-cancel").click()
    _until(watch, second, "done")
    assert _jobs(watch)[first] == "cancelled"
    watch.expect(watch.at("preview-says")).to_contain_text("RMS residual")
