"""Every column of every channel with every fault: named when runs are read, or of no influence on the fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pytest

from benchmarks.fresh.cars import fresh_car, fresh_rig
from benchmarks.fresh.drives import drawn_drives
from lacet.daq.channels import COLUMNS
from lacet.daq.rig import Rig
from lacet.daq.run import Run
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.catalogue import base_model
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import fit
from lacet.identify.validation.channels.single_faults import column_faults
from lacet.services.render import channels
from lacet.services.workspace.loading import prepare_run
from lacet.simulate import Sheet, exchange_run
from lacet.simulate import run as simulate_drive
from lacet.simulate.vehicle_file import vehicle_text
from tests.identify.validation.channels.spoilt_columns import EVERY, spoilt_column

MATTERS = 0.5
"""Change of an estimate ÷ half of its interval from which a fault has an influence."""
CORNERS = ("fl", "fr", "rl", "rr")
OPEN = {
    *((f"wheel.{c}.moment.{axis}", "late") for c in CORNERS for axis in "xy"),
    *((f"wheel.{c}.moment.{axis}", "sign") for c in CORNERS for axis in "yz"),
    *((f"wheel.{c}.speed", "late") for c in CORNERS),
}
"""What is not named on every car, and moves an estimate by up to `NEARLY` half intervals."""
NEARLY = 3.0


@dataclass(frozen=True)
class Campaign:
    """Runs of a random car with errors of its instruments within the sheet."""

    runs: Sequence[Run]
    rig: Rig
    vehicle: Vehicle

    @classmethod
    def drawn(cls, number: int) -> Campaign:
        """The campaign of a number: its first two runs."""
        rng = np.random.default_rng(number)
        car, rig = fresh_car(rng, "every"), fresh_rig(rng, "every")
        used, _ = drawn_drives(car, rng)
        sheet = Sheet(zeros=True, gains=True, latencies=True, seed=number)
        motions = {name: simulate_drive(car, drive, [], 1) for name, drive in list(used.items())[:2]}
        runs = [
            exchange_run(motion, rig, seed, sheet=sheet, name=name)
            for seed, (name, motion) in enumerate(motions.items())
        ]
        return cls(runs, rig, Vehicle.parse(vehicle_text(car), "every"))

    def spoilt(self, column: str, fault: str) -> Campaign:
        """The campaign with a fault in one column of every run."""
        return Campaign([spoilt_column(run, column, fault) for run in self.runs], self.rig, self.vehicle)

    def said(self) -> list[str]:
        """Warnings when the runs are read."""
        out: list[str] = []
        ready = [prepare_run(run, self.vehicle, self.rig, None, out) for run in self.runs]
        return out + [channels.from_equations(x) for x in column_faults([r.prepared for r in ready if r.sound])]

    @cached_property
    def estimates(self) -> tuple[Array, Array]:
        """Parameters of the base model, and halves of their 95 % intervals."""
        model = Model.of(base_model(self.vehicle, self.rig.wheel_reference))
        fitted = fit(model, [PreparedRun.of(run, self.vehicle, self.rig) for run in self.runs])
        return fitted.theta, 1.96 * np.sqrt(np.diag(fitted.covariance))


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    return Campaign.drawn(2)


def names(said: Sequence[str], column: str) -> bool:
    """Whether a column, or its channel, is named."""
    return any(column in line or COLUMNS[column][0].name in line for line in said)


def influence(campaign: Campaign, spoilt: Campaign) -> float:
    """Largest change of an estimate ÷ half of its interval."""
    (theta, half), (moved, _) = campaign.estimates, spoilt.estimates
    return float(np.max(np.abs(moved - theta)[half > 0.0] / half[half > 0.0]))


def test_nothing_is_said_of_the_sound_campaign(campaign: Campaign) -> None:
    assert campaign.said() == []


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize(("column", "fault"), [
    ("wheel.fl.force.z", "÷ 1000"), ("wheel.rr.force.y", "sign"), ("imu.rate.x", "zero"), ("laser.fr.hub", "copy"),
    ("imu.accel.z", "late"), ("camera.fl.steer", "sign"), ("wheel.rl.moment.x", "× 1000"), ("laser.rl.ground", "late"),
])  # fmt: skip
def test_a_fault_is_named(campaign: Campaign, column: str, fault: str) -> None:
    said = campaign.spoilt(column, fault).said()
    assert names(said, column), said


@pytest.mark.slow  # 413 faults, some seconds each
@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("fault", EVERY)
def test_every_column_with_every_fault_is_named_or_has_no_influence(campaign: Campaign, fault: str) -> None:
    missed: dict[str, float] = {}
    for column in (c for c, (channel, _) in COLUMNS.items() if channel.name in campaign.runs[0].signals):
        spoilt = campaign.spoilt(column, fault)
        if not names(spoilt.said(), column):
            missed[column] = influence(campaign, spoilt)
    most = {c: NEARLY if (c, fault) in OPEN else MATTERS for c in missed}
    assert {column: round(moved, 2) for column, moved in missed.items() if moved > most[column]} == {}
