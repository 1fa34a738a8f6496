"""The pages on fewer instruments and on benches list every assumption with its default."""

from __future__ import annotations

import re

from lacet.daq.assumptions import ASSUMABLE
from tests.support.places import HOME


def test_the_table_of_assumptions_is_the_code_s() -> None:
    """Keys, defaults, tolerances and units."""
    pages = (HOME / "docs" / name for name in ("fewer-instruments.md", "bench.md"))
    page = "\n".join(one.read_text(encoding="utf-8") for one in pages)
    rows = re.findall(r"^\| `(\w+)` \| ([^|]+) \| ([^|]+) \| ([^|]+) \| (car|axle|corner) \|", page, re.MULTILINE)
    assert {key: (float(tolerance), unit.strip()) for key, _, tolerance, unit, _ in rows} == {
        key: (entry.tolerance, entry.unit) for key, entry in ASSUMABLE.items()
    }
    numbers = {key: float(value) for key, value, *_ in rows if re.fullmatch(r"[\d.e-]+", value.strip())}
    assert numbers == {k: entry.value for k, entry in ASSUMABLE.items() if entry.value is not None}
