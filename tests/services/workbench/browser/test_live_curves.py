"""Which channels the live page draws until the user chooses."""

from __future__ import annotations

from typing import Any

from tests.services.workbench.browser.bench import opening, serving

_SECONDS = """
async () => {
  const { show } = await import("/js/views/live.js");
  const channel = (name) => ({ name, unit: "m", samples: 9, rate: 100, expected: 100, age: 0, flagged: 0, losses: 0,
    state: { kind: "good", text: "good" } });
  const live = (...names) => ({ connected: true, recording: true, run: "run", channels: names.map(channel),
    sensors: [], marks: [] });
  let hear;
  const api = {
    get: async () => live("laser.fl.ground"),
    post: async () => ({ state: null, note: "" }),
    binary: async () => ({ meta: { channels: {} }, arrays: {} }),
  };
  const on = (listener) => { hear = listener; return () => {}; };
  const app = { api, state: { study: null }, on, complain: () => {} };
  const root = document.createElement("div");
  document.getElementById("main").append(root);
  await show(root, app);
  const checked = () => [...root.querySelectorAll("[data-testid^=curve-]:checked")]
    .map((e) => e.dataset.testid.slice(6));
  const out = [checked()];
  hear({ live: live("laser.fl.ground", "imu.accel") });
  out.push(checked());
  hear({ live: live("laser.fl.ground", "imu.accel", "correvit.speed") });
  out.push(checked().sort());
  root.querySelector("[data-testid='curve-imu.accel']").click();
  hear({ live: live("laser.fl.ground", "imu.accel", "correvit.speed") });
  out.push(checked());
  return out;
}
"""


def test_they_do_not_hang_on_which_sensor_is_heard_first(browser: Any, tmp_path: Any) -> None:
    with serving(tmp_path / "none", tmp_path) as bench, opening(browser, bench.address) as opened:
        watch = opened()
        watch.go("runs")
        assert watch.page.evaluate(_SECONDS) == [
            ["laser.fl.ground"], ["imu.accel"], ["correvit.speed", "imu.accel"], ["correvit.speed"],
        ]  # fmt: skip
