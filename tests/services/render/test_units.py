"""The units in which engineers read quantities."""

import math

import pytest

from lacet.services.render.units import display_unit


@pytest.mark.parametrize(
    ("unit", "largest", "factor", "text"),
    [
        ("m", 0.04, 1e3, "mm"),
        ("m", 2.0, 1.0, "m"),
        ("m/s", 0.3, 1e3, "mm/s"),
        ("m/s", 30.0, 1.0, "m/s"),
        ("rad", 0.1, 180.0 / math.pi, "°"),
        ("rad/s²", 5.0, 180.0 / math.pi, "°/s²"),
        ("N", 1e-3, 1.0, "N"),
        ("1", 0.2, 1.0, ""),
        ("-", 0.2, 1.0, ""),
    ],
)
def test_a_quantity_is_read_in_its_usual_unit(unit, largest, factor, text):
    """Small lengths in millimetres, angles in degrees, plain numbers without unit."""
    assert display_unit(unit, largest) == (pytest.approx(factor), text)
