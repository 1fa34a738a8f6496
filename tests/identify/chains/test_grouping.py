"""Grouped parameters give the torques that all parameters give, with the factors returned and with those printed."""

from __future__ import annotations

import re

import numpy as np
import pytest

from lacet.daq.errors import NotIdentifiable
from lacet.daq.expressions.expression import Expression
from lacet.identify.chains import effects as laws
from lacet.identify.chains.model import ChainModel, effect_columns, standard_effects
from lacet.identify.multibody.chain import Chain
from lacet.services.library.chains import identify_chain
from tests.identify.chains.robots import URDF

GRAVITIES = (-9.81, -3.7, -1.0, 0.0)


def scara(gravity: float, size: float = 1.0) -> Chain:
    """Two revolute joints, and a vertical slide under them."""
    return Chain.from_table(
        [{"j": 1}, {"j": 2, "ant": 1, "d": 0.3 * size},
         {"j": 3, "ant": 2, "d": 0.25 * size, "alpha": "pi", "sigma": 1}],
        gravity=(0, 0, gravity),
    )  # fmt: skip


def following(multiplier: float) -> Chain:
    """A robot whose last joint slides as the second turns [m/rad]."""
    text = URDF.replace('name="j3" type="revolute"', 'name="j3" type="prismatic"')
    mimic = f'<axis xyz="0 1 0"/><mimic joint="j2" multiplier="{multiplier}" offset="0.1"/>'
    return Chain.from_urdf(text.replace('<axis xyz="0 1 0"/>', mimic))


def regressor(model: ChainModel, seed: int) -> np.ndarray:
    """(N, f, p) torques per unit of every parameter at random states."""
    chain, rng = model.chain, np.random.default_rng(seed)
    free = rng.uniform(-1.5, 1.5, (3, 40, len(chain.coupling.free)))
    W = chain.coupling.rows(chain.regressor(*chain.coupling.states(*free)))
    load = rng.uniform(0.5, 2.0, free.shape[1:])
    return np.concatenate([W, *(effect_columns(chain, effect, free, load) for effect in model.effects)], axis=2)


def printed(text: str, values: dict[str, float]) -> float:
    """Value of a grouping as it is printed."""
    return Expression.parse(re.sub(r"(\d) (?=[A-Z])", r"\1*", text)).value(values)


MODELS = {
    **{f"slide along gravity {g}": ChainModel.of(scara(g)) for g in GRAVITIES},
    "of millimetres": ChainModel.of(scara(-9.81, 1e-3)),
    "of a hundred metres": ChainModel.of(scara(-9.81, 100.0)),
    "asymmetric friction and a spring": ChainModel.of(
        scara(-3.7), [*standard_effects(scara(-3.7)), laws.AsymmetricCoulomb(3), laws.JointSpring(3)]
    ),
    "a slide that follows": ChainModel.of(following(0.3)),
}


@pytest.mark.parametrize("name", MODELS)
def test_grouped_parameters_give_the_torques_of_all(name: str):
    """Regressor × parameters = its base columns × grouped parameters, for random parameters and states."""
    model = MODELS[name]
    base, rng = model.base, np.random.default_rng(2)
    W, X = regressor(model, 3), rng.normal(size=len(model.names))
    tau = W @ X
    grouped = base.grouping() @ X
    np.testing.assert_allclose(W[:, :, base.independent] @ grouped, tau, atol=1e-9 * np.max(np.abs(tau)))
    values = dict(zip(model.names, X, strict=True))
    told = np.array([printed(base.describe(i, 0.0), values) for i in range(base.rank)])
    assert np.all(np.abs(told - grouped) <= 1e-5 * np.abs(base.grouping()) @ np.abs(X))  # printed with six digits


@pytest.mark.parametrize("gravity", GRAVITIES[:3])
def test_an_offset_beside_weight_is_grouped_by_gravity(gravity: float):
    """A slide's mass, rotor and constant force: what is printed and what may be asked for hold 1 ÷ gravity."""
    chain = scara(gravity)
    t = np.arange(0.0, 10.0, 0.002)
    w = np.array([1.3, 1.9, 2.7])
    q, rate = np.array([1.0, 1.0, 0.1]) * np.sin(np.outer(t, w)), np.array([1.0, 1.0, 0.1]) * w * np.cos(np.outer(t, w))
    tau = chain.inverse_dynamics(q, rate, -(w**2) * q, {"ZZ1": 0.4, "ZZ2": 0.2, "M3": 2.0, "IA3": 3.0, "FV3": 20.0})
    found = identify_chain(chain, q, tau + np.array([0.0, 0.0, 10.0]), rate=500)
    per_force = 1.0 / abs(gravity)
    one = next(one for one in found.parameters if one.name == "M3")
    assert one.group == f"M3 - {per_force:.6g} OFF3".replace(" 1 ", " ")
    for text in (f"M3 - {per_force!r}*OFF3", f"M3 - {per_force:.6g}*OFF3"):
        assert found.combination(text).value == pytest.approx(2.0 - 10.0 * per_force, abs=0.01)
    with pytest.raises(NotIdentifiable, match="OFF3 would have to be in it with other factors"):
        found.combination("M3 - 0.5*OFF3")


def test_a_factor_may_be_asked_for_as_it_is_printed():
    """Six digits of a factor above 10 are enough."""
    length = 3.51364189
    chain = Chain.from_table([{"j": 1}, {"j": 2, "ant": 1, "d": length}], gravity=(0, 0, -9.81))
    t = np.arange(0.0, 10.0, 0.002)
    w = np.array([1.3, 1.9])
    q, rate = np.sin(np.outer(t, w)), w * np.cos(np.outer(t, w))
    tau = chain.inverse_dynamics(q, rate, -(w**2) * q, {"ZZ1": 3.0, "ZZ2": 0.2, "M2": 2.0, "MX2": 0.3})
    found = identify_chain(chain, q, tau, rate=500)
    group = next(one.group for one in found.parameters if one.name == "ZZ1")
    asked = re.sub(r"(\d) (?=[A-Z])", r"\1*", group)
    assert "12.3457*M2" in asked
    assert found.value(asked) == pytest.approx(3.0 + 2.0 * length**2, rel=1e-3)
