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


def test_names_that_stand_twice_are_told_apart(tmp_path: Path) -> None:
    source = opened(tmp_path, "t,Fx,Fx\n0,1,2\n1,3,4\n2,5,6\n")
    assert list(source.listed) == ["Fx", "Fx_2"]


@pytest.mark.parametrize(("text", "reading", "says"), [
    ("a,b\n1,5\n1,4\n2,5\n", {}, r"no column is a time.*the columns are a, b.*rate = 100"),
    ("t,b\n0,5\n1,4\n2,5\n", {"time": "bb"}, r"there is no 'bb'; did you mean 'b'"),
    ("t,b\n0,5\n1,4\n2,5\n", {"time": "b"}, "its values do not increase"),
    ("hello\nworld\n", {}, "no lines of numbers were found"),
    ("0,5\n1,4\n2,5\n", {}, "no header above the numbers, which begin in line 1"),
])  # fmt: skip
def test_a_refusal_says_what_was_found_and_what_to_do(
    tmp_path: Path, text: str, reading: dict[str, object], says: str
) -> None:
    with pytest.raises(RunError, match=says):
        opened(tmp_path, text, **reading)


def test_a_word_among_the_numbers_is_named_with_its_place(tmp_path: Path) -> None:
    lines = ["t,a", *(f"{0.01 * k:.2f},{k}" for k in range(1000)), "10.00,broken"]
    source = opened(tmp_path, "\n".join(lines) + "\n")
    with pytest.raises(RunError, match=r"log\.csv(.|\n)*'broken'"):
        read_all(source, ["a"])


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
