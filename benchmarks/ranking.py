"""How long a ranking takes: 30 candidates on 10 minutes of data, all rows, 250 Hz, beside one dense solution each.

Five manoeuvres of the simulated 406 are driven once and measured five times with other noise. The peer is what a script
would do: numpy's dense least squares of model, zeros, sheet and one candidate, for every candidate anew; three are
timed. Fit and noise floor are made beforehand and told apart: a study keeps what is simulated.

    python benchmarks/ranking.py            # about 8 minutes, most of it the fit
    python benchmarks/ranking.py --bar 6000 # with something to find: the best is refined, what it leaves is looked at
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import fit
from lacet.identify.selection.columns.linearisation import Linearisation
from lacet.identify.selection.columns.samples import HeldSamples
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.selection.score_tests import ScoreTests
from lacet.identify.validation.noise_floor import floor_of
from lacet.services.one_thread import one_thread
from lacet.simulate import Hidden, exchange_run, find_car, make_manoeuvre
from lacet.simulate import run as simulate_drive

MANOEUVRES = ("sinus", "liftoff", "rough", "sweep", "spiral")
TIMED = 3
T = TypeVar("T")


def timed(what: str, function: Callable[[], T]) -> tuple[T, float]:
    """Call, and tell how long it took on the clock and on the processor."""
    wall, processor = time.perf_counter(), time.process_time()
    out = function()
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    print(f"{what}: {wall:.1f} s, {processor:.1f} s of processor time", flush=True)
    return out, processor


def dense(space: ScoreTests) -> Callable[[int], float]:
    """Dense weighted least squares of everything and one candidate."""
    base = [*range(space.layout.model), *range(space.layout.model, space.layout.model + len(space.layout.sheet))]
    samples = space.sums.samples
    assert isinstance(samples, HeldSamples)
    blocks = [(number, block) for number, run in enumerate(samples.runs) for block in run.blocks]
    starts = np.concatenate([[0], np.cumsum([len(block.columns) for _, block in blocks])])
    widths = [len(run.zero_gain) for run in samples.runs]
    offsets = np.concatenate([[0], np.cumsum(widths)]) + len(base)
    whole = np.zeros((starts[-1], offsets[-1] + 2))
    wanted = {place: column for column, place in enumerate(base)}

    def solved(place: int) -> float:
        for (run, block), start, stop in zip(blocks, starts[:-1], starts[1:], strict=True):
            for column, at in enumerate(block.active.tolist()):
                if at in wanted:
                    whole[start:stop, wanted[at]] = block.columns[:, column]
                if at == place:
                    whole[start:stop, -2] = block.columns[:, column]
            whole[start:stop, offsets[run] : offsets[run] + widths[run]] = block.zeros
            whole[start:stop, -1] = block.columns[:, -1]
        return float(np.linalg.lstsq(whole[:, :-1], whole[:, -1], rcond=None)[0][-1])

    return solved


def main() -> None:
    """Time it and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=600.0, help="data in all (default 600)")
    parser.add_argument("--candidates", type=int, default=30, help="how many (default 30; 0: the whole catalogue)")
    parser.add_argument("--draws", type=int, default=199, help="noise-floor simulations (default 199)")
    parser.add_argument("--bar", type=float, default=0.0, help="rate of a front anti-roll bar hidden in the car [N/m]")
    args = parser.parse_args()
    rig, car = Rig.load("peugeot-406"), find_car("peugeot-406")
    vehicle = Vehicle.load("peugeot-406")
    each = args.seconds / (5 * len(MANOEUVRES))
    hidden = [Hidden("anti_roll_bar.front", args.bar)] if args.bar else []
    motions = [simulate_drive(car, make_manoeuvre(name, duration=each), hidden, k) for k, name in enumerate(MANOEUVRES)]
    runs = [
        exchange_run(motion, rig, 100 * k + seed, name=f"{motion.manoeuvre}-{seed}")
        for k, motion in enumerate(motions)
        for seed in range(5)
    ]
    with one_thread():
        drives = [PreparedRun.of(run, vehicle, rig) for run in runs]
        reference = drives[0].recording.reference
        every = [e for e in catalogue(vehicle, reference).values() if not e.base]
        candidates = every[: args.candidates] if args.candidates else every
        fitted, _ = timed("fit", lambda: fit(Model.of(base_model(vehicle, reference)), drives))
        floor, _ = timed(f"noise floor, {args.draws} draws", lambda: floor_of(fitted, args.draws))
        first, _ = timed("first ranking, noise in the columns simulated", lambda: diagnose(fitted, floor, candidates))
        _, ours = timed("ranking", lambda: diagnose(fitted, floor, candidates, noise=first.noise))
        space = ScoreTests.of(Linearisation.of(fitted, floor), candidates, 0, first.noise)
        solve = dense(space)
        _, theirs = timed(
            f"dense least squares of {TIMED} candidates",
            lambda: [solve(trial.place.start) for trial in space.layout.trials[:TIMED]],
        )
    ratio = theirs / TIMED * len(candidates) / ours
    print(
        f"{len(candidates)} candidates, {args.seconds:g} s of data, {fitted.runs[0].recording.filters.rate:g} Hz, "
        f"{len(fitted.rows)} rows: ranked in {ours:.1f} s of processor time; dense least squares for each would take "
        f"{ratio:.0f} times as long, without shapes, cross-validation or chance"
    )


if __name__ == "__main__":
    main()
