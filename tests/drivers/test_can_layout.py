"""One DBC edit changes a CAN sensor; a wrong DBC is refused with every fault at once."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from lacet.daq.errors import DbcError
from lacet.drivers import open_driver
from lacet.drivers.framework.can_layout import FOLDER
from tests.drivers.driver_cases import decode_all, plausible_blocks

IGEL = (FOLDER / "igel.dbc").read_text(encoding="utf-8")
LASERS = (FOLDER / "lasers.dbc").read_text(encoding="utf-8")


def igel(text: str):
    return open_driver("igel", "can0", {"dbc": "mine.dbc"}, documents={"mine.dbc": text})


def faults(text: str, name: str = "igel") -> list[str]:
    with pytest.raises(DbcError) as caught:
        open_driver(name, "can0", {"dbc": "mine.dbc"}, documents={"mine.dbc": text})
    assert "mine.dbc" in str(caught.value)
    return caught.value.faults


def edit(text: str, *changes: tuple[str, str]) -> str:
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text


EDITS = {
    "another id": edit(IGEL, ("BO_ 272 ", "BO_ 100 ")),
    "an extended id": edit(IGEL, ("BO_ 272 ", f"BO_ {0x80000000 + 0x18FF1234} ")),
    "another scale and unit": edit(
        IGEL,
        ('wheel_fl_force_z : 32|16@1- (1,0) [-32768|32767] "N"', 'wheel_fl_force_z : 32|16@1- (0.001,2) [0|0] "kN"'),
    ),
    "big-endian": edit(IGEL, ("wheel_fl_force_x : 0|16@1-", "wheel_fl_force_x : 7|16@0-")),
    "other bits, a longer message": edit(
        IGEL, ("wheel_fl_force: 6", "wheel_fl_force: 8"), ("wheel_fl_force_z : 32|16@1-", "wheel_fl_force_z : 40|20@1-")
    ),
    "CAN FD": edit(
        IGEL,
        ("wheel_fl_force: 6", "wheel_fl_force: 24"),
        ("wheel_fl_force_z : 32|16@1-", "wheel_fl_force_z : 157|20@1-"),
    ),
    "an encoder of 12 bits": edit(IGEL, ("0|16@1+ (0.0054931640625,0)", "0|12@1+ (0.087890625,0)")),
    "one more signal": edit(
        IGEL, ("wheel_fl_force: 6 IGEL\n", 'wheel_fl_force: 8 IGEL\n SG_ oil : 48|8@1+ (1,0) [0|0] "degC" RECORDER\n')
    ),
    "a wider counter": edit(
        LASERS, (": 6 LASERS", ": 8 LASERS"), ("counter : 32|8@1+ (1,0) [0|255]", "counter : 48|16@1+ (1,0) [0|0]")
    ),
}


@pytest.mark.parametrize("text", EDITS.values(), ids=EDITS.keys())
def test_one_edit_is_enough(text):
    name = "lasers" if "LASERS" in text else "igel"
    driver = open_driver(name, "can0", {"dbc": "mine.dbc"}, documents={"mine.dbc": text})
    sent = plausible_blocks(driver, 50, 7)
    frames = driver.encode(sent)
    got, counts = decode_all(driver, frames)
    assert driver.documents == {"mine.dbc": text}
    assert counts["lost"] == counts["incomplete"] == counts["bad_length"] == 0
    tolerance = {"force": 0.51, "moment": 0.13, "angle": 0.0008, "speed": 0.0026, "ground": 1.1e-5, "hub": 1.1e-5}
    for channel, block in got.items():
        error = np.abs(block.values - sent[channel].values)
        if channel.endswith(".angle"):
            error = np.minimum(error, 2 * np.pi - error)
        assert error.max() <= tolerance[channel.split(".")[-1]], channel
        assert not block.flags.any()
    original, _ = decode_all(open_driver(name, "can0"), frames)
    changed = any(not np.array_equal(original[c].values, got[c].values) for c in got if c in original)
    assert changed or set(original) != set(got) or "oil" in text


def test_fewer_and_more_wheels_are_messages_of_the_dbc():
    front = IGEL[: IGEL.index("BO_ 304 ")]
    assert {channel.split(".")[1] for channel in igel(front).channels} == {"fl", "fr"}
    more = front + re.sub("_fr_", "_rl_", front[front.index("BO_ 288 ") :]).replace("BO_ 2", "BO_ 12")
    assert {channel.split(".")[1] for channel in igel(more).channels} == {"fl", "fr", "rl"}


def test_all_faults_at_once():
    text = edit(
        IGEL,
        ("wheel_fl_moment:", "wheel_fl_momment:"),
        ("wheel_fr_force_y ", "wheel_fr_forcey "),
        ("BO_ 304 wheel_rl_force: 6", "BO_ 304 wheel_rl_force: 5"),
        ("wheel_rl_moment_y : 16|", "wheel_rl_moment_y : 12|"),
        (
            'wheel_rr_force_x : 0|16@1- (1,0) [-32768|32767] "N"',
            'wheel_rr_force_x : 0|16@1- (1,0) [-32768|32767] "bar"',
        ),
    )
    found = faults(text)
    assert found == [
        "message 'wheel_rl_force': signal 'wheel_rl_force_z' needs byte 5 but the message has 5 bytes",
        "message 'wheel_rl_moment': signals 'wheel_rl_moment_x' and 'wheel_rl_moment_y' overlap in 4 bits",
        "has no message 'wheel_fl_moment'; did you mean 'wheel_fl_momment'?",
        "message 'wheel_fr_force' has no signal 'wheel_fr_force_y'; did you mean 'wheel_fr_forcey'?",
        "message 'wheel_rr_force': signal 'wheel_rr_force_x' has unit 'bar'; wheel.rr.force can be given in N, daN, kN",
    ]


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        (" SG_ checksum : 40|8@1+ (1,0)", " SG_ chksum : 40|8@1+ (1,0)", "no signal 'checksum'; did you mean 'chksum'"),
        (" SG_ counter : 32|4@1+ (1,0)", " SG_ cnt : 32|4@1+ (1,0)", "no signal 'counter'"),
        (" SG_ counter : 32|4@1+ (1,0)", " SG_ counter : 32|4@1- (1,0)", "'counter' is signed"),
        (" SG_ status : 36|4@1+ (1,0)", " SG_ state : 36|4@1+ (1,0)", "no signal 'wheel_fl_angle_status' or 'status'"),
        ("BO_ 273 ", "BO_ 272 ", "share the id 0x110"),
        ("0|16@1+ (0.0054931640625,0)", "0|16@1+ (0.0055,0)", "must make one full turn; they make 1.00124 turns"),
        ("wheel_fl_force_x : 0|16@1- (1,0)", "wheel_fl_force_x : 0|16@1- (0,0)", "has factor 0"),
        ("(1,0) [-32768|32767]", "(1,0) [40000|50000]", "no range between minimum and maximum"),
        ("wheel_fl_force_y : 16|", "wheel_fl_force_x : 16|", "'wheel_fl_force_x' comes twice"),
    ],
)
def test_each_fault(old, new, fault):
    assert any(fault in line for line in faults(edit(IGEL, (old, new))))


def test_multiplexed_messages_are_not_decoded():
    text = edit(
        IGEL,
        ("wheel_fl_force_x : 0|16@1-", "wheel_fl_force_x M : 0|16@1-"),
        ("wheel_fl_force_y :", "wheel_fl_force_y m0 :"),
    )
    assert any("'wheel_fl_force' is multiplexed" in line for line in faults(text))


def test_not_a_dbc_and_another_sensors_dbc():
    assert "not a DBC file" in faults("[sensor]\n")[0]
    assert "line 1" in faults("[sensor]\n")[0]
    assert faults(LASERS) == ["has no message 'wheel_fl_force' and none for any other wheel"]
    assert faults(IGEL, "correvit") == ["has no message 'correvit'"]


def test_float_signals_are_not_values():
    text = IGEL + "SIG_VALTYPE_ 272 wheel_fl_force_x : 1;\n"
    text = text.replace("wheel_fl_force: 6", "wheel_fl_force: 8").replace(
        "wheel_fl_force_x : 0|16@1-", "wheel_fl_force_x : 32|32@1-"
    )
    assert any("'wheel_fl_force_x' is a floating-point number" in line for line in faults(text))


def test_a_file_beside_the_rig_wins_and_a_missing_one_names_the_nearest(tmp_path: Path):
    (tmp_path / "igel.dbc").write_text(edit(IGEL, ("BO_ 272 ", "BO_ 100 ")), encoding="utf-8")
    beside = open_driver("igel", "can0", {"dbc": "igel.dbc"}, folder=tmp_path)
    assert 100 in beside.encode(plausible_blocks(beside, 1, 0)).ident
    own = open_driver("igel", "can0", {"dbc": "igel.dbc"})
    assert 100 not in own.encode(plausible_blocks(own, 1, 0)).ident
    with pytest.raises(DbcError, match=r"did you mean 'igel\.dbc'"):
        open_driver("igel", "can0", {"dbc": "igle.dbc"}, folder=tmp_path)
    with pytest.raises(DbcError, match="name of a file"):
        open_driver("igel", "can0", {"dbc": 3})
    (tmp_path / "west.dbc").write_bytes(IGEL.encode() + 'CM_ "25 °C";\n'.encode("cp1252"))
    assert "25 °C" in open_driver("igel", "can0", {"dbc": "west.dbc"}, folder=tmp_path).documents["west.dbc"]
