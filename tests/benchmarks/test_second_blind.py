"""The fresh benchmark on the second car: what is of the mechanism, how laws along its parts are sized, its page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.fresh import running, second_page
from benchmarks.fresh.laws import drawn_parts
from benchmarks.fresh.making import SETS
from benchmarks.fresh.scoring import alarm, exact, of_mechanism, scored
from benchmarks.fresh.second import CLASSES, MECHANISM, SECOND_LAWS, class_of, suspensions
from benchmarks.fresh.sizing import force_of, travels
from lacet.identify.effects.catalogue import effect_classes
from lacet.simulate import Hidden
from lacet.simulate.linkage.hidden_laws import POSSIBLE
from tests.benchmarks.test_fresh_scores import DRAG, FRICTION, record
from tests.simulate.linkage.second_cars import drive

pytest.importorskip("mujoco")


def on_second(*args: object, **more: object) -> dict[str, object]:
    """A record of the second car."""
    return {**record(*args, **more), "mechanism": list(MECHANISM)}  # type: ignore[arg-type]


def test_what_the_mechanism_has_is_neither_wrong_nor_an_alarm() -> None:
    own = on_second("none", [], "anti_roll_bar.rear", "damper_mount.front", "spring_quadratic.fl")
    assert not alarm(own)
    assert alarm(record("none", [], "anti_roll_bar.rear"))
    assert alarm(on_second("none", [], "spring_quadratic.front", unlisted=True))
    assert not of_mechanism("axle_damping.front", own)
    wrong = on_second("single", [DRAG], "aero_drag", "axle_damping.front", "anti_roll_bar.front")
    assert scored(wrong).wrong == ("axle_damping.front",)
    assert exact(on_second("single", FRICTION, "coulomb.front", "coulomb.rear", "damper_stroke.rear"))
    tied = on_second("none", [], "spring_cubic.front", ties={"spring_cubic.front": ["spring_quadratic.front"]})
    assert not alarm(tied)


def test_laws_can_be_hidden_and_are_none_of_the_mechanism() -> None:
    families = {key.partition(".")[0] for key in MECHANISM}
    assert families <= set(effect_classes())
    assert len(SECOND_LAWS) >= 8
    for law in SECOND_LAWS:
        assert law.kind in POSSIBLE
        assert not families & set(law.families)
    draws = [drawn_parts("pair", np.random.default_rng(n), ANY, SECOND_LAWS) for n in range(40)]
    kinds = {part.hidden.effect for parts in draws for part in parts}
    assert {"coulomb", "aero_drag", "bump_stop"} <= kinds
    assert not kinds & {"anti_roll_bar", "spring_quadratic", "spring_cubic"}
    assert [class_of(n) for n in range(4)] == [*CLASSES, CLASSES[0]]


class Everywhere(dict[str, float]):
    """Any fault has this tolerance."""

    def __missing__(self, name: str) -> float:
        return 0.01


ANY = Everywhere()


def test_a_law_along_a_part_is_sized_by_its_motion_ratio() -> None:
    motion, at = drive("second", "sinus"), suspensions()
    s, rate = travels(motion)
    assert at["rl"].spring == pytest.approx(0.758, abs=1e-3)
    assert at["fl"].stiffness == pytest.approx(25078, abs=5)
    stop = force_of(Hidden("bump_stop.rear", 1e4, shape={"gap": 5e-4}), motion, at)["suspension.rr"]
    pressed = np.maximum(0.0, at["rr"].spring * s[:, 3] - 5e-4)
    np.testing.assert_allclose(stop, at["rr"].spring * 1e4 * pressed, rtol=1e-9)
    assert np.max(stop) > 1.0
    bent = force_of(Hidden("damper_digressive.front", -1e3), motion, at)["suspension.fr"]
    ratio = at["fr"].damper
    np.testing.assert_allclose(bent, -1e3 * ratio**3 * rate[:, 1] * np.abs(rate[:, 1]), rtol=1e-9)
    twice = {c: replace(one, damper=2.0 * one.damper) for c, one in at.items()}
    assert force_of(Hidden("damper_digressive.front", -1e3), motion, twice)["suspension.fr"] == pytest.approx(8 * bent)


def test_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(running, "HERE", tmp_path)
    trials = [
        on_second("none", [], "anti_roll_bar.front"),
        on_second("single", [DRAG], "aero_drag", "tyre_damping.front"),
    ]
    for number, one in enumerate(trials):
        running.append(running.results_file("test", "second"), {**one, "trial": number, "true_held": None})
    second_page.write_second_page(tmp_path / "page.md")
    text = (tmp_path / "page.md").read_text(encoding="utf-8")
    assert "2 trials, of which 0 failed" in text
    assert "| `anti_roll_bar.front` | 1 of 2 |" in text
    assert "named and not hidden: tyre_damping.front" in text
    assert "Not run." in text  # the other of the sets
    assert set(SETS) == {"development", "test"}
