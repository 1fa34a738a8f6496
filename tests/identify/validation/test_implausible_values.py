"""Values that no car has, of fits to channels that are not as they are stated."""

from __future__ import annotations

from dataclasses import replace

from lacet.daq.channels import CORNERS
from lacet.daq.run import Run
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.wls import Fit
from lacet.identify.validation.implausible_values import ImplausibleValue, implausible_values
from lacet.identify.validation.parameter_estimates import estimates
from lacet.services.render.implausible_values import implausible_result, implausible_text
from tests.identify import cars
from tests.identify.regression.test_no_wheel_loads import CAR, fitted_to, found, moving, with_mass


def told_of(fitted: Fit) -> dict[str, ImplausibleValue]:
    """The implausible values of a fit, by parameter."""
    return {one.name: one for one in implausible_values(fitted, estimates(fitted, None, fitted.runs))}


def with_factor(run: Run, factor: float, channels: list[str]) -> Run:
    """A run of which some channels are as many times as large."""
    return run.with_values({name: factor * run.signals[name].values for name in channels})


def test_a_complete_model_of_right_channels_has_none() -> None:
    assert told_of(found()) == {}
    assert implausible_text({"implausible": implausible_result([])}) == ""
    assert implausible_text({}) == "", "of a study that was made before"


def test_one_travel_with_the_other_sign_makes_its_spring_and_damper_negative() -> None:
    """Without wheel loads no row says so."""
    fitted = fitted_to([with_factor(run, -1.0, ["laser.fl.hub"]) for run in moving()], with_mass())
    told = told_of(fitted)
    assert {"spring.fl.k", "damper.fl.c"} <= set(told)
    assert not {
        f"{law}.{corner}.{k}" for law, k in (("spring", "k"), ("damper", "c")) for corner in ("rl", "rr")
    } & set(told)
    spring = told["spring.fl.k"]
    assert spring.value + spring.half < spring.low == 0.0
    says = implausible_text({"implausible": implausible_result(list(told.values()))})
    assert "spring.fl.k (-" in says
    assert "the other sign" in says


def test_travels_of_another_unit_make_springs_too_stiff() -> None:
    """Inches that were taken for millimetres are told as far as such springs are on no car."""
    names = [f"laser.{corner}.hub" for corner in CORNERS]
    fitted = fitted_to([with_factor(run, 1.0 / 25.4, names) for run in moving()], with_mass())
    told = told_of(fitted)
    assert {f"spring.{corner}.k" for corner in CORNERS} <= set(told)
    assert all(one.value - one.half > one.high for name, one in told.items() if name.startswith("spring"))
    says = implausible_text({"implausible": implausible_result(list(told.values()))})
    assert f" and {len(told) - 4} more have values" in says


def test_a_negative_moment_of_inertia_is_told_though_it_stands_for_a_group() -> None:
    """All members of the group are moments of inertia: their sum is positive, as none with a first moment need be."""
    fitted = found()
    clean = estimates(fitted, None, fitted.runs)
    for name, told in (("XX6", ["XX6"]), ("MX6", [])):
        (head,) = (e for e in clean if e.name == name)
        assert "+" in head.group or name != "XX6"
        wrong = [replace(e, value=-abs(e.value) - 2.0 * e.half_sheet) if e is head else e for e in clean]
        assert [one.name for one in implausible_values(fitted, wrong)] == told


def test_half_of_a_beam_reaches_far_inboard_of_its_wheel() -> None:
    """First moments of the carriers are judged on axles alone whose wheels do not move together."""
    fitted = found()
    far = [
        replace(e, value=-13.0, half=1.0, half_sheet=1.0, why=None) if e.name in ("MY11", "MY29") else e
        for e in estimates(fitted, None, fitted.runs)
    ]
    assert [one.name for one in implausible_values(fitted, far)] == ["MY29", "MY11"]
    (run, *others), jointed = fitted.runs, cars.with_joints(CAR)
    corners = CAR.corners | {corner: jointed.corners[corner] for corner in ("rl", "rr")}
    of_beam = PreparedRun(replace(run.recording, vehicle=replace(CAR, corners=corners)))
    assert [one.name for one in implausible_values(replace(fitted, runs=(of_beam, *others)), far)] == ["MY29"]
