"""Errors that a user can cause by a file or an argument. A corrupt byte is none: it becomes a flagged sample."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class LacetError(Exception):
    """Base of the errors that a user can cause and correct.

    Examples
    --------
    >>> try:
    ...     lacet.open_run("no-such-run.mcap")
    ... except lacet.LacetError as error:
    ...     print(error)
    no-such-run.mcap:
      - no such file
    """


class FileFault(LacetError):
    """A file that cannot be used, with all of its faults at once.

    Parameters
    ----------
    path : the file, as the user named it.
    faults : one line per fault, each with place, cause and remedy.
    """

    def __init__(self, path: object, faults: Iterable[str]):
        self.path = str(path)
        self.faults = list(faults)
        super().__init__(f"{self.path}:\n" + "\n".join(f"  - {fault}" for fault in self.faults))


class RigError(FileFault):
    """A rig file with faults."""


class VehicleError(FileFault):
    """A vehicle file with faults."""


class DbcError(FileFault):
    """A DBC file (the layout of CAN frames) with faults, or one that a driver cannot use."""


class RunError(FileFault):
    """A recorded run that cannot be read, or not in full."""


class UsageError(LacetError):
    """An argument or a combination of arguments that cannot be carried out.

    Examples
    --------
    >>> try:
    ...     lacet.add(fitted, "anti_roll_bar.frnt")
    ... except lacet.UsageError as error:
    ...     print(error)
    there is no effect 'anti_roll_bar.frnt'; did you mean 'anti_roll_bar.front'? (lacet info --effects lists them)
    """


class NotIdentifiable(LacetError):
    """The given data determine no parameter at all; the message has the reason.

    Examples
    --------
    >>> nothing = lacet.Model.of([])
    >>> try:
    ...     lacet.fit(nothing, runs)
    ... except lacet.NotIdentifiable as error:
    ...     print(error)
    no parameter of the model acts on the rows measured in these runs
    """


class SolverError(LacetError):
    """A numerical solver found no usable solution; the message has the reason."""


def nearest(word: str, known: Iterable[str]) -> str:
    """The hint ``'; did you mean 'x'?'`` with the known word nearest to `word`, or an empty string."""
    match = difflib.get_close_matches(word, list(known), n=1)
    return f"; did you mean '{match[0]}'?" if match else ""
