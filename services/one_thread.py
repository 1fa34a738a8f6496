"""Linear algebra on one thread: matrices are small, so that more threads only wait for each other."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module

from threadpoolctl import threadpool_limits


@contextmanager
def one_thread() -> Iterator[None]:
    """A context in which NumPy and SciPy use one thread for linear algebra.

    Half the processor time of several threads (measured), and other cores stay free for a recorder.
    """
    # SciPy has a library of its own, loaded with this module: a limit set before would miss it.
    import_module("scipy.linalg")
    with threadpool_limits(1):
        yield
