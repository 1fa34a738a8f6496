"""The pages on fewer instruments and on benches list every assumption with its default and tolerance."""

from __future__ import annotations

import re

from lacet.daq.assumptions import ASSUMABLE
from lacet.daq.table_tolerances import TABLE_TOLERANCES
from tests.support.places import HOME


def test_the_table_of_assumptions_is_the_code_s() -> None:
    """Keys, defaults, tolerances and units."""
    page = (HOME / "docs" / "fewer-instruments.md").read_text(encoding="utf-8")
    known = {key: entry for key, entry in ASSUMABLE.items() if key not in TABLE_TOLERANCES}
    rows = re.findall(r"^\| `(\w+)` \| ([^|]+) \| ([^|]+) \| ([^|]+) \| (car|axle|corner) \|", page, re.MULTILINE)
    assert {key: (float(tolerance), unit.strip()) for key, _, tolerance, unit, _ in rows} == {
        key: (entry.tolerance, entry.unit) for key, entry in known.items()
    }
    numbers = {key: float(value) for key, value, *_ in rows if re.fullmatch(r"[\d.e-]+", value.strip())}
    assert numbers == {k: entry.value for k, entry in known.items() if entry.value is not None}


def test_the_tolerances_of_tables_are_the_code_s() -> None:
    """Of each key the columns of its curves, of a corner and of an axle."""
    page = (HOME / "docs" / "bench.md").read_text(encoding="utf-8")
    found: dict[str, tuple[float, str]] = {}
    for key, unit, *cells in re.findall(r"^\| `(table_\w+)` \| (\S+)" + r" \| ?([\d.]*)" * 4, page, re.MULTILINE):
        for suffixes, cell in zip(
            (("", "_other"), ("_rack",), ("_axle", "_other_axle"), ("_rack_axle",)), cells, strict=True
        ):
            found |= {f"{key}{suffix}": (float(cell), unit) for suffix in suffixes if cell}
    tolerances = {key: (tolerance, unit) for key, (unit, _, tolerance, *_) in TABLE_TOLERANCES.items()}
    assert {key: one for key, one in found.items() if "compliance_other" not in key} == tolerances
