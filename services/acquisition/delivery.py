"""Delivery of recorded runs: which workers have a run, in a file beside its log, and offers of those that none has."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from lacet.daq.bus.link import Link
from lacet.daq.bus.publisher import OTHERS, RunPublisher
from lacet.daq.bus.spool import Spool
from lacet.daq.errors import LacetError
from lacet.daq.formats.log import LogReader
from lacet.daq.formats.run_files import files_of_run
from lacet.services.acquisition.log_medium import RESERVE_BYTES
from lacet.services.acquisition.offer import car_of, offer
from lacet.services.acquisition.resume import is_being_recorded

FORMAT = "lacet-delivery 1"
SHARE = 0.1
"""Part of a processor that reading earlier runs may take while another run is recorded, which needs a third of one."""
QUIET = 60.0
"""Time without a request, after the first one, after which the next run is offered [s]: nobody takes this one."""
NICE = 10
"""Priority of the thread that reads earlier runs, as of `nice`."""
_TURN = 0.2  # s; how soon the thread sees that the recording is over


def delivery_file(log: Path) -> Path:
    """The file beside a log that says who has its run."""
    return log.with_suffix(".delivery.json")


def note_delivery(log: Path, run_id: str, workers: Iterable[str] = ()) -> None:
    """Write which workers have the run of a log; where the disk refuses, the run is only offered once more."""
    file, part = delivery_file(log), delivery_file(log).with_suffix(".part")
    text = json.dumps({"format": FORMAT, "run_id": run_id, "workers": sorted(workers)}) + "\n"
    with contextlib.suppress(OSError):
        part.write_text(text, encoding="utf-8")
        os.replace(part, file)


def undelivered(folder: Path, but: str = "") -> list[Path]:
    """Logs of a folder that were offered on the bus and that no worker has, the oldest first.

    `but` : id of a run that is left out. A log that is being recorded is left out, and one without a file that says
    that it was ever offered: recorded without the bus, decoded, imported.
    """
    found: list[tuple[int, Path]] = []
    for file in folder.glob("*.delivery.json"):
        log = file.with_name(file.name.removesuffix(".delivery.json") + ".mcap")
        with contextlib.suppress(OSError, ValueError, AttributeError):
            noted = json.loads(file.read_text(encoding="utf-8"))
            wanted = noted.get("format") == FORMAT and not noted.get("workers") and noted.get("run_id") != but
            if wanted and not any(map(is_being_recorded, files_of_run(log).values())):
                found.append((log.stat().st_mtime_ns, log))
    return [log for _, log in sorted(found)]


class EarlierRuns:
    """Offers of the undelivered runs of a folder while another is recorded, one after the other, in a thread.

    Parameters
    ----------
    folder : of the logs.
    link : the recorder's link to the bus.
    car : the car's name in keys; None for that of each run's rig.
    but : id of the run that is recorded.
    notify : called with plain sentences for the user.
    """

    def __init__(self, folder: Path, link: Link, car: str | None, but: str, notify: Callable[[str], None]):
        self._folder, self._link, self._car, self._but, self._notify = folder, link, car, but, notify
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="earlier-runs", daemon=True)

    def __enter__(self) -> EarlierRuns:
        self._thread.start()
        return self

    def __exit__(self, *exception: Any) -> None:
        self._stop.set()
        self._thread.join(10.0)

    def _run(self) -> None:
        with contextlib.suppress(OSError, AttributeError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE)
        for log in undelivered(self._folder, self._but):
            if self._stop.is_set():
                return
            try:
                self._offer(LogReader(log))
            except (LacetError, OSError) as error:
                self._notify(f"an earlier run cannot be offered: {error}")

    def _offer(self, log: LogReader) -> None:
        size = sum(file.stat().st_size for file in log.files.values())
        if shutil.disk_usage(self._folder).free < 2 * RESERVE_BYTES + size:
            self._notify(
                f"{log.path} is not offered while recording, for want of room; later: lacet publish {log.path}"
            )
            return
        spool = Spool(self._folder)
        publisher: RunPublisher | None = None
        try:
            car = self._car or car_of(log)
            publisher = offer(self._link.session, car, log, spool, self._notify, self._pace())
            self._link.add(publisher)
            self._notify(f"earlier run {log.start.run_id}: offered, since no worker has it yet")
            begun = publisher.last_request
            while not self._stop.wait(_TURN):
                if publisher.acknowledged and time.monotonic() - publisher.last_request > OTHERS:
                    note_delivery(log.path, log.start.run_id, publisher.acknowledged)
                    self._notify(f"earlier run {log.start.run_id}: worker {', '.join(publisher.acknowledged)} has it")
                    return
                asked = publisher.last_request
                if asked > begun and time.monotonic() - asked > QUIET:
                    self._notify(f"earlier run {log.start.run_id}: no worker has taken it")
                    return
        except _Over:
            return
        finally:
            if publisher is not None:
                self._link.remove(publisher)
                publisher.close()
            spool.close()

    def _pace(self) -> Callable[[], None]:
        """What is called after each block that is read: it rests, so that the recording is not disturbed."""
        worked = time.thread_time()

        def rest() -> None:
            nonlocal worked
            if self._stop.is_set():
                raise _Over
            if (busy := time.thread_time() - worked) > 0.01:
                self._stop.wait(busy * (1.0 / SHARE - 1.0))
                worked = time.thread_time()

        return rest


class _Over(Exception):
    """The recording has ended."""
