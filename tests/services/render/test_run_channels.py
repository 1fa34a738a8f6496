"""The channels of a run as text: one line a sensor, whatever it lacks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lacet.daq.blocks import Flag
from lacet.services.render.run_channels import channels_text
from tests.support.tables import piece


def test_one_line_a_sensor_with_its_channels_and_rates():
    lines = channels_text(piece("sine", 5.0, 6.0).signals).splitlines()
    assert [line.split()[0] for line in lines[2:-1]] == ["wheel", "laser", "camera", "imu", "correvit"]
    assert "fl fr rl rr force, moment, speed, angle" in lines[2]
    assert lines[2].split()[-2:] == ["250", "250.0"]
    assert "accel, rate, attitude" in lines[5]
    assert lines[-1] == "  unusable samples: none"


def test_what_is_lacking_unusable_or_of_another_rate_is_shown():
    run = piece("sine", 5.0, 6.0)
    signals = {name: s for name, s in run.signals.items() if name not in ("wheel.rr.angle", "laser.fr.hub")}
    s = signals["imu.rate"]
    signals["imu.rate"] = replace(s, t=s.t[::2], values=s.values[::2], flags=s.flags[::2])
    force = signals["wheel.fl.force"]
    flags = force.flags.copy()
    flags[10:17] = int(Flag.STATUS)
    signals["wheel.fl.force"] = replace(force, flags=flags)
    lines = channels_text(signals).splitlines()
    assert "fl fr rl rr force, moment, speed; fl fr rl angle" in lines[2]
    assert "fl fr rl rr ground; fl rl rr hub" in lines[3]
    assert lines[5].split()[-6:] == ["125", "to", "250", "125.0", "to", "250.0"]
    assert lines[-1] == "  unusable samples: wheel.fl.force 7 of 250"


def test_empty_cells_of_a_channel_slower_than_its_table_are_no_lost_samples():
    signals = dict(piece("sine", 5.0, 6.0).signals)
    speed = signals["correvit.speed"]
    flags = np.full(speed.t.size, np.uint8(Flag.MISSING))
    flags[::5] = 0
    signals["correvit.speed"] = replace(speed, flags=flags)
    lines = channels_text(signals).splitlines()
    assert lines[6].split()[-2:] == ["50", "50.0"]
    assert lines[-1] == "  unusable samples: none"
