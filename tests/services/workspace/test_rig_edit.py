"""A rig file with other latencies: nothing else changes."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lacet.daq.rig import Rig
from lacet.services.commands.__main__ import main
from lacet.services.workspace.rig_text import with_latencies
from tests.support.places import HOME
from tests.support.tables import CAR, FILES

TEXTS = [
    (CAR / "rig.toml").read_text(encoding="utf-8"),
    (HOME / "daq" / "rigs" / "peugeot-406.toml").read_text(encoding="utf-8"),
    """\
format = "lacet-rig 1"
name = "imu"   # the rig's name, not a sensor's
[[sensor]]
channels = ["imu.*"]
name = 'imu'
[sensor.noise]
"imu.accel" = 1.0
""",
]


@settings(max_examples=30, deadline=None)
@given(text=st.sampled_from(TEXTS), data=st.data())
def test_only_the_latencies_asked_for_change(text: str, data: st.DataObject) -> None:
    """Read back, the rig is the same but for them; comments stay."""
    before = Rig.parse(text)
    names = data.draw(st.sets(st.sampled_from([s.name for s in before.sensors])))
    latencies = {name: data.draw(st.integers(0, 40_00)) * 1e-5 for name in sorted(names)}
    changed = with_latencies(text, latencies)
    after = Rig.parse(changed)
    wanted = tuple(replace(s, latency=latencies.get(s.name, s.latency)) for s in before.sensors)
    for one, other in zip(after.sensors, wanted, strict=True):
        assert one.latency == pytest.approx(other.latency, abs=1e-9)
        assert replace(one, latency=0.0) == replace(other, latency=0.0)
    assert [line for line in changed.splitlines() if not line.lstrip().startswith("latency")] == [
        line for line in text.splitlines() if not line.lstrip().startswith("latency")
    ]
    assert with_latencies(text, {}).rstrip() == text.rstrip()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--only", "noise", "--write-rig", "new.toml"], "ask for them"),
        (["--write-rig", str(CAR / "rig.toml")], "already there"),
        (["--only", "latency", "--time-base", "laser"], "did you mean 'lasers'"),
    ],
)
def test_check_refuses_what_it_cannot_do(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 2, and what to do."""
    assert main(["check", str(CAR / "sine.parquet"), *FILES, *words]) == 2
    assert said in capsys.readouterr().err
