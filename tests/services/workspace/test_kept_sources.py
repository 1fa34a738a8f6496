"""Runs of a rig that measures less are kept in a study and restored with their sources, to the last bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lacet.daq.channels import CHANNELS, CORNERS
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.services.cache.records import from_record, to_record
from lacet.services.workspace.kept.run_records import restored_runs, runs_record
from lacet.services.workspace.loading import Loaded
from tests.identify import cars


def test_sources_are_the_same_after_a_run_was_kept() -> None:
    """Laws and assumptions are made anew of the channels; a derived channel is not taken for a measured one."""
    vehicle, rig = cars.reference_car()
    whole = cars.piece("sine", 5.0, 10.0)
    signals = {n: s for n, s in whole.signals.items() if n.endswith(".force") or n in ("imu.accel", "imu.rate")}
    signals["correvit.speed"] = whole.signals["correvit.speed"]
    run = PreparedRun.of(replace(whole, signals=signals), vehicle, rig)
    assert "imu.attitude" in run.recording.sources
    kept = from_record(to_record(runs_record(Loaded(vehicle, rig, (run,), ()))))
    (again,) = restored_runs(kept, rig, vehicle).prepared
    assert again.recording.sources == run.recording.sources
    assert again.recording.assumptions == run.recording.assumptions
    assert again.rows == run.rows
    for row in run.rows:
        np.testing.assert_array_equal(again.measured[row], run.measured[row], err_msg=row)


def test_a_travel_s_sensor_is_that_of_the_laser_after_a_run_was_kept() -> None:
    """With its latency and noise; where the travel itself was not recorded the rig stays as it is."""
    vehicle, given = cars.reference_car()
    pots = replace(
        next(one for one in given.sensors if "laser.fl.hub" in one.channels), name="pots", latency=0.01,
        channels=tuple(f"suspension.{c}.travel" for c in CORNERS), noise={"suspension.travel": 0.0007}, position={},
    )  # fmt: skip
    rig = replace(given, sensors=(*given.sensors, pots))
    whole = cars.piece("sine", 5.0, 10.0)
    travels = {f"suspension.{c}.travel": whole.signals[f"laser.{c}.hub"] for c in CORNERS}
    others = {n: s for n, s in whole.signals.items() if CHANNELS[n].family != "laser.hub"}
    for signals, latency in ((others | travels, 0.01), (dict(whole.signals), given.latency("laser.fl.hub"))):
        run = PreparedRun.of(replace(whole, signals=signals), vehicle, rig)
        kept = from_record(to_record(runs_record(Loaded(vehicle, rig, (run,), ()))))
        again = restored_runs(kept, rig, vehicle)
        assert again.prepared[0].recording.rig == run.recording.rig
        assert again.rig.latency("laser.fl.hub") == run.recording.rig.latency("laser.fl.hub") == latency
        np.testing.assert_array_equal(again.prepared[0].motion.corners["fl"].rate, run.motion.corners["fl"].rate)
