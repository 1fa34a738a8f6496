"""What the server cannot do now, with the status it answers with."""

from __future__ import annotations

from lacet.daq.errors import LacetError


class Refusal(LacetError):
    """A question that cannot be answered; `status` is the answer's HTTP status, `extra` what else it says."""

    status = 400

    def __init__(self, text: str, **extra: object):
        self.extra = extra
        super().__init__(text)


class NotThere(Refusal):
    """Nothing of that name."""

    status = 404


class InTheWay(Refusal):
    """Something is there already, or another writer was quicker."""

    status = 409


class Busy(Refusal):
    """Not while a job computes."""

    status = 409

    def __init__(self, text: str):
        super().__init__(text, busy=True)


class Needs(Refusal):
    """A job must be done first: `needs` is its name."""

    status = 409

    def __init__(self, job: str, text: str):
        super().__init__(f"{text}: start the job '{job}'", needs=job)


class TooLarge(Refusal):
    """More bytes than an upload may have."""

    status = 413


class DiskFull(Refusal):
    """No room left on the disk."""

    status = 507
