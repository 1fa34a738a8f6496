"""Aerodynamic loads of hidden effects on the body, at zero wind."""

from __future__ import annotations

from collections.abc import Sequence

from lacet.simulate.hidden import Hidden, total_at

Vector = tuple[float, float, float]


class Air:
    """Drag, lift and side force of hidden effects; `wheelbase` and `origin_height` of the body origin [m]."""

    def __init__(self, hidden: Sequence[Hidden], wheelbase: float, origin_height: float):
        self._length = wheelbase
        self._lift = [total_at(hidden, "aero_lift", c) for c in ("fl", "rl")]
        self._drag = [(h.size, h.shape["height"] - origin_height) for h in hidden if h.effect == "aero_drag"]
        self._side = [(h.size, h.shape["x"]) for h in hidden if h.effect == "aero_side"]
        self.acts = bool(self._drag) or bool(self._side) or any(self._lift)
        """Whether there is any."""

    def load(self, forward: float, left: float) -> tuple[Vector, Vector]:
        """Force [N] and moment [N·m] about the origin, body axes, at these speeds of the origin [m/s]."""
        square = forward * forward
        force = side = moment = yaw = 0.0
        for size, height in self._drag:
            force -= size * forward * abs(forward)
            moment -= height * size * forward * abs(forward)
        for size, x in self._side:
            side -= size * forward * left
            yaw -= x * size * forward * left
        front, rear = self._lift[0] * square, self._lift[1] * square
        moment += self._length * rear
        return (force, side, front + rear), (0.0, moment, yaw)
