"""A model, the sum of physical effects, and the prior information on its parameters."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lacet.daq.errors import UsageError
from lacet.identify.effects.base import Effect, Parameter, PhysicalEffect, SensorFault
from lacet.identify.multibody.vectors import Array


@dataclass(frozen=True, repr=False)
class Model:
    """Model of the car and its instruments: the sum of `effects`, in this order.

    Examples
    --------
    >>> model = lacet.base_model(runs) + lacet.catalogue(runs)["anti_roll_bar.front"]
    >>> model
    Model(29 effects of the base model + anti_roll_bar.front)
    >>> model.without("anti_roll_bar.front") == lacet.base_model(runs)
    True
    """

    effects: tuple[Effect, ...]

    @classmethod
    def of(cls, effects: Iterable[Effect]) -> Model:
        """The model of these effects. Raises UsageError for an effect that is given twice."""
        out = tuple(effects)
        keys = [effect.key for effect in out]
        for key in keys:
            if keys.count(key) > 1:
                raise UsageError(f"{key} is in the model already")
        return cls(out)

    @cached_property
    def physics(self) -> tuple[PhysicalEffect, ...]:
        """The physical effects of the model, without sensor faults."""
        return tuple(one for effect in self.effects if (one := effect.as_physics) is not None)

    @cached_property
    def faults(self) -> tuple[SensorFault, ...]:
        """The sensor faults in the model."""
        return tuple(one for effect in self.effects if (one := effect.as_fault) is not None)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the physics, then of the sensor faults."""
        return tuple(p for effect in (*self.physics, *self.faults) for p in effect.parameters)

    @cached_property
    def physics_size(self) -> int:
        """Number of the parameters of the physical effects; the parameters of the sensor faults follow them."""
        return sum(len(effect.parameters) for effect in self.physics)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Parameter names."""
        return tuple(p.name for p in self.parameters)

    def __repr__(self) -> str:
        added = [effect.key for effect in self.effects if not effect.base]
        base = f"{len(self.effects) - len(added)} effects of the base model"
        return f"Model({base}{''.join(f' + {key}' for key in added[:20])}{' + …' if len(added) > 20 else ''})"

    def __contains__(self, key: str) -> bool:
        return any(effect.key == key for effect in self.effects)

    def __add__(self, effect: Effect) -> Model:
        return Model.of((*self.effects, effect))

    def without(self, key: str) -> Model:
        """The model without one effect. Raises UsageError when it is not in it."""
        if key not in self:
            raise UsageError(f"{key} is not in the model")
        return Model.of(effect for effect in self.effects if effect.key != key)


def known_beforehand(model: Model, keep: NDArray[np.int64], faults: bool = True) -> Array:
    """Prior information as (k, q) equations with σ = 1 and right side 0, in the parameters `keep` and sensor faults.

    Two kinds: each parameter is of plausible size (`Parameter.prior`), and left and right parts of one kind are nearly
    equal (`Parameter.twin`). Without `faults` the columns of the sensor faults are absent.
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
