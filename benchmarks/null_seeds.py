"""Verdicts over seeds: the campaign of ``replay_logs`` with noise, zeros and clocks redrawn, diagnosed each time.

Run: ``python benchmarks/null_seeds.py`` (nothing hidden, seeds 1 to 20, writes ``docs/benchmarks/null-seeds.md``) or,
with both anti-roll bars hidden, ``python benchmarks/null_seeds.py --bars`` (seeds 1 to 5, ``bars-seeds.md``).
Motions are simulated once; each seed goes through the encoders of the drivers, their decoders and the clock fit, in
memory. The row of the committed captures' own seed is what the committed captures give.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from lacet.daq.formats.log_run import build_run
from lacet.daq.rig import Rig
from lacet.daq.run import Run
from lacet.daq.vehicle import Vehicle
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import fit
from lacet.identify.selection.candidate import Candidate
from lacet.identify.selection.diagnose import diagnose
from lacet.identify.selection.diagnosis import Diagnosis
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.noise_floor import floor_of
from lacet.identify.validation.score import compare
from lacet.services.acquisition.capture import encode_rig, simulated_start
from lacet.services.acquisition.stream_decoder import Decoder, decode_frames
from lacet.services.commands.simulate import HOUR_NS, RUN_STEP
from lacet.simulate import START_NS, Hidden, Sheet, SimulatedMotion, find_car, make_manoeuvre, measure
from lacet.simulate import run as simulate_drive
from lacet.simulate.vehicle_file import vehicle_text

USED = ("sinus", "liftoff", "rough")
HELD = ("spiral", "braking")
DURATION = 16.0
BARS = (Hidden("anti_roll_bar.front", 19780.0), Hidden("anti_roll_bar.rear", 19185.0))
SCORE_DRAWS = 20


@dataclass(frozen=True)
class Campaign:
    """Motions of a campaign, and how it is named: `seed` is that of its committed captures."""

    hidden: tuple[Hidden, ...]
    seed: int
    motions: dict[str, SimulatedMotion]

    @classmethod
    def driven(cls, hidden: tuple[Hidden, ...], seed: int) -> Campaign:
        """Simulate every run, as ``replay_logs/make.sh`` does."""
        car = find_car("peugeot-406")
        motions = {
            name: simulate_drive(car, make_manoeuvre(name, duration=DURATION), hidden, seed + RUN_STEP * index)
            for index, name in enumerate((*USED, *HELD))
        }
        return cls(hidden, seed, motions)

    def measured(self, seed: int, rig: Rig) -> dict[str, Run]:
        """The runs as another seed's sensors, wires and drivers give them."""
        runs: dict[str, Run] = {}
        for index, (name, motion) in enumerate(self.motions.items()):
            start_ns = START_NS + index * HOUR_NS
            blocks = measure(motion, rig, seed + RUN_STEP * index, sheet=Sheet(seed=seed), start_ns=start_ns)
            frames, documents = encode_rig(blocks, rig)
            decoder = Decoder(rig, documents)
            decoded = decode_frames(decoder, list(frames.values()))
            if decoder.losses():
                raise SystemExit(f"seed {seed}, {name}: {decoder.losses()}")
            start = simulated_start(name, motion, rig, vehicle_text(motion.car), start_ns)
            runs[name] = build_run(name, start, decoded)
        return runs


@dataclass(frozen=True)
class Verdict:
    """What one seed gave: effects added in order, the last diagnosis, worst held-out row and its ratio."""

    seed: int
    added: tuple[str, ...]
    last: Diagnosis
    held: tuple[str, float]
    held_ratios: tuple[float, ...]
    seconds: float

    @property
    def first(self) -> Candidate:
        """The candidate nearest to being proposed: smallest p, of these the largest gain."""
        tested = [c for c in self.last.candidates if c.tested]
        return min(tested, key=lambda c: (c.p, -c.total_gain))


def judge(campaign: Campaign, seed: int, draws: int) -> Verdict:
    """Diagnose one seed, adding what is proposed until nothing is."""
    begin = time.perf_counter()
    rig, vehicle = Rig.load("peugeot-406"), Vehicle.load("peugeot-406")
    runs = {name: PreparedRun.of(run, vehicle, rig) for name, run in campaign.measured(seed, rig).items()}
    known = catalogue(vehicle, rig.wheel_reference)
    candidates = [effect for effect in known.values() if not effect.base]
    model, added = Model.of(base_model(vehicle, rig.wheel_reference)), []
    while True:
        fitted = fit(model, [runs[name] for name in USED])
        diagnosis = diagnose(fitted, floor_of(fitted, draws), candidates)
        if diagnosis.best is None or len(added) == 4:
            break
        added.append(diagnosis.best.key)
        shapes = known[diagnosis.best.key].shapes()
        model = model + next(e for e in shapes if dict(e.shape) == dict(diagnosis.best.shape))
    held = [
        (score.ratio, f"{name} {row}")
        for name in HELD
        for row, score in compare(fitted, runs[name], SCORE_DRAWS).scores.items()
    ]
    worst, where = max(held)
    ratios = tuple(ratio for ratio, _ in held)
    return Verdict(seed, tuple(added), diagnosis, (where, worst), ratios, time.perf_counter() - begin)


def table(verdicts: Iterable[Verdict]) -> list[str]:
    """Rows of a Markdown table."""
    lines = [
        "| seed | added | verdict | nearest candidate left | p | gain % | worst row used | held out |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for v in verdicts:
        ratios = v.last.ratios
        row = max(ratios, key=lambda name: ratios[name])
        lines.append(
            f"| {v.seed} | {', '.join(v.added) or 'nothing'} | {v.last.verdict} | {v.first.key} | {v.first.p:.2f} | "
            f"{100 * v.first.gain:.2f} | {row} {ratios[row]:.2f} | {v.held[0]} {v.held[1]:.2f} |"
        )
    return lines


def page(campaign: Campaign, verdicts: Sequence[Verdict], draws: int, command: str) -> str:
    """The page with the table."""
    wanted = tuple(effect.name for effect in campaign.hidden)
    right = sum(sorted(v.added) == sorted(wanted) for v in verdicts)
    quiet = sum(v.last.verdict == "nothing missing" for v in verdicts)
    hidden = " and ".join(f"`{effect.name}` ({effect.size:g} N/m)" for effect in campaign.hidden) or "nothing"
    ratios = np.array([ratio for v in verdicts for ratio in v.held_ratios])
    alarms = sum(v.first.p <= SELECTION.significance for v in verdicts)
    return "\n".join(
        [
            f"# Hidden: {hidden.replace('`', '')}; seeds {verdicts[0].seed} to {verdicts[-1].seed}",
            "",
            f"Hidden in the simulated car: {hidden}. Runs used: {', '.join(USED)}; held out: {', '.join(HELD)}; "
            f"{DURATION:g} s each, rig `peugeot-406`. Motions simulated once (seed {campaign.seed}, as the committed "
            "captures); noise, zeros and clocks drawn anew by seed, through encoders, decoders and clock fit. "
            f"{draws} noise-floor draws a diagnosis, so the smallest possible p is {1 / (draws + 1):.3f}.",
            "",
            f"**Exactly what was hidden was named in {right} of {len(verdicts)} seeds**; the last verdict was "
            f'"nothing missing" in {quiet}. A candidate with p ≤ {SELECTION.significance:g} is left in {alarms} '
            f"seeds, not proposed because its gain or the whole excess over the floor is too small. "
            f"Held-out residual ÷ floor over all rows and seeds: mean "
            f"{ratios.mean():.3f}, 95 % below {np.quantile(ratios, 0.95):.3f}, largest {ratios.max():.3f}.",
            "",
            *table(verdicts),
            "",
            "A candidate is proposed at p ≤ 0.05, a gain of at least 1 %, and when what it belongs to explains half of "
            "the excess over the floor; the one with the smallest p is shown. "
            "*worst row used*: residual ÷ noise floor of the last model, over the runs used; *held out*: the same for "
            "the worst row of the runs held out.",
            "",
            f"Made by `{command}`.",
            "",
        ]
    )


def main() -> None:
    """Judge every seed, print the table, write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bars", action="store_true", help="hide both anti-roll bars")
    parser.add_argument("--seeds", type=int, help="how many (default 20, with --bars 5)")
    parser.add_argument("--draws", type=int, default=99, help="noise-floor simulations (default 99)")
    parser.add_argument("--processes", type=int, default=1, help="seeds judged side by side (default 1)")
    args = parser.parse_args()
    count = args.seeds or (5 if args.bars else 20)
    campaign = Campaign.driven(BARS, 2) if args.bars else Campaign.driven((), 1)
    verdicts: list[Verdict] = []
    with ProcessPoolExecutor(args.processes, mp_context=get_context("spawn")) as pool:
        jobs = [pool.submit(judge, campaign, seed, args.draws) for seed in range(1, count + 1)]
        for job in jobs:
            verdicts.append(job.result())
            print(table(verdicts[-1:])[-1], f"{verdicts[-1].seconds:.0f} s", flush=True)
    bars = " --bars" if args.bars else ""
    command = f"python benchmarks/null_seeds.py{bars} --seeds {count} --draws {args.draws}"
    target = (
        Path(__file__).resolve().parents[1]
        / "docs"
        / "benchmarks"
        / ("bars-seeds.md" if args.bars else "null-seeds.md")
    )
    target.parent.mkdir(exist_ok=True)
    text = page(campaign, verdicts, args.draws, command)
    target.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
