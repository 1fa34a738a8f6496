"""The examples on the pages of the wires, decoded, and encoded again."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np
import pytest

from lacet.daq.blocks import Flag
from lacet.daq.channels import COLUMNS
from lacet.daq.frames import Frames
from lacet.drivers import open_driver
from lacet.drivers.framework.base import Reader
from lacet.drivers.framework.crc import CRC8_J1850, CRC16_CCITT_FALSE, CRC32
from tests.drivers.driver_cases import decode_all, same_frames
from tests.support.places import HOME

PAGES = HOME / "docs/wires"
BLOCK = re.compile(r"^```wire\n(.*?)^```", re.MULTILINE | re.DOTALL)


@dataclass
class Example:
    """One ```wire``` block."""

    driver: str
    frames: list[tuple[int, bytes]] = field(default_factory=list)
    counter: int = 0
    values: dict[str, list[float]] = field(default_factory=dict)
    flags: dict[str, list[Flag]] = field(default_factory=dict)
    device: list[int] | None = None
    counts: dict[str, int] = field(default_factory=dict)
    fault: bool = False


def flags_of(word: str) -> Flag:
    """``GAP|STATUS`` as flags."""
    total = Flag.OK
    for name in word.split("|"):
        total |= Flag[name]
    return total


def parse(driver: str, text: str) -> Example:
    example = Example(driver)
    for line in text.splitlines():
        key, _, rest = line.partition(" ")
        words = rest.split()
        if key == "frame":
            example.frames.append((int(words[0], 0), bytes.fromhex("".join(words[1:]))))
        elif key == "counter":
            example.counter = int(words[0])
        elif key == "value":
            example.values[words[0]] = [float(word) for word in words[1:]]
        elif key == "flags":
            example.flags[words[0]] = [flags_of(word) for word in words[1:]]
        elif key == "device":
            example.device = [int(word) for word in words]
        elif key == "count":
            example.counts[words[0]] = int(words[1])
        elif key == "fault":
            example.fault = True
        else:
            raise ValueError(f"{driver}.md: '{line}'")
    return example


EXAMPLES = [
    pytest.param(parse(page.stem, text), id=f"{page.stem}-{i + 1}")
    for page in sorted(PAGES.glob("*.md"))
    for i, text in enumerate(BLOCK.findall(page.read_text(encoding="utf-8")))
]


@pytest.mark.parametrize("page", sorted(set(PAGES.glob("*.md")) - {PAGES / "README.md"}), ids=lambda page: page.stem)
def test_each_page_has_three_examples_one_of_a_fault(page):
    examples = [param.values[0] for param in EXAMPLES if param.values[0].driver == page.stem]
    assert len(examples) >= 3
    assert any(example.fault for example in examples)
    assert sum(not example.fault for example in examples) >= 2


@pytest.mark.parametrize("example", EXAMPLES)
def test_example_decodes_to_what_the_page_says(example):
    driver = open_driver(example.driver, "bus")
    frames = Frames.from_iter("bus", [("bus", 0, ident, payload) for ident, payload in example.frames])
    blocks, counts = decode_all(driver, frames)
    assert example.values
    assert example.flags
    for column, expected in example.values.items():
        channel, component = COLUMNS[column]
        np.testing.assert_allclose(blocks[channel.name].values[:, component], expected, rtol=1e-12, atol=1e-15)
    for channel, expected in example.flags.items():
        assert [Flag(int(flag)) for flag in blocks[channel].flags] == expected
    for name, count in example.counts.items():
        assert counts[name] == count, name
    if example.device is not None:
        for block in blocks.values():
            assert block.device_ns is not None
            assert block.device_ns.tolist() == example.device
    if isinstance(driver, Reader):
        return
    again = driver.encode(blocks, counter=example.counter)
    if not example.fault:
        same_frames(again, frames)


def test_the_constants_on_the_pages_are_those_of_the_algorithms():
    check = np.frombuffer(b"123456789", np.uint8)[None]
    for page, crc in (("igel", CRC8_J1850), ("sagem", CRC16_CCITT_FALSE), ("zimmer", CRC32)):
        text = " ".join((PAGES / f"{page}.md").read_text(encoding="utf-8").split())
        digits = crc.width // 4
        assert crc.name in text
        assert f"polynomial 0x{crc.polynomial:0{digits}X}" in text
        assert f"check value 0x{int(crc.over(check)[0]):0{digits}X}" in text


@pytest.mark.parametrize("name", ["igel", "lasers", "correvit"])
def test_the_ids_on_the_pages_are_those_of_the_dbc(name):
    driver = open_driver(name, "bus")
    text = (PAGES / f"{name}.md").read_text(encoding="utf-8")
    idents = {message.ident for unit in driver.units for message in unit.messages}
    prose = BLOCK.sub("", text)
    assert {int(word, 16) for word in re.findall(r"0x\d\d\d\b", prose)} == idents
