"""A channel that reads 0 throughout has columns of zeros: a ranking says what it can of them, and ends."""

from __future__ import annotations

from lacet.identify.effects.catalogue import catalogue
from lacet.identify.effects.language.compiled import one_line_effects
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import fit
from lacet.identify.selection.candidate import Answer
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.validation.noise_floor import floor_of
from tests.identify import cars


def test_laws_of_a_rate_that_reads_zero_are_not_testable() -> None:
    vehicle, rig = cars.reference_car()
    known = catalogue(vehicle, "hub")
    run = cars.piece("sine", 2.0, 10.0)
    rates = run.signals["imu.rate"].values.copy()
    rates[:, 0] = 0.0
    drive = PreparedRun.of(run.with_values({"imu.rate": rates}), vehicle, rig)
    fitted = fit(Model.of([effect for effect in known.values() if effect.base]), [drive])
    law = one_line_effects("rolling = chassis.fy: p * roll_rate", vehicle, "hub")
    found = diagnose(fitted, floor_of(fitted, 19), [known["anti_roll_bar.front"], *law])
    bar, rolling = found.candidates
    assert bar.key == "anti_roll_bar.front"
    assert bar.drop > 0.0
    assert rolling.answer is Answer.NOT_TESTABLE
    assert (rolling.size, rolling.absorbed) == (0.0, ())
