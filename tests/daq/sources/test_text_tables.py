"""Text tables as others write them: separator, decimal sign, encoding, header, units and times are found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lacet.daq.errors import RunError
from lacet.daq.sources.open_source import open_source
from lacet.daq.sources.source import Reading, Source, read_all


def opened(tmp_path: Path, text: str, encoding: str = "utf-8", **reading: object) -> Source:
    (tmp_path / "log.csv").write_bytes(text.encode(encoding))
    return open_source(tmp_path / "log.csv", Reading(**reading))  # type: ignore[arg-type]


ROWS = [(0.0, 1.5, -2.0), (0.01, 1.75, -2.5), (0.02, 2.0, -3.25)]


@pytest.mark.parametrize(("text", "encoding", "units"), [
    ("t,Ax [g],Speed (km/h)\n0,1.5,-2\n0.01,1.75,-2.5\n0.02,2,-3.25\n", "utf-8", ("g", "km/h")),
    ("Zeit;Ax;Speed\ns;g;km/h\n0,0;1,5;-2,0\n0,01;1,75;-2,5\n0,02;2,0;-3,25\n", "cp1252", ("g", "km/h")),
    ("Logger X\nFahrer: Müller\n\ntime_ms\tAx\tSpeed\n0\t1.5\t-2\n10\t1.75\t-2.5\n20\t2\t-3.25\n", "cp1252", ("", "")),
    ("\ufeffTime,Ax,Speed\n,m/s^2,°\n0,1.5,-2\n0.01,1.75,-2.5\n0.02,2,-3.25\n", "utf-8", ("m/s^2", "°")),
    ("Time,Ax,Speed\n0,1.5,-2\n0.01,1.75,-2.5\n0.02,2,-3.25\n", "utf-16", ("", "")),
    ('"Time [ms]","Ax","Speed"\r\n"0","1.5","-2"\r\n"10","1.75","-2.5"\r\n"20","2","-3.25"\r\n', "utf-8", ("", "")),
    ("Timestamp,Ax,Speed\n1700000000.00,1.5,-2\n1700000000.01,1.75,-2.5\n1700000000.02,2,-3.25\n", "utf-8", ("", "")),
    ("Timestamp,Ax,Speed\n1700000000000,1.5,-2\n1700000000010,1.75,-2.5\n1700000000020,2,-3.25\n", "utf-8", ("", "")),
    ("clock,Ax,Speed\n12:00:00.00,1.5,-2\n12:00:00.01,1.75,-2.5\n12:00:00.02,2,-3.25\n", "utf-8", ("", "")),
    ("date,Ax,Speed\n2024-05-01 12:00:00.00,1.5,-2\n2024-05-01 12:00:00.01,1.75,-2.5\n2024-05-01 12:00:00.02,2,-3.25\n",
     "utf-8", ("", "")),
    ("Ax,Speed,gps status,secs\n1.5,-2,ok,0\n1.75,-2.5,ok,0.01\n2,-3.25,lost,0.02\n", "utf-8", ("", "")),
])  # fmt: skip
def test_the_form_is_found(tmp_path: Path, text: str, encoding: str, units: tuple[str, str]) -> None:
    source = opened(tmp_path, text, encoding)
    found = read_all(source, ["Ax", "Speed"])
    assert (source.listed["Ax"].unit, source.listed["Speed"].unit) == units
    t = found["Ax"].t - found["Ax"].t[0]
    np.testing.assert_allclose(t, [row[0] for row in ROWS], atol=3e-7)
    np.testing.assert_allclose(np.stack([found["Ax"].values, found["Speed"].values], 1), [row[1:] for row in ROWS])


def test_cells_without_a_value_have_none(tmp_path: Path) -> None:
    source = opened(tmp_path, "t,a\n0,1\n0.1,NaN\n0.2,\n0.3,---\n0.4,5\n")
    np.testing.assert_array_equal(np.isnan(read_all(source, ["a"])["a"].values), [False, True, True, True, False])


@pytest.mark.parametrize("lines", [30, 60_000])
def test_times_of_day_go_on_after_midnight(tmp_path: Path, lines: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Within the part from which the form is found, and from one block of lines to the next."""
    monkeypatch.setattr("lacet.daq.sources.csv_table._BLOCK", 1 << 16)
    first = 86400.0 - 0.01 * (lines // 2)
    of_day = [(first + 0.01 * k) % 86400.0 for k in range(lines)]
    rows = [f"{int(t // 3600):02d}:{int(t // 60 % 60):02d}:{t % 60:06.3f},{k}" for k, t in enumerate(of_day)]
    source = opened(tmp_path, "\n".join(["clock,a", *rows]) + "\n")
    found = read_all(source, ["a"])["a"]
    np.testing.assert_allclose(found.t, first + 0.01 * np.arange(lines), atol=2e-3)
    again = read_all(source, ["a"])["a"]
    np.testing.assert_array_equal(again.t, found.t)


def test_a_clock_that_is_set_back_an_hour_is_not_past_midnight(tmp_path: Path) -> None:
    seconds = np.r_[43_200:43_500, 39_900:40_000]
    rows = [f"{t // 3600:02d}:{t // 60 % 60:02d}:{t % 60:02d},5" for t in seconds]
    source = opened(tmp_path, "\n".join(["clock,a", *rows]) + "\n")
    np.testing.assert_array_equal(read_all(source, ["a"])["a"].t, seconds)


def test_a_table_without_times_has_a_rate(tmp_path: Path) -> None:
    source = opened(tmp_path, "a,b\n1,5\n1,4\n2,5\n2,1\n", rate=50.0)
    np.testing.assert_allclose(read_all(source, ["b"])["b"].t, [0.0, 0.02, 0.04, 0.06])


def test_a_time_of_another_name_is_noted(tmp_path: Path) -> None:
    source = opened(tmp_path, "a,b\n5,0.1\n4,0.2\n7,0.3\n")
    np.testing.assert_allclose(read_all(source, ["a"])["a"].t, [0.1, 0.2, 0.3])
    assert source.notes == ["no column has the name of a time: 'b', which increases all the time, is taken for it"]


def test_names_that_stand_twice_are_told_apart(tmp_path: Path) -> None:
    source = opened(tmp_path, "t,Fx,Fx\n0,1,2\n1,3,4\n2,5,6\n")
    assert list(source.listed) == ["Fx", "Fx_2"]


@pytest.mark.parametrize(("text", "reading", "says"), [
    ("a,b\n1,5\n1,4\n2,5\n", {}, r"no column is a time.*the columns are a, b.*rate = 100"),
    ("t,b\n0,5\n1,4\n2,5\n", {"time": "bb"}, r"there is no 'bb'; did you mean 'b'"),
    ("t,b\n0,5\n1,4\n2,5\n", {"time": "b"}, "its values do not increase"),
    ("t,speed\n0.0,50\n0.0,51\n0.1,52\n0.1,53\n", {}, "'t' has the same value in 2 lines each.*or rate = 100"),
    ("time,a,b\nfive,50,1\nsix,51,2\nten,52,3\n", {}, "'time' has the name of a time, but is written as 'five'"),
    ("speed [km/h],b\n50,4\n51,5\n52,3\n", {}, "no column is a time"),
    ("hello\nworld\n", {}, "no lines of numbers were found"),
    ("0,5\n1,4\n2,5\n", {}, "no header above the numbers, which begin in line 1"),
])  # fmt: skip
def test_a_refusal_says_what_was_found_and_what_to_do(
    tmp_path: Path, text: str, reading: dict[str, object], says: str
) -> None:
    with pytest.raises(RunError, match=says):
        opened(tmp_path, text, **reading)


def test_a_word_among_the_numbers_is_named_with_its_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It counts as missing, and nothing before or behind it is lost; lines without a time are left out."""
    monkeypatch.setattr("lacet.daq.sources.csv_table._BLOCK", 1 << 12)
    lines = ["t,a", *(f"{0.01 * k:.2f},{k}" for k in range(2000))]
    lines[1500], lines[1600] = "14.99,broken", "15.99,#DIV/0!"
    source = opened(tmp_path, "\n".join([*lines, "Mean,5"]) + "\n")
    found = read_all(source, ["a"])["a"]
    np.testing.assert_allclose(found.t, 0.01 * np.arange(2000))
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found.values)), [1499, 1599])
    np.testing.assert_array_equal(found.values[1600:], np.arange(1600, 2000))
    assert sorted(source.notes) == [
        "'a' has cells that are no numbers: they count as missing (line 1501: 'broken')",
        "'t' has cells that are no numbers: they count as missing (line 2002: 'Mean')",
        "lines without a time are left out",
    ]


@pytest.mark.parametrize(("head", "cells", "times"), [
    ("time", ["11:59:59.5 AM", "12:00:00 PM", "12:00:00.5 PM"], [43199.5, 43200.0, 43200.5]),
    ("time", ["11:59:59.5 p.m.", "12:00:00 a.m.", "12:00:00.5 a.m."], [86399.5, 86400.0, 86400.5]),
    ("t_ms", [str(500 * k % 86_400_000) for k in range(172_780, 172_810)], [0.5 * k for k in range(172_780, 172_810)]),
    ("t", ["500000000", "500010000", "500020000"], [500.0, 500.01, 500.02]),
    ("t", ["1700000000000", "1700000000010", "1700000000020"], [0.0, 0.01, 0.02]),
])  # fmt: skip
def test_times_as_loggers_write_them(tmp_path: Path, head: str, cells: list[str], times: list[float]) -> None:
    """Clocks of twelve hours, milliseconds since midnight, and whole numbers whose unit follows from their step."""
    source = opened(tmp_path, "\n".join([f"{head},a", *(f"{cell},1" for cell in cells)]) + "\n")
    np.testing.assert_allclose(read_all(source, ["a"])["a"].t, times, atol=1e-7)


@pytest.mark.parametrize(("decimal", "cells"), [
    (",", ["4.000,00", "-12.345.678,5", "7,25"]), (".", ["4,000.00", "-12,345,678.5", "7.25"]),
])  # fmt: skip
def test_digits_in_groups_of_three_are_numbers(tmp_path: Path, decimal: str, cells: list[str]) -> None:
    """Where they can be nothing else: 4,000 alone may be four with three decimals."""
    times = [f"{t:.2f}".replace(".", decimal) for t in (0.0, 0.01, 0.02)]
    alone = "1.234" if decimal == "," else "1,234"
    rows = [f"{t};{cell};{t};{t};{alone}" for t, cell in zip(times, cells, strict=True)]
    source = opened(tmp_path, "\n".join(["t;load;x;y;z", *rows]) + "\n")
    np.testing.assert_array_equal(read_all(source, ["load"])["load"].values, [4000.0, -12345678.5, 7.25])
    assert source.notes == [f"columns of text are left out: 'z' ('{alone}')"]


def test_a_long_table_is_read_in_pieces(tmp_path: Path) -> None:
    t = np.arange(300_000) / 1000.0
    np.savetxt(
        tmp_path / "log.csv", np.column_stack([t, np.sin(t), np.cos(t)]), "%.9f", ",", header="t,a,b", comments=""
    )
    source = open_source(tmp_path / "log.csv")
    sizes = [len(piece["a"].t) for piece in source.pieces(["a"])]
    assert len(sizes) > 1
    assert sum(sizes) == len(t)
    assert 0.9 < source.done <= 1.0


@pytest.mark.parametrize("name", ["Date time", "Time of day", "GPS time [s]", "UTC", "t_ms", "Zeit", "time-stamp"])
def test_a_column_is_known_as_the_time_by_its_name(tmp_path: Path, name: str) -> None:
    """Though another before it increases all the time."""
    source = opened(tmp_path, f"distance,{name}\n1,5.0\n2,5.1\n3,5.2\n")
    assert list(source.listed) == ["distance"]


@pytest.mark.parametrize("name", ["lap_time_delta", "timer", "contact"])
def test_a_name_that_only_begins_as_one_is_no_time(tmp_path: Path, name: str) -> None:
    source = opened(tmp_path, f"a,{name}\n1,5.0\n2,5.1\n3,5.2\n")
    assert name in source.listed


JAPANESE = "時間[s],横加速度[m/s2],車速［km/h］\n0,1.5,-2\n0.01,1.75,-2.5\n0.02,2,-3.25\n"


@pytest.mark.parametrize("encoding", ["cp932", "shift_jis", "utf-8", "utf-16", "utf-16-le", "utf-16-be"])
def test_japanese_tables_are_read_in_the_encodings_they_are_written_in(tmp_path: Path, encoding: str) -> None:
    source = opened(tmp_path, JAPANESE, encoding)
    assert [(one.name, one.unit) for one in source.listed.values()] == [("横加速度", "m/s2"), ("車速", "km/h")]
    np.testing.assert_allclose(read_all(source, ["車速"])["車速"].values, [row[2] for row in ROWS])
    assert source.notes == []


@pytest.mark.parametrize("names", [
    "Längsbeschl [m/s²],Öldruck", "Winkel [°],Ölstände für Müller", "l’accélération,Vitesse – été", "“Größe”,ÄÖÜß äöü",
    "Température,Débattement", "Aceleración,Año", "Ä,ü",
])  # fmt: skip
def test_a_table_of_western_europe_is_not_taken_for_japanese(tmp_path: Path, names: str) -> None:
    text = f"t,{names}\n0,1.5,-2\n0.01,1.75,-2.5\n0.02,2,-3.25\n"
    source = opened(tmp_path, text, "cp1252")
    assert source.form.encoding == "cp1252"  # type: ignore[attr-defined]


@pytest.mark.parametrize(("text", "written", "asked"), [
    (JAPANESE, "cp932", "cp1252"), (JAPANESE, "utf-8", "ascii"),
    ("t,Direction française\n0,1\n0.1,2\n0.2,3\n", "mac_roman", ""),
])  # fmt: skip
def test_an_encoding_that_does_not_fit_is_said_with_the_remedy(
    tmp_path: Path, text: str, written: str, asked: str
) -> None:
    (tmp_path / "log.csv").write_bytes(text.encode(written))
    with pytest.raises(RunError, match=r'\[read\] encoding = "cp932"'):
        open_source(tmp_path / "log.csv", Reading(encoding=asked, time="t"))
