"""MATLAB: results of a fit as a ``.mat`` file (version 5) of structs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lacet.services.exports.tables import Table, errors_table, ranking_table, values_table

LONGEST = 63
"""Length of the longest name that MATLAB takes."""


def write_mat(path: Path, result: Mapping[str, Any], diagnosis: Mapping[str, Any] | None, title: str) -> None:
    """Write the results: ``lacet.p`` has one field a value (``p.spring_fl_k.value``), the rest are tables by column.

    A column of text is a cell array, one of numbers a column vector with NaN for what does not exist.
    """
    import scipy

    values = values_table(result)
    at = {name: k for k, name in enumerate(values.columns)}
    single: dict[str, Any] = {}
    for row in values.rows:
        if row[at["identified"]]:
            field = valid_name(row[at["name"]], single)
            single[field] = {
                key: "" if row[at[key]] is None else row[at[key]]
                for key in ("name", "value", "unit", "low95", "high95", "half95_sheet", "half95")
            }
    content: dict[str, Any] = {"about": title, "units": "SI unless a unit column says otherwise", "p": single}
    content["values"], content["errors"] = _columns(values), _columns(errors_table(result))
    if diagnosis is not None:
        content["ranking"] = _columns(ranking_table(diagnosis))
    scipy.io.savemat(path, {"lacet": content}, appendmat=False, long_field_names=True, oned_as="column")


def valid_name(name: str, taken: Mapping[str, Any]) -> str:
    """A name as MATLAB takes it, ``spring.fl.k`` as ``spring_fl_k``; other than all `taken`."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    plain = (plain if plain[:1].isalpha() else f"x{plain}")[:LONGEST]
    found, count = plain, 1
    while found in taken:
        count += 1
        found = f"{plain[: LONGEST - 4]}_{count}"
    return found


def _columns(table: Table) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for k, (name, kind) in enumerate(table.columns.items()):
        column = [row[k] for row in table.rows]
        if kind is str:
            out[name] = np.array([x or "" for x in column], object)
        elif kind is bool:
            out[name] = np.array(column, bool)
        else:
            out[name] = np.array([np.nan if x is None else x for x in column], float)
    return out
