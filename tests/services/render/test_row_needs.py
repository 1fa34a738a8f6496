"""Rows that a run lacks and what they need, in words."""

from lacet.identify.car.rows import ROWS, Absence, Row, RowAbsence, lacking
from lacet.services.render.row_needs import no_rows, not_recorded_lines, rows_lacking


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


def test_without_any_row_the_least_and_the_car_s_vertical_force_are_named():
    """What a single wheel's spin needs gives no mass."""
    left_out = {
        Row("spin.fl"): RowAbsence(Absence.CHANNELS, ("imu.rate",)),
        Row("chassis.fz"): RowAbsence(Absence.CHANNELS, ("imu.accel", "imu.rate")),
    }
    lines = no_rows(left_out).splitlines()
    assert lines[0].strip() == "spin.fl: needs: imu.rate (or car.yaw_rate)"
    assert lines[1].strip() == "or chassis.fz: needs: imu.accel, imu.rate"
    assert no_rows({Row("chassis.fz"): left_out[Row("chassis.fz")]}).count("chassis.fz") == 1


def test_single_rows_are_named_with_what_they_lack():
    one = {Row("spin.fl"): ("shaft.fl.torque",), Row("spin.fr"): ("shaft.fr.torque",)}
    assert rows_lacking(one) == "cannot be formed: spin.fl, spin.fr; not recorded: shaft.fl.torque and shaft.fr.torque"
    kind = {row: ("imu.accel",) for row in ROWS if row.startswith("tyre.")}
    assert rows_lacking({**kind, Row("spin.fl"): ("shaft.fl.torque",)}) == (
        "cannot be formed: all tyre rows and spin.fl; not recorded: imu.accel and shaft.fl.torque"
    )


def test_rows_that_lack_the_same_at_their_own_corner_share_a_line():
    """A corner is named where it is the only one, else ``{c}``; channels of all four corners are ``*``."""
    run = ["imu.accel", "imu.rate", "laser.fr.hub", "laser.rl.hub", "laser.rr.hub"]
    lacks = {row: channels for row in ROWS if (channels := lacking(row, "contact", run))}
    lines = not_recorded_lines(lacks)
    assert "  chassis.fx, fy, mx, my, mz: needs: wheel.*.force" in lines
    assert any(line.startswith("  suspension.fr, rl, rr: needs: wheel.{c}.force (or hub.{c}.load,") for line in lines)
    own = next(line for line in lines if line.startswith("  suspension.fl:"))
    assert "wheel.fl.force" in own
    assert "laser.fl.hub" in own
    assert "{c}" not in own
    assert lines[-1] == "  {c}: the row's own corner; *: all four."
    assert max(len(part) for line in lines for part in line.splitlines()) <= 118
    assert not_recorded_lines({Row("spin.fl"): ("wheel.fl.moment",)}) == ["  spin.fl: needs: wheel.fl.moment"]
