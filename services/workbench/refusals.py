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


class Busy(Refusal):
    """Impossible while a job computes."""

    status = 409

    def __init__(self, text: str):
        super().__init__(text, busy=True)


class Needs(Refusal):
    """A job must be run first: `needs` is its name."""

    status = 409

    def __init__(self, job: str, text: str):
        super().__init__(f"{text}: start the job '{job}'", needs=job)


class TooLarge(Refusal):
    """An upload exceeds the largest size."""

    status = 413


class DiskFull(Refusal):
    """The disk is full."""

    status = 507
