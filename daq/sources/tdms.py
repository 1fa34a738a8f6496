"""TDMS files of LabVIEW through npTDMS: waveforms with their own increment, or groups with a time channel."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from lacet.daq.parts import from_part
from lacet.daq.sources.columns import find_time, is_time_name, with_unit
from lacet.daq.sources.shares import SharedSource, Stored
from lacet.daq.sources.source import Array, Listed, Reading, fault, read_by_library

_HEAD = 500


class TdmsSource(SharedSource):
    """The channels of a TDMS file as ``Group.Channel``."""

    def __init__(self, path: Path, reading: Reading):
        super().__init__(path)
        with from_part("logs"):
            from nptdms import TdmsFile

        without: list[str] = []
        with read_by_library(path, "as TDMS"):
            self._file = TdmsFile.open(path)
            for group in self._file.groups():
                channels = [c for c in group.channels() if len(c) and c.dtype is not None and c.dtype.kind in "iufbM"]
                key, base = self._time_channel(group.name, channels, reading)
                for channel in channels:
                    if base is not None and channel.name == key:
                        continue
                    name, unit = with_unit(channel.name)
                    unit = str(channel.properties.get("unit_string", "") or unit).strip()
                    step = float(channel.properties.get("wf_increment", 0.0) or 0.0)
                    own: Stored | None = base if base is not None and base.count == len(channel) else None
                    place = f"{group.name}/{key}"
                    if step > 0.0:
                        begin = float(channel.properties.get("wf_start_offset", 0.0) or 0.0) + self._begun(channel)
                        own, place = _waveform(len(channel), begin, step), f"waveform {step} {begin} {len(channel)}"
                    elif reading.rate:
                        own, place = Stored(len(channel), lambda a, b: np.arange(a, b) / reading.rate), "rate"
                    if own is None:
                        without.append(f"{group.name}.{name}")
                        continue
                    full = f"{group.name}.{name}"
                    if full not in self.listed:
                        at = Listed(full, unit, len(channel), f"group {group.name}")
                        self.add(at, Stored(len(channel), _reader(channel)), place, own)
        if without:
            self.notes.append(f"without wf_increment or a time channel in the group: {', '.join(without[:6])}")
        if not self.listed:
            remedy = 'say the rate in the map, [read] rate = 100, or the time channel, [read] time = "NAME"'
            raise fault(path, *(self.notes or ["it holds no numbers"]), remedy)

    def _time_channel(self, group: str, channels: list[Any], reading: Reading) -> tuple[str, Stored | None]:
        asked = reading.time.rpartition(".")[2] if reading.time else ""
        named = [c for c in channels if c.name == asked] if asked else [c for c in channels if is_time_name(c.name)]
        for channel in named:
            units = {channel.name: str(channel.properties.get("unit_string", "") or with_unit(channel.name)[1])}
            stamps = channel.dtype.kind == "M"
            head = {channel.name: _seconds(channel[0 : min(_HEAD, len(channel))])}
            try:
                found = find_time(head, {channel.name: "s"} if stamps else units, channel.name, reading.time_unit)
            except ValueError as cause:
                if asked:
                    raise fault(self.path, str(cause)) from None
                found = None
            if found is None:
                continue
            read, origin = _reader(channel), 0.0
            if found.epoch:
                origin = self.counted_from(float(head[channel.name][0]) * found.factor)
            return channel.name, _scaled(len(channel), read, found.factor, origin)
        return "", None

    def _begun(self, channel: Any) -> float:
        """When a waveform began, on the clock of the first [s]; 0 where it does not say."""
        begun = channel.properties.get("wf_start_time")
        stamp = 0 if begun is None else int(np.datetime64(begun, "ns").astype(np.int64))
        if stamp <= 0:
            return 0.0
        if self.start_ns is None:
            self.start_ns = stamp
        return (stamp - self.start_ns) / 1e9

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _seconds(values: Any) -> Array:
    array = np.asarray(values)
    return array.astype("M8[ns]").astype(np.int64) / 1e9 if array.dtype.kind == "M" else array.astype(float)


def _reader(channel: Any) -> Any:
    return lambda start, stop: _seconds(channel.read_data(offset=start, length=stop - start))


def _scaled(count: int, read: Any, factor: float, origin: float) -> Stored:
    return Stored(count, lambda start, stop: read(start, stop) * factor - origin)


def _waveform(count: int, begin: float, step: float) -> Stored:
    return Stored(count, lambda start, stop: begin + step * np.arange(start, stop, dtype=np.float64))
