"""Checks of the arguments of a chain's methods: joint states, parameters, values of symbols."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lacet.daq.errors import nearest
from lacet.identify.multibody.chain_notes import ValuesUnused
from lacet.identify.multibody.rigid_body import FRICTION, PARAMETERS
from lacet.identify.multibody.vectors import Array


def real(name: str, value: Any) -> float:
    """A value as a number. Raises ValueError that names a value which is none."""
    try:
        return float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be a number, found {value!r}") from None


def symbol_values(given: Mapping[str, Any], symbols: Collection[str] | None = None) -> dict[str, float]:
    """Values of symbols as numbers. Raises ValueError for a value that is no number or a name not in `symbols`."""
    unknown = sorted({str(name) for name in given} - set(symbols)) if symbols is not None else []
    if symbols is not None and unknown:
        raise ValueError(
            f"the table has no symbol {', '.join(unknown)}{nearest(unknown[0], symbols)} "
            "(gravity and parameters take their values where the chain is made: from_par(…, values=…))"
        )
    return {str(name): real(str(name), value) for name, value in given.items()}


def unused(values: Collection[str], symbols: Collection[str]) -> list[ValuesUnused]:
    """The note of the values that have no symbol; none where each has one."""
    spare = tuple(name for name in values if name not in symbols)
    return [ValuesUnused(spare)] if spare else []


def joint_states(n: int, fixed: bool = False, **states: ArrayLike) -> list[Array]:
    """Joint states given as (N, n), contiguous; `fixed` : whether some of the n are fixed frames.

    Raises ValueError naming the one at fault and the remedy.
    """
    out: list[Array] = []
    for name, given in states.items():
        try:
            array = np.asarray(given, float)
        except (TypeError, ValueError):
            raise ValueError(f"{name} must be numbers of shape (N, {n})") from None
        if array.ndim != 2 or array.shape[1] != n:
            one = "; one sample is q[None]" if array.ndim == 1 else ""
            raise ValueError(
                f"{name} must have the shape (N, {n}), found {array.shape}{one}"
                f"{'; fixed frames have a column too' if fixed else ''}"
            )
        if out and array.shape[0] != out[0].shape[0]:
            raise ValueError(f"{name} has {array.shape[0]} samples, {next(iter(states))} {out[0].shape[0]}")
        if not np.all(np.isfinite(array)):
            bad = np.argwhere(~np.isfinite(array))
            where = f"the first at sample {bad[0, 0]}, joint {bad[0, 1] + 1}"
            raise ValueError(f"{name} has {len(bad)} values that are not finite, {where}")
        out.append(np.ascontiguousarray(array))
    return out


def all_parameters(n: int, names: Sequence[str], given: ArrayLike | Mapping[str, float]) -> NDArray[np.float64]:
    """Parameters as (13 n,) in the order of `names`, from 10 n or 13 n of them or a mapping (missing: 0).

    Raises KeyError for an unknown name, ValueError for a wrong number of values or one that is not finite.
    """
    out = np.zeros(13 * n)
    if isinstance(given, Mapping):
        index = {name: i for i, name in enumerate(names)}
        for name, value in given.items():
            if name not in index:
                raise KeyError(f"'{name}' is no parameter of this chain{nearest(str(name), index)}")
            out[index[name]] = real(f"parameter {name}", value)
    else:
        values = np.asarray(given, float)
        if values.shape not in ((10 * n,), (13 * n,)):
            raise ValueError(
                f"{10 * n} parameters expected ({13 * n} with friction), found an array of shape {values.shape}"
            )
        out[: values.size] = values
    if not np.all(np.isfinite(out)):
        raise ValueError(f"parameter {names[int(np.flatnonzero(~np.isfinite(out))[0])]} is not finite")
    return out


def chosen(names: Sequence[str], asked: Collection[str]) -> list[str]:
    """The names in `asked`, in the order of `names`. Raises ValueError for an unknown one."""
    wanted = {asked} if isinstance(asked, str) else set(asked)
    if unknown := sorted(wanted - set(names)):
        raise ValueError(f"no parameter of this chain: {', '.join(unknown)}{nearest(unknown[0], names)}")
    return [name for name in names if name in wanted]


def absent_names(rows: Sequence[Mapping[str, Any]]) -> set[str]:
    """Names of the parameters that rows of a table declare absent. Raises ValueError for unknown kinds."""
    out: set[str] = set()
    for j, row in enumerate(rows, start=1):
        asked = row.get("absent", ())
        try:
            kinds = PARAMETERS if asked == "all" else (asked,) if isinstance(asked, str) else tuple(map(str, asked))
        except TypeError:
            raise ValueError(
                f"row {j}: absent is 'all' or a list of parameters such as 'XX', found {asked!r}"
            ) from None
        if unknown := [str(k) for k in kinds if k not in (*PARAMETERS, *FRICTION)]:
            raise ValueError(f"row {j}: absent names what is no parameter of a body: {', '.join(unknown)}")
        out |= {f"{kind}{j}" for kind in kinds}
    return out
