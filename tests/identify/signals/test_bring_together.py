"""What runs are refused whose times cannot be those of one drive, before memory is spent on them."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.daq.errors import RunError
from lacet.daq.run import Run, Signal
from lacet.identify.signals.filters import Filters
from lacet.identify.signals.reconstruct import bring_together
from tests.identify import cars

VEHICLE, RIG = cars.reference_car()


def made(**times: np.ndarray) -> Run:
    """Channels of zeros at these times."""
    signals = {
        name.replace("__", "."): Signal(t, np.zeros((t.size, 1)), np.zeros(t.size, np.uint8))
        for name, t in times.items()
    }
    return Run("made", signals)


def test_a_run_with_a_hole_of_hours_is_refused_with_its_parts() -> None:
    """Whichever channels have samples on either side; a channel that has some in between leaves no such hole."""
    before, after = np.arange(0.0, 6.0, 0.01), np.arange(9e8, 9e8 + 5.0, 0.01)
    whole, slow = np.r_[before, after], np.r_[0.0:6.0:0.05, 9e8 + 0.5 : 9e8 + 5.0 : 0.05]
    with pytest.raises(RunError, match=r"from 5\.99 to 900000000\.00 s.*--to 5\.99, or --from 900000000\.00"):
        bring_together(made(laser__fl__hub=whole, laser__fr__hub=slow), VEHICLE, RIG, Filters())
    rare = np.r_[before, np.arange(300.0, 3000.0, 300.0), 3000.0 + before]
    many = np.arange(0.0, 6.0, 0.004)
    short = bring_together(
        made(laser__fl__hub=np.r_[many, 3000.0 + many], laser__fr__hub=rare), VEHICLE, RIG, Filters()
    )
    assert short.t[-1] > 3000.0


def test_a_run_that_is_sampled_too_slowly_is_refused() -> None:
    slow = np.arange(0.0, 100.0, 0.2)
    with pytest.raises(RunError, match=r"no channel has more than 5 samples a second; a fit up to 5 Hz needs 10"):
        bring_together(made(laser__fl__hub=slow), VEHICLE, RIG, Filters(fit_cutoff=5.0))
    fast = np.arange(0.0, 100.0, 0.01)
    assert bring_together(made(laser__fl__hub=slow, laser__fr__hub=fast), VEHICLE, RIG, Filters()).t.size
