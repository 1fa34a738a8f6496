"""Units in the spellings of instruments, files and users."""

from __future__ import annotations

import math
import subprocess
import sys

import pytest

from lacet.daq.dimension import Dimension
from lacet.daq.units import UnitFault, canonical, read_unit, to_si

DEG = math.pi / 180.0


@pytest.mark.parametrize(("texts", "si", "factor"), [
    (("m/s**2", "m/s^2", "m/s2", "m/s²", "m / s ** 2", "m/s/s", "m/sec^2", "(m/s^2)", "[m/s²]"), "m/s²", 1.0),
    (("g", "G"), "m/s²", 9.80665),
    (("N*m", "Nm", "N·m", "N.m", "N-m", "N m", "NM"), "N·m", 1.0),
    (("kNm", "kN·m", "kN*m"), "N·m", 1e3),
    (("daN",), "N", 10.0), (("kp", "kgf"), "N", 9.80665), (("lbf",), "N", 4.4482216152605),
    (("deg/s", "°/s", "degrees/s", "Deg/s", "deg/sec", "Grad/s"), "rad/s", DEG),
    (("rpm", "1/min", "U/min", "rev/min", "min^-1", "tr/min", "RPM"), "rad/s", math.pi / 30.0),
    (("km/h", "kph", "kmh", "KPH", "Km/h"), "m/s", 1 / 3.6), (("mph", "MPH"), "m/s", 0.44704),
    (("°", "deg", "Deg", "degrees", "º"), "rad", DEG), (("inch", "in"), "m", 0.0254),
    (("bar",), "N/m²", 1e5), (("psi",), "N/m²", 6894.757293168361), (("mm/V",), "m/V", 1e-3),
    (("N/deg",), "N", 1 / DEG),
])  # fmt: skip
def test_every_spelling_is_read(texts: tuple[str, ...], si: str, factor: float) -> None:
    for text in texts:
        found = read_unit(text)
        assert (found.si, found.factor) == (si, pytest.approx(factor, rel=1e-13)), text


def test_degrees_celsius_have_an_offset() -> None:
    for text in ("°C", "degC", "C"):
        assert to_si(20.0, text) == (pytest.approx(293.15), "K")


def test_a_unit_fits_its_quantity_and_no_other() -> None:
    """Hz could be turns or radians a second, a percentage is no angle; a torque per radian is a torque."""
    assert read_unit("1/min").fits("rad/s")
    assert not read_unit("Hz").fits("rad/s")
    assert not read_unit("%").fits("rad")
    assert read_unit("g").fits("m/s²")
    assert not read_unit("g").fits("kg")
    assert read_unit("bar").fits("Pa")
    assert read_unit("N·m/rad").fits("N·m")
    assert not read_unit("m").fits("rad")


@pytest.mark.parametrize("text", ["", "blorp", "m/blorp", "__import__('os')", "1/0", "mol", "x" * 5000, "m**9e9"])
def test_what_is_no_unit_is_refused(text: str) -> None:
    with pytest.raises(UnitFault):
        read_unit(text)


def test_a_refusal_names_the_nearest() -> None:
    with pytest.raises(UnitFault, match="did you mean"):
        read_unit("kn/mn")


def test_the_common_ones_need_no_library() -> None:
    """pint takes half a second to load."""
    code = (
        "import sys; from lacet.daq.units import read_unit, to_si; "
        "[read_unit(u) for u in ('m/s**2', 'm/s^2', 'deg', 'km/h', 'Nm', 'N*m', 'kN')]; print('pint' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "False"


def test_the_power_sign_of_programs_is_a_power() -> None:
    assert canonical("m/s**2") == canonical("m/s^2") == "m/s²"


def test_voltage_is_printed_as_such() -> None:
    volt = Dimension.of(1, 2, -3, -1)
    assert volt.unit == "V"
    assert (Dimension.of(length=1) / volt).unit == "m/V"
