"""What is known of a model's parameters before any run, as equations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.model import Model


def known_beforehand(model: Model, keep: NDArray[np.int64], faults: bool = True) -> Array:
    """(k, q) equations with σ = 1 and right side 0, in the parameters kept and, unless left out, the sensor faults.

    Each parameter is within what is plausible (`Parameter.prior`), and left and right parts of one kind are alike
    (`Parameter.twin`).
    """
    parameters = [model.parameters[int(i)] for i in keep]
    names = [q.name for q in parameters]
    parameters += [q for fault in model.faults for q in fault.parameters] if faults else []
    lines = [np.diag([1.0 / q.prior for q in parameters])]
    for i, q in enumerate(parameters):
        if q.twin in names:
            line = np.zeros((1, len(parameters)))
            line[0, i], line[0, names.index(q.twin)] = 1.0 / q.twin_sigma, -1.0 / q.twin_sigma
            lines.append(line)
    return np.concatenate(lines)
