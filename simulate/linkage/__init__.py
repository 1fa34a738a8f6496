"""Second simulated car, whose wheels hang on linkages: what lacet's model takes for a slide is here a mechanism.

`front`, `rear` : the suspensions as parts and elements (`parts`); `cars` : the car and its variants; `mechanism` : its
MuJoCo model in equilibrium at the design position; `elements` : forces of springs, dampers, bushings; `loops` : the
rigid variant; `engine` : it drives what the first car drives.
"""

from lacet.simulate.linkage.cars import SECOND_CARS, SecondCar

__all__ = ["SECOND_CARS", "SecondCar"]
