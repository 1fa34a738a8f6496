"""The regressor of the 42-body car: lacet against Pinocchio's `computeJointTorqueRegressor`, in one run on one machine.

Run: ``python -m benchmarks.chain_regressor [--write]``. Absolute figures vary with the machine; the ratios hold. Both
get the same tree and the same states and give the same entries, which is checked first. Exit code 1 when a ratio is
below what is wanted.
"""

from __future__ import annotations

import argparse
import mmap
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numba
import numpy as np
import pinocchio as pin

from lacet.identify.car.car_tree import car_chain
from lacet.identify.multibody.chain import Chain
from lacet.services.one_thread import one_thread

STATES, ROUNDS = 4000, 15
PIECE = 64
"""States at a time where the memory of the result is used again."""
NEAR = 1e-10
"""Largest difference of two entries, as a part of the largest."""
PAGE = Path(__file__).parents[1] / "docs" / "benchmarks" / "chain.md"
COLUMNS = [9, 6, 7, 8, 0, 1, 3, 2, 4, 5]
"""Pinocchio's m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz among our ten."""

DROPS, KEEPS = "Pinocchio's loop, each result dropped", "Pinocchio's loop, results kept in one array"
SLOW, DENSE = "lacet by Jacobians (NumPy alone), kept", "`regressor`, kept"
PIECES = f"`regressor` into the same array, {PIECE} states at a time, dropped"
PACKED = "`packed_regressor`, kept"
MEMORY = "memory for kept results and nothing else: zeros, one written in each page"


@dataclass(frozen=True)
class Wanted:
    """At least `ratio` times the states a second of `peer`."""

    peer: str
    ratio: float


WANTED = {DENSE: Wanted(KEEPS, 3.0), PIECES: Wanted(DROPS, 3.0), PACKED: Wanted(DROPS, 5.0)}
THREADS = 1.6
"""Wanted of two threads, times one."""


def twin(chain: Chain) -> pin.Model:
    """The tree in Pinocchio, from the placements of its joints."""
    model = pin.Model()
    model.gravity.linear = chain.gravity
    made = {0: pin.JointModelRZ, 1: pin.JointModelPZ}

    def placed(axis: int, angle: float, *shift: float) -> pin.SE3:
        return pin.SE3(pin.AngleAxis(angle, np.eye(3)[axis]).toRotationMatrix(), np.array(shift))

    for k in chain.joints:
        place = placed(2, k.gamma, 0, 0, k.b) * placed(0, k.alpha, 0, 0, 0) * placed(2, k.theta, k.d, 0, k.r)
        model.addJoint(k.ant, made[k.sigma](), place, f"j{k.j}")
    return model


def measured(work: dict[str, Callable[[], object]], clock: Callable[[], float]) -> dict[str, float]:
    """States a second of each, the best of several rounds in which they take turns."""
    times: dict[str, float] = dict.fromkeys(work, np.inf)
    for _ in range(ROUNDS):
        for name, one in work.items():
            begin = clock()
            result = one()
            times[name] = min(times[name], clock() - begin)
            del result  # giving the memory back is not timed
    return {name: STATES / seconds for name, seconds in times.items()}


def first_use() -> tuple[float, float]:
    """Processor time of the first regressor of a process [s]: with nothing compiled yet, and with the code kept."""
    asked = (
        "import time; from lacet import Chain; arm = Chain.from_table([{'j': 1}]); begin = time.process_time();"
        "arm.regressor([[0.1]], [[0.1]], [[0.1]]); print(time.process_time() - begin)"
    )
    found: list[list[float]] = []
    for _ in range(3):
        with tempfile.TemporaryDirectory() as folder:
            command, env = [sys.executable, "-c", asked], {**os.environ, "NUMBA_CACHE_DIR": folder}
            found.append([float(subprocess.check_output(command, env=env, text=True)) for _ in range(2)])
    cold, kept = np.min(found, axis=0)
    return float(cold), float(kept)


def main() -> int:
    """Check, measure, print, and write the page when asked to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write the page")
    args = parser.parse_args()
    chain = car_chain().chain
    model = twin(chain)
    data = model.createData()
    q, qd, qdd = np.random.default_rng(0).uniform(-1, 1, (3, STATES, chain.n))
    slow = [np.ascontiguousarray(x.T) for x in (q, qd, qdd)]
    shape = (chain.n, 10 * chain.n)
    piece = np.zeros((PIECE, *shape))

    def drops() -> None:
        for i in range(STATES):
            pin.computeJointTorqueRegressor(model, data, q[i], qd[i], qdd[i])

    def keeps() -> np.ndarray:
        out = np.zeros((STATES, *shape))
        for i in range(STATES):
            out[i] = pin.computeJointTorqueRegressor(model, data, q[i], qd[i], qdd[i])
        return out

    def memory() -> np.ndarray:
        out = np.zeros(STATES * shape[0] * shape[1])
        out[:: mmap.PAGESIZE // out.itemsize] = 1.0
        return out

    def pieces() -> None:
        for i in range(0, STATES, PIECE):
            part = slice(i, i + PIECE)
            chain.regressor(q[part], qd[part], qdd[part], out=piece[: len(q[part])])

    dense = chain.regressor(q, qd, qdd)
    largest = np.max(np.abs(dense))
    theirs = keeps().reshape(STATES, chain.n, chain.n, 10)
    assert np.max(np.abs(dense.reshape(theirs.shape)[..., COLUMNS] - theirs)) < NEAR * largest
    assert np.max(np.abs(dense - chain.structure(*slow))) < NEAR * largest
    packed = chain.packed_regressor(q, qd, qdd)
    assert np.array_equal(packed.dense(), dense)
    entries = packed.values.shape[1]
    del dense, theirs, packed

    rate = measured(
        {
            DROPS: drops,
            KEEPS: keeps,
            SLOW: lambda: chain.structure(*slow),
            DENSE: lambda: chain.regressor(q, qd, qdd),
            MEMORY: memory,
            PIECES: pieces,
            PACKED: lambda: chain.packed_regressor(q, qd, qdd),
        },
        time.process_time,
    )
    lines = [
        "| one thread | states/s | ÷ Pinocchio, dropped | ÷ Pinocchio, kept | wanted |",
        "|---|---:|---:|---:|---|",
    ]
    kept = True
    for name, found in rate.items():
        wanted = WANTED.get(name)
        says = f"{wanted.ratio:g} × {'dropped' if wanted.peer == DROPS else 'kept'}" if wanted else ""
        lines.append(f"| {name} | {found:,.0f} | {found / rate[DROPS]:.2f} | {found / rate[KEEPS]:.2f} | {says} |")
        kept = kept and (wanted is None or found >= wanted.ratio * rate[wanted.peer])

    both = {
        f"{name}{threads}": lambda method=method, threads=threads: method(q, qd, qdd, threads=threads)
        for name, method in ((DENSE, chain.regressor), (PACKED, chain.packed_regressor))
        for threads in (1, 2)
    }
    clock, spent = measured(both, time.perf_counter), measured(both, time.process_time)
    lines += [
        "",
        "| two threads | states/s by the clock | ÷ one thread | wanted | processor time ÷ one thread's |",
        "|---|---:|---:|---:|---:|",
    ]
    for name in (DENSE, PACKED):
        one, two = clock[f"{name}1"], clock[f"{name}2"]
        more = spent[f"{name}1"] / spent[f"{name}2"]
        lines.append(f"| {name} | {two:,.0f} | {two / one:.2f} | {THREADS:g} | {more:.2f} |")
        kept = kept and two >= THREADS * one

    cold, warm = first_use()
    about = (
        f"{STATES:,} random states, {shape[0]} × {shape[1]} entries each, {entries:,} of them packed; the best of "
        f"{ROUNDS} rounds in which all took turns. Pinocchio {pin.__version__}, Numba {numba.__version__}, NumPy "
        f"{np.__version__}, {os.cpu_count()} cores, {os.getloadavg()[0]:.1f} processes at work on the machine "
        "meanwhile, this one included."
    )
    first = (
        f"The first regressor of a process takes {warm:.1f} s of the processor, to load Numba and the compiled code, "
        f"and {cold:.1f} s where nothing was compiled before."
    )
    print(about, *lines, "", first, "all as wanted" if kept else "BELOW WHAT IS WANTED", sep="\n")
    if args.write:
        PAGE.write_text(f"{HEAD}\n{about}\n\n" + "\n".join(lines) + f"\n\n{first}\n\n{FOOT}\n", encoding="utf-8")
    return 0 if kept else 1


HEAD = """# How fast a chain's regressor is

Written by `python -m benchmarks.chain_regressor --write`. The tree is the 42-body car, the peer a Python loop over
Pinocchio's `computeJointTorqueRegressor`, on the same states. All entries are compared first: the largest difference is
below 1e-10 of the largest entry. The first table is in processor time.
"""
FOOT = """Two threads by the clock need two free cores; their processor time says what they cost beyond one thread's.

A whole regressor is 141 kB a state, most of it zeros. Where whole results are kept, most of the time is the system's,
for giving out zeroed memory (the row of the memory alone); so it is compared with the loop that keeps its results. A
loop that drops them writes to the same 141 kB again and again, as `out=` does; the packed form has few zeros."""


if __name__ == "__main__":
    with one_thread():
        sys.exit(main())
