"""Functions compiled to machine code by Numba, which is loaded when the first of them is wanted.

The one place that knows Numba: it has no types of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, ParamSpec

P = ParamSpec("P")


@cache
def compiled(function: Callable[P, None], signature: str) -> Callable[P, None]:
    """The function as machine code that runs without Python's lock.

    Parameters
    ----------
    function : on numbers and arrays alone, in the part of Python that Numba knows.
    signature : Numba's types of its arguments; there is no other version for other types.

    The code is kept in the ``__pycache__`` beside the function's file, in the user's cache folder where that cannot be
    written, or in `NUMBA_CACHE_DIR`; where none can be written it is compiled anew in each process.
    """
    import numba

    # Contraction to fused multiply-adds is the only liberty taken with the order of the arithmetic.
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}}
    njit: Any = numba.njit
    try:
        return njit(signature, cache=True, **options)(function)
    except (RuntimeError, OSError):  # Numba's answer to folders that cannot be written, and to full disks
        return njit(signature, **options)(function)
