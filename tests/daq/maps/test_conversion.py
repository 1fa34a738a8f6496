"""Runs made by a map: units of the files, delays, tables, own times, several files, and pieces as the whole."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
from nptdms import ChannelObject, TdmsWriter

from lacet.daq.errors import RunError
from lacet.daq.formats.open_run import open_run
from lacet.daq.maps import assembly
from lacet.daq.maps.channel_map import ChannelMap
from lacet.daq.maps.guess import guess
from lacet.daq.maps.mapped_run import mapped_run
from lacet.daq.run import Run
from lacet.daq.sources.open_source import opened
from lacet.services.workspace.import_log import import_logs

T = np.arange(0.0, 4.0, 0.01)
HEAD = 'format = "lacet-map 1"\n'


def table(path: Path, **columns: np.ndarray) -> Path:
    names = ",".join(columns)
    np.savetxt(path, np.column_stack(list(columns.values())), "%.9g", ",", header=names, comments="")
    return path


def made(path: Path, text: str) -> Run:
    return mapped_run([path], ChannelMap.parse(HEAD + text, "map", path.parent))


def test_expressions_units_and_signs(tmp_path: Path) -> None:
    file = table(tmp_path / "a.csv", t=T, A=np.sin(T), B=10 + T)
    run = made(file, """
[sources]
A = "g"
B = "mm"
[channels]
"car.lateral_accel" = "-(A - 0.1 g)"
"laser.fl.hub" = "300 mm - 1.32 * B"
"laser.fr.hub" = "max(B, 12 mm)"
""")  # fmt: skip
    np.testing.assert_allclose(run.signals["car.lateral_accel"].values[:, 0], -9.80665 * (np.sin(T) - 0.1), atol=1e-7)
    np.testing.assert_allclose(run.signals["laser.fl.hub"].values[:, 0], 0.3 - 1.32e-3 * (10 + T), atol=1e-9)
    np.testing.assert_allclose(run.signals["laser.fr.hub"].values[:, 0], np.maximum(10 + T, 12) * 1e-3, atol=1e-9)


def test_a_line_about_no_name_of_the_log_is_told_with_the_nearest(tmp_path: Path) -> None:
    """A delay under a misspelt name would be lost; names that no channel needs, and patterns, may stand."""
    file = table(tmp_path / "a.csv", t=T, SWA=np.sin(T), V=10 + T)
    text = '[sources]\nSWA = "deg"\nSVA = { delay = "30 ms" }\n"V*" = "km/h"\n"acc*" = "g"\n'
    run = made(file, text + '[channels]\n"steering.angle" = "SWA"')
    told = [problem for problem in run.problems if "fits no name" in problem]
    assert told == [
        "[sources] 'SVA' fits no name of the log and says nothing; did you mean 'SWA'?",
        "[sources] 'acc*' fits no name of the log and says nothing",
    ]


def test_a_unit_is_taken_from_the_file_and_the_map_says_another(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text("t,A [km/h]\n0,36\n1,72\n2,36\n")
    assert made(file, '[channels]\n"car.speed" = "A"').signals["car.speed"].values[1, 0] == pytest.approx(20.0)
    run = made(file, '[sources]\nA = "m/s"\n[channels]\n"car.speed" = "A"')
    assert run.signals["car.speed"].values[1, 0] == pytest.approx(72.0)


def test_a_unit_of_the_file_that_does_not_fit_leaves_the_channel_out(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text("t,A [km/h],B [mm]\n0,36,1\n1,72,2\n2,36,1\n")
    run = made(file, '[channels]\n"car.speed" = "A"\n"gnss.speed" = "B"\n"steering.angle" = "C"')
    assert list(run.signals) == ["car.speed"]
    said = "\n".join(run.problems)
    assert "gnss.speed: this is in m, and gnss.speed is in m/s" in said
    assert "'B' is in mm" in said
    assert "steering.angle: there is no 'C'" in said
    assert "the file has A, B" in said


def test_what_has_no_unit_is_taken_as_si_and_said(tmp_path: Path) -> None:
    run = made(table(tmp_path / "a.csv", t=T, A=T), '[channels]\n"car.speed" = "A"')
    assert "without a unit in file and map, taken as SI: A" in run.problems


def test_of_many_names_without_a_unit_the_first_are_named_and_the_result_has_all(tmp_path: Path) -> None:
    names = [f"a_name_of_a_log_{k}" for k in range(12)]
    columns = [f"wheel.{c}.force.{a}" for c in ("fl", "fr", "rl", "rr") for a in "xyz"]
    file = table(tmp_path / "a.csv", t=T, **dict.fromkeys(names, T))
    lines = [f'"{column}" = "{name}"' for column, name in zip(columns, names, strict=True)]
    map_ = ChannelMap.parse('format = "lacet-map 1"\n[channels]\n' + "\n".join(lines))
    short = f"without a unit in file and map, taken as SI: {', '.join(names[:5])} and 7 more"
    for output in ("run.mcap", "run.parquet"):
        found = import_logs([file], map_, tmp_path / output)
        assert short in found["notes"]
        assert found["without_unit"] == names


def test_a_delay_is_removed_and_a_table_looked_up(tmp_path: Path) -> None:
    (tmp_path / "s.csv").write_text("SWA [deg],x [deg]\n-180,-10\n0,0\n180,20\n")
    file = table(tmp_path / "a.csv", t=T, SWA=90 * np.sin(T) + 100.0, A=np.sin(T))
    run = made(file, """
[sources]
SWA = "deg"
[channels]
"camera.fl.steer" = { from = "SWA - 100 deg", table = "s.csv" }
"camera.fr.steer" = { from = "2 * SWA", table = "s.csv" }
"car.speed" = { from = "A", unit = "m/s", delay = "30 ms" }
"gnss.speed" = { from = "A", unit = "m/s" }
""")  # fmt: skip
    x = 90 * np.sin(T)
    expected = np.deg2rad(np.where(x > 0, x / 9.0, x / 18.0))
    np.testing.assert_allclose(run.signals["camera.fl.steer"].values[:, 0], expected, atol=1e-8)
    outside = 2 * (x + 100.0) > 180.0
    np.testing.assert_array_equal(run.signals["camera.fr.steer"].usable, ~outside)
    shift = run.signals["gnss.speed"].t[0] - run.signals["car.speed"].t[0]
    assert shift == pytest.approx(0.03)


def test_columns_with_a_time_of_their_own(tmp_path: Path) -> None:
    late = T + 0.5
    file = table(tmp_path / "a.csv", t=T, t_pot=1e3 * late, Pot=np.cos(late), A=np.cos(T))
    run = made(file, """
[sources]
Pot = { unit = "m", time = "t_pot" }
t_pot = "ms"
A = "m"
[channels]
"suspension.fl.travel" = "Pot"
"suspension.fr.travel" = "A + 0 * Pot"
""")  # fmt: skip
    own = run.signals["suspension.fl.travel"]
    np.testing.assert_allclose(own.values[:, 0], np.cos(own.t), atol=1e-6)
    assert own.t[0] == pytest.approx(0.5)
    both = run.signals["suspension.fr.travel"]
    assert np.count_nonzero(both.usable) == np.count_nonzero((T >= 0.5) & (T < 4.0))
    assert any("brought to the stamps of A" in problem for problem in run.problems)


def test_nothing_is_interpolated_across_a_drop_out(tmp_path: Path) -> None:
    keep = (T < 1.0) | (T > 2.0)
    one, other = table(tmp_path / "a.csv", t=T, A=T), table(tmp_path / "b.csv", t=T[keep], B=T[keep])
    text = '[sources]\nA = "m/s"\nB = "m/s"\n[channels]\n"correvit.speed.x" = "A"\n"correvit.speed.y" = "B"'
    run = mapped_run([one, other], ChannelMap.parse(HEAD + text))
    usable = run.signals["correvit.speed"].usable
    np.testing.assert_array_equal(usable, keep | np.isclose(T, 1.0 - 0.01) | np.isclose(T, 2.01))
    assert any("one clock" in problem for problem in run.problems)


BEGUN = 1_764_300_000.25
"""An instant of November 2025 [s since 1970]."""


def written_in(kind: str, path: Path, t: np.ndarray, values: np.ndarray, name: str) -> Path:
    """A table whose times since 1970 are written in some way, (n,) each."""
    if kind == "iso":
        stamps = [f"{np.datetime64(round(1e6 * (BEGUN + one)), 'us')}" for one in t]
        path.write_text("\n".join([f"time,{name}", *(f"{a},{b:.9g}" for a, b in zip(stamps, values, strict=True))]))
    elif kind == "parquet":
        pq.write_table(pa.table({"time": BEGUN + t, name: values}), path := path.with_suffix(".parquet"))
    elif kind == "mat":
        scipy.io.savemat(path := path.with_suffix(".mat"), {"time": BEGUN + t, name: values})
    else:
        factor = {"s": 1.0, "ms": 1e3, "us": 1e6}[kind]
        np.savetxt(
            path, np.column_stack([factor * (BEGUN + t), values]), "%.12g", ",", header=f"time,{name}", comments=""
        )
    return path


@pytest.mark.parametrize("kind", ["s", "ms", "us", "iso", "parquet", "mat"])
def test_files_that_begin_at_other_instants_are_on_one_clock(tmp_path: Path, kind: str) -> None:
    """Two files of one drive, the second from its third second on, each with times since 1970."""
    late = T + 3.0
    one = written_in(kind, tmp_path / "a.csv", T, np.cos(T), "A")
    other = written_in(kind, tmp_path / "b.csv", late, np.cos(late), "B")
    text = '[sources]\nA = "m"\nB = "m"\n[channels]\n"suspension.fl.travel" = "A"\n"suspension.fr.travel" = "B"'
    run = mapped_run([one, other], ChannelMap.parse(HEAD + text))
    for c, first in (("fl", 0.0), ("fr", 3.0)):
        signal = run.signals[f"suspension.{c}.travel"]
        assert signal.t[0] == pytest.approx(first, abs=1e-4)
        np.testing.assert_allclose(signal.values[:, 0], np.cos(signal.t), atol=2e-4)
    assert not any("one clock" in problem for problem in run.problems)


def test_waveforms_that_begin_at_other_instants_are_on_one_clock(tmp_path: Path) -> None:
    """Of one TDMS file, each with the instant at which it began."""
    waveforms = []
    for name, late in (("A", 0.0), ("B", 3.0)):
        begun = np.datetime64(round(1e6 * (BEGUN + late)), "us")
        about = {"wf_increment": 0.01, "wf_start_time": begun, "unit_string": "m"}
        waveforms.append(ChannelObject("car", name, np.cos(T + late), properties=about))
    with TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment(waveforms)
    run = made(tmp_path / "a.tdms", '[channels]\n"suspension.fl.travel" = "A"\n"suspension.fr.travel" = "B"')
    for c, first in (("fl", 0.0), ("fr", 3.0)):
        signal = run.signals[f"suspension.{c}.travel"]
        assert signal.t[0] == pytest.approx(first, abs=1e-4)
        np.testing.assert_allclose(signal.values[:, 0], np.cos(signal.t), atol=2e-4)


def test_a_column_of_times_since_1970_for_one_name(tmp_path: Path) -> None:
    """The file's own times count from 1970, and those of one name that is 2 s late too."""
    late = T + 2.0
    np.savetxt(tmp_path / "a.csv", np.column_stack([BEGUN + T, BEGUN + late, np.cos(T), np.cos(late)]), "%.12g", ",",
               header="t,t_pot,A,Pot", comments="")  # fmt: skip
    run = made(tmp_path / "a.csv", """
[sources]
Pot = { unit = "m", time = "t_pot" }
t_pot = "s"
A = "m"
[channels]
"suspension.fl.travel" = "Pot"
"suspension.fr.travel" = "A"
""")  # fmt: skip
    for c, first in (("fl", 2.0), ("fr", 0.0)):
        signal = run.signals[f"suspension.{c}.travel"]
        assert signal.t[0] == pytest.approx(first, abs=1e-4)
        np.testing.assert_allclose(signal.values[:, 0], np.cos(signal.t), atol=2e-4)


def test_a_name_in_two_files_is_told_by_its_file(tmp_path: Path) -> None:
    one, other = table(tmp_path / "left.csv", t=T, A=T), table(tmp_path / "right.csv", t=T, A=-T)
    text = (
        '[channels]\n"car.speed" = { from = "left.A", unit = "m/s" }\n"gnss.speed" = { from = "right.A", unit = "m/s" }'
    )
    run = mapped_run([one, other], ChannelMap.parse(HEAD + text))
    np.testing.assert_allclose(run.signals["gnss.speed"].values, -run.signals["car.speed"].values)


def test_names_of_files_of_one_name_in_two_folders_are_told_apart(tmp_path: Path) -> None:
    """Nothing of the second is taken for the first's."""
    for folder, value in (("a", 1.0), ("b", 2.0)):
        (tmp_path / folder).mkdir()
        table(tmp_path / folder / "lap.csv", t=T, S=np.full(len(T), value))
    files = [tmp_path / folder / "lap.csv" for folder in ("a", "b")]
    text = '[sources]\n"*" = "m/s"\n[channels]\n"car.speed" = "lap.S"\n"gnss.speed" = "lap_2.S"'
    run = mapped_run(files, ChannelMap.parse(HEAD + text))
    assert [float(run.signals[name].values[0, 0]) for name in ("car.speed", "gnss.speed")] == [1.0, 2.0]
    with opened(files[0]) as first, opened(files[1]) as second:
        assert [one.name for one in guess(first, second) if one.name.endswith("S")] == ["lap.S", "lap_2.S"]


def test_a_name_in_two_files_is_asked_for_as_it_is_written(tmp_path: Path) -> None:
    """What the message says to write is understood, in backquotes where it is no plain word."""
    one, other = table(tmp_path / "left.csv", t=T, A=T), table(tmp_path / "2 right.csv", t=T, A=-T)
    text = '[sources]\n"*A" = "m/s"\n[channels]\n"car.speed" = "A"'
    with pytest.raises(RunError, match=r"'A' could be left\.A, `2 right\.A`: write one of these"):
        mapped_run([one, other], ChannelMap.parse(HEAD + text))
    run = mapped_run([one, other], ChannelMap.parse(HEAD + text.replace('"A"', '"`2 right.A`"')))
    np.testing.assert_allclose(run.signals["car.speed"].values[:, 0], -T)


def test_a_component_alone_is_left_out_with_the_channel_for_it(tmp_path: Path) -> None:
    text = '[sources]\nA = "m/s²"\n[channels]\n"imu.accel.y" = "A"\n"car.lateral_accel" = "A"'
    run = made(table(tmp_path / "a.csv", t=T, A=T), text)
    assert list(run.signals) == ["car.lateral_accel"]
    assert "map it to car.lateral_accel" in run.problems[0]


def test_pieces_give_what_the_whole_gives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two time bases in a channel, read a few samples at a time or at once."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    from lacet.daq.sources import parquet_table

    for name, t in (("a", T), ("b", T[::3] + 0.003)):
        pq.write_table(pa.table({"t": t, name.upper(): np.sin(3 * t)}), tmp_path / f"{name}.parquet")
    text = '[sources]\n"?" = "m/s"\n[channels]\n"correvit.speed.x" = "A"\n"correvit.speed.y" = "A + B"'
    files = [tmp_path / "a.parquet", tmp_path / "b.parquet"]
    map_ = ChannelMap.parse(HEAD + text)
    whole = mapped_run(files, map_).signals["correvit.speed"]
    monkeypatch.setattr(parquet_table, "PIECE_SAMPLES", 17)
    pieces = mapped_run(files, map_).signals["correvit.speed"]
    np.testing.assert_array_equal(pieces.t, whole.t)
    np.testing.assert_allclose(pieces.values, whole.values, atol=1e-12)
    assert assembly.GAP_STEPS > 1.0


@pytest.mark.parametrize("said", ['delay = "30 ms"', 'delay = "-30 ms"', 'drift = "10 ms/s"', 'drift = "-1 %"'])
def test_no_sample_is_lost_between_pieces_with_a_delay_or_a_drift(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: str
) -> None:
    """Stamps count as they are in the log: what is removed of them makes none go back."""
    from lacet.daq.sources import parquet_table

    pq.write_table(pa.table({"t": T, "A": np.sin(T)}), tmp_path / "a.parquet")
    text = f'[sources]\nA = {{ unit = "m/s", {said} }}\n[channels]\n"car.speed" = "A"'
    monkeypatch.setattr(parquet_table, "PIECE_SAMPLES", 17)
    run = made(tmp_path / "a.parquet", text)
    assert len(run.signals["car.speed"].t) == len(T)
    assert not run.problems


@pytest.mark.parametrize("name", ["B", "late"])
def test_a_clock_that_runs_fast_is_put_right(tmp_path: Path, name: str) -> None:
    """Two logs of one drive; the clock of the second gains 1 % and began 0.4 s late, as the map says."""
    one = table(tmp_path / "a.csv", t=T, A=np.sin(T))
    other = table(tmp_path / "b.csv", t=1.01 * T + 0.4, B=np.cos(T))
    said = 'A = "m"\nlate = { name = "B" }\nB = { unit = "m", delay = "0.4 s", drift = "10 ms/s" }'
    text = f'[sources]\n{said}\n[channels]\n"suspension.fl.travel" = "A"\n"suspension.fr.travel" = "{name}"'
    run = mapped_run([one, other], ChannelMap.parse(HEAD + text))
    signal = run.signals["suspension.fr.travel"]
    np.testing.assert_allclose(signal.values[:, 0], np.cos(signal.t), atol=1e-6)
    assert not any("one clock" in problem for problem in run.problems)
    without = ChannelMap.parse(HEAD + text.replace(', delay = "0.4 s", drift = "10 ms/s"', ""))
    assert any("unless the map says a delay" in problem for problem in mapped_run([one, other], without).problems)


def test_no_channel_at_all_is_refused_with_the_way_out(tmp_path: Path) -> None:
    file = table(tmp_path / "a.csv", t=T, LatAcc=T)
    with pytest.raises(
        RunError, match=r"there is no 'LatAc'; did you mean 'LatAcc'\?; the file has(.|\n)*lacet map --guess"
    ):
        made(file, '[channels]\n"car.lateral_accel" = "LatAc"')


def test_a_map_beside_the_file_is_used_and_one_is_asked_for_otherwise(tmp_path: Path) -> None:
    file = table(tmp_path / "a.csv", t=T, A=T)
    with pytest.raises(RunError, match="lacet map --guess"):
        open_run(file)
    (tmp_path / "map.toml").write_text(HEAD + '[channels]\n"car.speed" = "A"\n')
    assert list(open_run(file).signals) == ["car.speed"]
    own = table(tmp_path / "own.csv", t=T, **{"laser.fl.hub": T})
    assert list(open_run(own).signals) == ["laser.fl.hub"]


def test_times_that_go_back_are_left_out_and_counted(tmp_path: Path) -> None:
    t = T.copy()
    t[50] = 0.1
    run = made(table(tmp_path / "a.csv", t=t, A=T), '[channels]\n"car.speed" = { from = "A", unit = "m/s" }')
    assert len(run.signals["car.speed"].t) == len(T) - 1
    (said,) = (problem for problem in run.problems if "1 samples have a time that does not increase" in problem)
    assert re.search(rf"after {T[49]:.2f} s it steps back by {T[49] - 0.1:.6g} s: a clock that was set back", said)


def test_a_channel_of_two_names_without_one_usable_time_is_left_out(tmp_path: Path) -> None:
    file = table(tmp_path / "a.csv", t=T, own=np.full(len(T), np.nan), A=T, B=T, C=T)
    run = made(file, """
[sources]
A = { unit = "m", time = "own" }
B = { unit = "m", time = "own" }
C = "m/s"
own = "s"
[channels]
"suspension.fr.travel" = "A + B"
"car.speed" = "C"
""")  # fmt: skip
    assert list(run.signals) == ["car.speed"]
    assert f"own: {len(T)} samples have a time that does not increase and are left out" in run.problems
