"""Rows that a run lacks, in one sentence."""

from lacet.identify.car.rows import ROWS, Row, lacking
from lacet.services.render.row_sources import rows_lacking


def test_rows_of_a_kind_and_channels_of_all_corners_are_one_word():
    """A run of another system lacks most rows: one sentence says so, whatever their number."""
    lacks = {row: channels for row in ROWS if (channels := lacking(row, "contact", ["speed", "imu.accel"]))}
    assert len(lacks) > 20
    text = rows_lacking(lacks)
    assert text.startswith(
        "cannot be formed: all chassis, suspension, tyre, spin, body and corner rows; not recorded: "
    )
    assert len(text) < 240, text
    assert "wheel.*.force" in text
    assert "more channels" in text


def test_single_rows_are_named_with_what_they_lack():
    one = {Row("spin.fl"): ("shaft.fl.torque",), Row("spin.fr"): ("shaft.fr.torque",)}
    assert rows_lacking(one) == "cannot be formed: spin.fl, spin.fr; not recorded: shaft.fl.torque and shaft.fr.torque"
    kind = {row: ("imu.accel",) for row in ROWS if row.startswith("tyre.")}
    assert rows_lacking({**kind, Row("spin.fl"): ("shaft.fl.torque",)}) == (
        "cannot be formed: all tyre rows and spin.fl; not recorded: imu.accel and shaft.fl.torque"
    )
