"""A model: a sum of effects and nothing else."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

from lacet.daq.errors import UsageError
from lacet.identify.effects.base import Effect, Parameter, SensorFault


@dataclass(frozen=True)
class Model:
    """The sum of `effects`, in this order."""

    effects: tuple[Effect, ...]

    @classmethod
    def of(cls, effects: Iterable[Effect]) -> Model:
        """A model of these effects. Raises UsageError when one is in it twice."""
        out = tuple(effects)
        keys = [effect.key for effect in out]
        for key in keys:
            if keys.count(key) > 1:
                raise UsageError(f"{key} is in the model already")
        return cls(out)

    @cached_property
    def physics(self) -> tuple[Effect, ...]:
        """The effects with columns of their own."""
        return tuple(effect for effect in self.effects if not isinstance(effect, SensorFault))

    @cached_property
    def faults(self) -> tuple[SensorFault, ...]:
        """The sensor faults in the model."""
        return tuple(effect for effect in self.effects if isinstance(effect, SensorFault))

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the physics, then of the sensor faults."""
        return tuple(p for effect in (*self.physics, *self.faults) for p in effect.parameters)

    @property
    def names(self) -> tuple[str, ...]:
        """Parameter names."""
        return tuple(p.name for p in self.parameters)

    def __contains__(self, key: str) -> bool:
        return any(effect.key == key for effect in self.effects)

    def __add__(self, effect: Effect) -> Model:
        return Model.of((*self.effects, effect))

    def without(self, key: str) -> Model:
        """The model without one effect. Raises UsageError when it is not in it."""
        if key not in self:
            raise UsageError(f"{key} is not in the model")
        return Model.of(effect for effect in self.effects if effect.key != key)
