"""Refusals of the server, with the HTTP status of each."""

from __future__ import annotations

from lacet.daq.errors import LacetError


class Refusal(LacetError):
    """A request that cannot be answered; `status` : the HTTP status, `extra` : further entries of the answer."""

    status = 400

    def __init__(self, text: str, **extra: object):
        self.extra = extra
        super().__init__(text)


class NotThere(Refusal):
    """No resource has that name."""

    status = 404


class InTheWay(Refusal):
    """The resource exists already, or another writer has changed it."""

    status = 409


class NotYet(Refusal):
    """It can be had later; no error, which browsers would report to the user's console."""

    status = 202


class Busy(NotYet):
    """Impossible while a job computes."""

    def __init__(self, text: str):
        super().__init__(text, busy=True)


class Needs(NotYet):
    """A job must be run first: `needs` is its name."""

    def __init__(self, job: str, text: str):
        super().__init__(f"{text}: start the job '{job}'", needs=job)


class NotWritten(Needs):
    """A file that a job must write first: a browser must not save the answer in its place."""

    status = 409


class TooLarge(Refusal):
    """An upload exceeds the largest size."""

    status = 413


class DiskFull(Refusal):
    """The disk is full."""

    status = 507
