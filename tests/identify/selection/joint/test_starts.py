"""Searches that begin with another effect, where the first one leaves something that its set does not explain."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest

from lacet.identify.effects.base import Effect
from lacet.identify.progress import silent
from lacet.identify.properties.known_scale import KnownScale
from lacet.identify.selection.diagnose import _of_another_start
from lacet.identify.selection.joint.refits import Joint
from lacet.identify.selection.rest import Rest
from tests.identify.exact_car import KNOWN

PLACE = "lacet.identify.selection.diagnose"
FIRST, RIGHT = KNOWN["spring_quadratic.rear"], KNOWN["anti_roll_bar.rear"]


@pytest.mark.parametrize(
    ("scale", "unlisted", "searched"),
    [
        (KnownScale(("sprung_mass",), 0.01, related=False), ("body.roll",), [FIRST.key, RIGHT.key]),
        (KnownScale(("sprung_mass",), 0.01, related=False), (), []),
        (KnownScale(("sprung_mass",), 0.01, related=True), ("body.roll",), []),
        (None, ("body.roll",), []),
    ],
    ids=["weak", "nothing unlisted", "strong", "wheel loads"],
)
def test_beside_a_weak_scale_others_begin_until_one_leaves_nothing_unlisted(
    scale: KnownScale | None, unlisted: tuple[str, ...], searched: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[str] = []

    def rest(names: tuple[str, ...]) -> Rest:
        return cast("Rest", SimpleNamespace(unlisted=names, sheet=SimpleNamespace(tolerance_exceeded=False)))

    def started_with(joint: Joint, effect: Effect, *_: object) -> Joint:
        begun.append(effect.key)
        return cast("Joint", SimpleNamespace(effects=(effect,), base=joint.base))

    def settled(joint: Joint, *_: object) -> tuple[Joint, Rest]:
        return joint, rest(() if joint.effects == (RIGHT,) else unlisted)

    monkeypatch.setattr(f"{PLACE}.starts", lambda _: [FIRST, RIGHT])
    monkeypatch.setattr(f"{PLACE}.started_with", started_with)
    monkeypatch.setattr(f"{PLACE}._settled", settled)
    runs = SimpleNamespace(scale=lambda: scale)
    tests = SimpleNamespace(linearisation=SimpleNamespace(runs=runs))
    first = cast("Joint", SimpleNamespace(base=object(), effects=(), first=tests))
    joint, remains = _of_another_start(first, rest(unlisted), 0, silent)
    assert begun == searched
    assert joint.effects == ((RIGHT,) if searched else ())
    assert remains.unlisted == (() if searched else unlisted)
