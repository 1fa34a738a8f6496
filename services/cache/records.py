"""Values as a tree of plain data beside arrays, and back; no code is stored.

Data classes and enumerations of lacet, arrays, tuples, lists, mappings, sets, texts, bytes, numbers and None are
understood. What starts with an underscore in a data class is a cache of its own and is left out.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from lacet.daq.errors import LacetError
from lacet.identify.car.rows import Row

_KIND = "$"
"""Key of a node that is no plain mapping: its kind."""


class RecordError(ValueError):
    """A value that cannot be stored, or a record that is not one."""


@dataclass(frozen=True)
class Record:
    """A value in storable form: `tree` is JSON data, in which arrays are numbers of places in `arrays`."""

    tree: Any
    arrays: Sequence[NDArray[Any]]


def to_record(value: object) -> Record:
    """A value in storable form. Raises RecordError for what is not understood."""
    arrays: list[NDArray[Any]] = []
    return Record(_encoded(value, arrays), arrays)


def from_record(record: Record) -> Any:
    """The value of a record. Raises RecordError when it is damaged, or of classes that lacet has no more."""
    try:
        return _decoded(record.tree, record.arrays)
    except RecordError:
        raise
    except (LacetError, KeyError, IndexError, TypeError, ValueError, AttributeError, ImportError) as cause:
        raise RecordError(f"{type(cause).__name__}: {cause}") from None


def _encoded(value: object, arrays: list[NDArray[Any]]) -> Any:
    if isinstance(value, Row):
        return {_KIND: "row", "text": str(value)}
    if isinstance(value, Enum):
        return {_KIND: "enum", "class": _name(type(value)), "name": value.name}
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, bytes):
        arrays.append(np.frombuffer(value, np.uint8))
        return {_KIND: "bytes", "place": len(arrays) - 1}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        if value.dtype.hasobject:
            raise RecordError("an array of objects cannot be stored")
        arrays.append(cast(NDArray[Any], value))
        return {_KIND: "array", "place": len(arrays) - 1}
    if is_dataclass(value) and not isinstance(value, type):
        found = {f.name: getattr(value, f.name) for f in fields(value) if f.init and not f.name.startswith("_")}
        return {
            _KIND: "data",
            "class": _name(type(value)),
            "fields": {k: _encoded(v, arrays) for k, v in found.items()},
        }
    if isinstance(value, Mapping):
        items = cast(Mapping[Any, Any], value).items()
        return {_KIND: "map", "items": [[_encoded(k, arrays), _encoded(v, arrays)] for k, v in items]}
    if isinstance(value, tuple | list | AbstractSet):
        kind = "tuple" if isinstance(value, tuple) else "list" if isinstance(value, list) else "set"
        return {_KIND: kind, "items": [_encoded(one, arrays) for one in cast(Sequence[Any], value)]}
    raise RecordError(f"{type(value).__name__} cannot be stored")


def _decoded(node: Any, arrays: Sequence[NDArray[Any]]) -> Any:
    if not isinstance(node, dict):
        return node
    node = cast(dict[str, Any], node)
    match node[_KIND]:
        case "row":
            return Row.parse(node["text"])
        case "enum":
            return _class(node["class"], Enum)[node["name"]]
        case "array":
            return arrays[node["place"]]
        case "bytes":
            return arrays[node["place"]].tobytes()
        case "data":
            return _class(node["class"])(**{k: _decoded(v, arrays) for k, v in node["fields"].items()})
        case "map":
            return {_decoded(k, arrays): _decoded(v, arrays) for k, v in node["items"]}
        case "tuple" | "list" | "set" as kind:
            return {"tuple": tuple, "list": list, "set": frozenset}[kind](
                _decoded(one, arrays) for one in node["items"]
            )
        case kind:
            raise RecordError(f"no kind of value: {kind!r}")


def _name(cls: type) -> str:
    if not cls.__module__.startswith("lacet."):
        raise RecordError(f"{cls.__module__}.{cls.__qualname__} is no class of lacet")
    return f"{cls.__module__}:{cls.__qualname__}"


def _class(name: str, base: type | None = None) -> Any:
    """A data class or enumeration of lacet by name; nothing else is imported or called."""
    module, _, inside = name.partition(":")
    if not module.startswith("lacet.") or not inside.isidentifier():
        raise RecordError(f"{name} is no class of lacet")
    cls: Any = getattr(importlib.import_module(module), inside)
    if (
        not isinstance(cls, type)
        or cls.__module__ != module
        or not (issubclass(cls, base) if base else is_dataclass(cls))
    ):
        raise RecordError(f"{name} is no data class")
    return cls
