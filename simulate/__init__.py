"""Independent simulation of the instrumented car: another engine and other laws than the identification's.

    from lacet.simulate import Hidden, find_car, make_manoeuvre, measure, run
    motion = run(find_car("peugeot-406"), make_manoeuvre("sinus"), [Hidden("anti_roll_bar.front", 19780.0)], seed=1)
    blocks = measure(motion, rig, seed=1)

The car, exactly: a rigid chassis; at each corner a carrier whose wheel centre slides along body z, with a linear
spring, a linear damper and a static offset; a wheel that spins on it; front carriers turn about a kingpin axis through
the wheel centre; a tyre with F·e = kt·δ along the road normal. `simulate.tyre`, `simulate.engine`, `simulate.road` and
`simulate.hidden` give every law. MuJoCo (extra ``sim``) is imported when a run starts, not before.
"""

from lacet.simulate.cars import CARS, Car, find_car
from lacet.simulate.drive import SimulationFailed, run
from lacet.simulate.hidden import Hidden
from lacet.simulate.kinds import KINDS
from lacet.simulate.manoeuvres import MANOEUVRES, Manoeuvre, make_manoeuvre
from lacet.simulate.measuring import IDEAL, START_NS, Sheet, Timing, exchange_run, measure
from lacet.simulate.memory import OwnLaw
from lacet.simulate.motion import CarMotion, SimulatedMotion

__all__ = [
    "CARS",
    "IDEAL",
    "KINDS",
    "MANOEUVRES",
    "START_NS",
    "Car",
    "CarMotion",
    "Hidden",
    "Manoeuvre",
    "OwnLaw",
    "Sheet",
    "SimulatedMotion",
    "SimulationFailed",
    "Timing",
    "exchange_run",
    "find_car",
    "make_manoeuvre",
    "measure",
    "run",
]
