"""Do the 95 % intervals hold the truth? Simulated campaigns of a complete model, and of one that lacks an effect.

Motions are stored: four manoeuvres of an independent car, smoothed, with loads that fulfil the model exactly. Each
campaign draws noise, zeros and, for the second claim, gains and latencies from the sensor sheet anew and is fitted as
any other. What does not change from one campaign to the next is computed once: sensitivities, and a pool of noise draws
from which each campaign takes six for its correction.

    python benchmarks/coverage.py                       # 1,000 campaigns of each kind, resumable, writes the table
    python benchmarks/coverage.py --campaigns 60 --folder build/try
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import time
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lacet.daq.channels import CHANNELS
from lacet.daq.formats.open_run import open_run
from lacet.identify.effects.catalogue import base_model, catalogue
from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.properties.whole_vehicle import NAMES, whole_vehicle
from lacet.identify.regression.corrected_scores import NOISE_DRAWS
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit, FitOptions, Stored, fit
from lacet.identify.signals.filters import Filters, derivative, zero_phase
from lacet.identify.signals.noise_draws import draw_noise
from lacet.identify.signals.reconstruct import Recording, Signals, bring_together
from lacet.identify.validation.parameter_estimates import estimates
from lacet.services.one_thread import one_thread
from tests.identify import cars

Array = NDArray[np.float64]
PAGE = Path(__file__).parents[1] / "docs" / "benchmarks" / "coverage.md"
FILTERS = Filters(rate=125.0)
SECONDS = 15.0
SMOOTH = 8.0
POOL = 60
LEANS = 0.8
BARS = ("anti_roll_bar.front", "anti_roll_bar.rear")
KINDS = {
    "noise": "noise and zeros drawn",
    "sheet": "noise, zeros, gains and latencies drawn",
    "missing": "noise and zeros drawn, the car has anti-roll bars and the model has not",
}


def models() -> tuple[Model, Model]:
    """The model with both bars, and without."""
    vehicle = cars.reference_car()[0]
    known = catalogue(vehicle, "hub")
    base = Model.of(base_model(vehicle, "hub"))
    return base + known[BARS[0]] + known[BARS[1]], base


@cache
def stored_motions() -> tuple[tuple[Recording, ...], Array]:
    """Exact recordings of the four manoeuvres, and every parameter of the model they fulfil."""
    vehicle, rig = cars.reference_car()
    runs = [open_run(cars.CAR / f"{name}.parquet") for name in cars.RUNS]
    records = [bring_together(run, vehicle, rig, FILTERS) for run in runs]
    model = models()[0]
    theta = fit(model, [PreparedRun(record) for record in records], FitOptions(unbias=False)).theta
    exact: list[Recording] = []
    for record in records:
        part = record.at(slice(0, int(SECONDS * FILTERS.rate)))
        smooth = {k: zero_phase(v, SMOOTH, FILTERS.rate, 6) for k, v in part.signals.value.items()}
        part = part.with_signals(Signals.differentiated(smooth, FILTERS.rate))
        exact.append(cars.fulfil(part, model.physics, theta))
    return tuple(exact), theta


def drawn(record: Recording, rng: np.random.Generator, sheet: Mapping[tuple[str, int], float]) -> PreparedRun:
    """A recording as its instruments would have measured it; `sheet` has the campaign's gains and latencies."""
    rig, values = record.rig, record.signals.value
    noise = draw_noise(record, values, rng)
    out: dict[str, Array] = {}
    for name, value in values.items():
        zeros = rig.tolerance(name, "zero") * rng.standard_normal((CHANNELS[name].width, 1))
        measured = value
        if sheet:
            gains = np.array([[sheet.get((name, k), 0.0)] for k in range(CHANNELS[name].width)])
            sensor = rig.sensor_of(name)
            late = sheet.get((f"latency {sensor.name if sensor else name}", 0), 0.0)
            measured = value * (1.0 + gains) - late * derivative(value, FILTERS.rate)
        out[name] = measured + noise[name] + zeros
    return PreparedRun(record.with_signals(Signals.differentiated(out, FILTERS.rate)))


def sheet_draw(record: Recording, rng: np.random.Generator) -> dict[tuple[str, int], float]:
    """Gains of every channel and latencies of every sensor, the same in all runs of a campaign."""
    rig = record.rig
    out: dict[tuple[str, int], float] = {}
    for name in record.signals.value:
        for k in range(CHANNELS[name].width):
            out[name, k] = rig.tolerance(name, "gain") * float(rng.standard_normal())
        sensor = rig.sensor_of(name)
        key = (f"latency {sensor.name if sensor else name}", 0)
        if key not in out:
            out[key] = rig.tolerance(name, "latency") * float(rng.standard_normal())
    return out


@cache
def reference(missing: bool) -> Fit:
    """A fit of one campaign that is not in the study, with a large pool of noise draws."""
    model = models()[1 if missing else 0]
    rng = np.random.default_rng([95, len(KINDS)])
    return fit(model, [drawn(record, rng, {}) for record in stored_motions()[0]], FitOptions(draws=POOL))


def campaign(task: tuple[str, int]) -> Array:
    """Values and σ: (4, names), rows estimate, σ from HAC, σ with the sheet, σ as if residuals were independent."""
    kind, number = task
    with one_thread():
        records, _ = stored_motions()
        rng = np.random.default_rng([95, list(KINDS).index(kind), number])
        sheet = sheet_draw(records[0], rng) if kind == "sheet" else {}
        base = reference(kind == "missing")
        some = base.moments.subset(rng.integers(0, POOL, NOISE_DRAWS))
        stored = Stored(base.stored.responses, some)
        found = fit(base.model, [drawn(record, rng, sheet) for record in records], stored=stored)
        return summary(found)


def summary(found: Fit) -> Array:
    """The reported values of a fit with their three σ; parameters kept, then whole-vehicle values."""
    vehicle = cars.reference_car()[0]
    parts: list[Array] = []
    for covariance in (found.covariance, found.covariance + found.covariance_sheet, found.covariance_iid):
        whole = whole_vehicle(replace(found, covariance=covariance), vehicle)
        assert whole is not None
        own = np.sqrt(np.diag(covariance))[found.place]
        if not parts:
            parts.append(np.concatenate([found.solution, whole.values]))
        parts.append(np.concatenate([own, whole.interval / TWO_SIDED_95]))
    return np.stack(parts)


def names(missing: bool) -> list[str]:
    """Names of the values."""
    return [*reference(missing).columns, *NAMES]


def reported() -> set[str]:
    """Values that lacet reports: not those it says the runs cannot tell, whose intervals are the prior's."""
    base = reference(False)
    whole = whole_vehicle(base, cars.reference_car()[0])
    assert whole is not None
    return {e.name for e in estimates(base, runs=base.runs) if e.identifiable} | {
        name for name, sure in zip(NAMES, whole.determined, strict=True) if sure
    }


def truth(missing: bool) -> Array:
    """True values: the exact motions' own parameters, grouped as the fit groups them."""
    base, (_, theta) = reference(missing), stored_motions()
    full = models()[0]
    values = dict(zip(full.names, theta, strict=True))
    physics = np.array([values[name] for name in base.model.names])
    exact = np.zeros(len(physics))
    exact[base.base.independent] = base.base.grouping() @ physics
    whole = whole_vehicle(replace(base, theta=exact), cars.reference_car()[0])
    assert whole is not None
    return np.concatenate([exact[base.place], whole.values])


def run_kind(kind: str, campaigns: int, folder: Path, workers: int) -> Array:
    """(campaigns, 4, names), from the folder as far as it is there."""
    file = folder / f"{kind}.npy"
    done = list(np.load(file)) if file.is_file() else []
    _ = reference(kind == "missing").stored  # made here, so that the workers inherit it
    start, fresh = time.monotonic(), len(done)
    with ProcessPoolExecutor(workers, multiprocessing.get_context("fork")) as pool:
        for found in pool.map(campaign, [(kind, n) for n in range(len(done), campaigns)], chunksize=2):
            done.append(found)
            if len(done) % 20 == 0 or len(done) == campaigns:
                np.save(file, np.stack(done))
                rate = (time.monotonic() - start) / max(1, len(done) - fresh)
                print(f"{kind}: {len(done)} of {campaigns}, {rate:.2f} s each", file=sys.stderr, flush=True)
    return np.stack(done[:campaigns])


def main() -> None:
    """Run the study and write its page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--campaigns", type=int, default=1000)
    parser.add_argument("--folder", type=Path, default=Path("build/coverage"), help="where unfinished work is kept")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--page", type=Path, default=PAGE, help="where the table goes")
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    with one_thread():  # small matrices: more threads would only wait for each other
        found = {kind: run_kind(kind, args.campaigns, args.folder, args.workers) for kind in KINDS}
        text = page(found)
    print(text)
    args.page.write_text(text, encoding="utf-8")


def held(found: Array, true: Array, which: int) -> Array:
    """(names,) % of campaigns whose 95 % interval holds the truth; `which` σ: 1 HAC, 2 with the sheet, 3 sxr."""
    return 100.0 * np.mean(np.abs(found[:, 0] - true) <= TWO_SIDED_95 * found[:, which], axis=0)


def page(found: Mapping[str, Array]) -> str:
    """The table as a page."""
    count = len(found["noise"])
    told = reported()
    exact, rough = truth(False), truth(True)
    columns = {
        "noise": held(found["noise"], exact, 1),
        "sxr": held(found["noise"], exact, 3),
        "sheet": held(found["sheet"], exact, 2),
    }
    short = dict(zip(names(True), held(found["missing"], rough, 1), strict=True))
    lines = [
        "# Do the intervals hold the truth?", "",
        f"{count} simulated campaigns of each kind, {len(cars.RUNS)} runs of {SECONDS:g} s: % of campaigns whose 95 % "
        "interval holds the true value. Written by `make coverage`. The four columns: ± as printed, noise and zeros "
        "drawn; the paper's sxr % taken as an interval, same campaigns; ± with the sheet, gains and latencies drawn as "
        "well; ± as printed when the model lacks both anti-roll bars, which no interval can cover.", "",
        f"°: scatters less than {LEANS:g} of its printed σ, because it leans on the prior of what the runs leave open "
        "(inertia of the axles). True values are near the middle of that prior here, so it holds them more often.", "",
        "| value | true | σ | ± printed | sxr % | ± with sheet | an effect missing |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]  # fmt: skip
    spread = np.std(found["noise"][:, 0], axis=0)
    widths = np.mean(found["noise"][:, 1], axis=0)
    for i, name in enumerate(names(False)):
        if name not in told:
            continue
        cells = [f"{columns[kind][i]:.1f}" for kind in ("noise", "sxr", "sheet")]
        last = f"{short[name]:.0f}" if name in short else "–"
        lean = " °" if spread[i] < LEANS * float(np.mean(found["noise"][:, 1, i])) else ""
        lines.append(f"| {name}{lean} | {exact[i]:.5g} | {spread[i]:.3g} | {' | '.join(cells)} | {last} |")
    for kind, about in (("noise", "± printed"), ("sxr", "sxr %"), ("sheet", "± with sheet")):
        own = [n in told and s >= LEANS * w for n, s, w in zip(names(False), spread, widths, strict=True)]
        part = columns[kind][own]
        inside = np.mean((part >= 92) & (part <= 98))
        lines += [
            "",
            f"{about}, without °: from {part.min():.1f} to {part.max():.1f} %, "
            f"{100 * inside:.0f} % of values within 92 to 98 %.",
        ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
