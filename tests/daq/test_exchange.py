"""Exchange tables: what is written is read again; whatever is wrong is said, flagged or refused with the remedy."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lacet.daq.angles import ContinuousAngle
from lacet.daq.blocks import Flag
from lacet.daq.channels import CHANNELS, COLUMNS
from lacet.daq.errors import RunError
from lacet.daq.formats.exchange import SUFFIXES, read_table, write_table
from lacet.daq.formats.open_run import open_run
from lacet.daq.run import METADATA_KEYS, Run, Signal, signal_of
from tests.support.places import HOME

CAR = HOME / "tests" / "data" / "car"


@st.composite
def runs(draw: st.DrawFn) -> Run:
    """A run with some channels on one time base, some samples missing, and metadata."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    names = draw(st.lists(st.sampled_from(sorted(CHANNELS)), min_size=1, max_size=5, unique=True))
    n = draw(st.integers(2, 30))
    t = np.cumsum(rng.uniform(1e-4, 0.1, n)) + draw(st.floats(-10, 1e4))
    signals = {}
    for name in names:
        values = rng.uniform(-3, 3, (n, CHANNELS[name].width))
        values[rng.random(n) < draw(st.sampled_from([0.0, 0.2]))] = np.nan
        signals[name] = signal_of(name, t, values)
    text = st.text(st.characters(codec="utf-8", exclude_categories=("Cs", "Cc")), max_size=12)
    return Run(
        "r",
        signals,
        vehicle=draw(text),
        manoeuvre=draw(text),
        rig=draw(text),
        notes=draw(text),
        wheel_reference=draw(st.sampled_from(["", "hub", "contact"])),
        brakes=draw(st.sampled_from(["off", "used", "unknown"])),
    )


@settings(deadline=None, max_examples=60)
@given(runs(), st.sampled_from(SUFFIXES))
def test_round_trip(tmp_path_factory: pytest.TempPathFactory, run: Run, suffix: str) -> None:
    """Stamps, values, flags and metadata come back, by both formats, to the last digit."""
    file = tmp_path_factory.mktemp("t") / f"r{suffix}"
    write_table(run, file)
    back = open_run(file)
    assert back.problems == ()
    assert back.signals.keys() == run.signals.keys()
    for name, one in run.signals.items():
        two = back.signals[name]
        np.testing.assert_array_equal(two.t, one.t)
        np.testing.assert_array_equal(two.values[one.usable], one.values[one.usable])
        np.testing.assert_array_equal(two.usable, one.usable)
        assert np.all(two.flags[~one.usable] == int(Flag.MISSING))
    for key in METADATA_KEYS:
        assert getattr(back, key) == getattr(run, key)


@settings(deadline=None, max_examples=40)
@given(st.lists(st.floats(-20, 20), min_size=2, max_size=40), st.sampled_from(["wheel.fl.angle", "imu.attitude"]))
def test_angles_are_unwrapped(steps: list[float], channel: str) -> None:
    """Whatever turns were cut off, neighbouring samples are at most half a turn apart, and full turns were added."""
    raw = np.angle(np.exp(1j * np.cumsum(steps)))
    values = np.repeat(raw[:, None], CHANNELS[channel].width, axis=1)
    out = signal_of(channel, np.arange(len(raw)) * 0.1, values).values
    assert np.all(np.abs(np.diff(out, axis=0)) <= np.pi + 1e-9)
    turns = (out - values) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.rint(turns), atol=1e-9)


@pytest.mark.parametrize("pieces", [1, 7])
def test_an_angle_that_counts_its_turns_is_believed(pieces: int) -> None:
    """More than half a turn between samples, and a pause of two seconds; a damaged sample of another is no turn."""
    t = np.delete(np.arange(400) / 20.0, slice(150, 190))
    counted = np.column_stack([80.0 * t, np.angle(np.exp(10j * t))])
    counted[60, 1] = 300.0
    angle = ContinuousAngle()
    out = np.concatenate([angle.add(piece) for piece in np.array_split(counted, pieces)])
    np.testing.assert_array_equal(out[:, 0], counted[:, 0])
    off = (out[:, 1] - 10.0 * t) / (2 * np.pi)
    whole = np.delete(off, 60)
    np.testing.assert_allclose(whole, np.rint(whole), atol=1e-9)
    assert np.all(np.abs(np.diff(np.delete(out[:, 1], slice(59, 62))[:140])) < np.pi)
    np.testing.assert_array_equal(signal_of("wheel.fl.angle", t, counted[:, :1]).values, counted[:, :1])


def table(**columns: list[float]) -> dict[str, list[float]]:
    """A small table: `t`, one whole channel, and what a test adds (None takes a column out)."""
    out: dict[str, list[float]] = {"t": [0.0, 0.1, 0.2, 0.3], "laser.fl.hub": [1.0, 2.0, 3.0, 4.0], **columns}
    return {k.replace("__", "."): v for k, v in out.items() if v is not None}


def written(tmp_path: Path, columns: dict, suffix: str, metadata: dict | None = None) -> Path:
    """A table file made without `write_table`."""
    file = tmp_path / f"x{suffix}"
    made = pa.table(columns)
    if suffix == ".csv":
        pa_csv.write_csv(made, file)
        if metadata is not None:
            file.with_suffix(".json").write_text(json.dumps(metadata), encoding="utf-8")
    else:
        meta = None if metadata is None else {"lacet": json.dumps(metadata)}
        pq.write_table(made.replace_schema_metadata(meta), file)
    return file


@pytest.mark.parametrize("suffix", SUFFIXES)
class TestFaults:
    """Each fault in both formats."""

    def test_an_unknown_column_is_said_and_left_out(self, tmp_path: Path, suffix: str) -> None:
        """With the nearest known one."""
        run = read_table(written(tmp_path, table(laser__fl__hubb=[1.0] * 4), suffix))
        assert set(run.signals) == {"laser.fl.hub"}
        assert any("laser.fl.hubb" in p and "did you mean 'laser.fl.hub'" in p for p in run.problems)

    def test_a_vector_without_one_component_is_left_out(self, tmp_path: Path, suffix: str) -> None:
        """Which one is missing is said."""
        made = {f"imu.rate.{k}": [0.0] * 4 for k in "xz"}
        run = read_table(written(tmp_path, {**table(), **made}, suffix))
        assert "imu.rate" not in run.signals
        assert any("imu.rate was left out: imu.rate.y missing" in p for p in run.problems)

    def test_missing_values_are_flagged(self, tmp_path: Path, suffix: str) -> None:
        """NaN and infinity alike, and nothing else is."""
        run = read_table(written(tmp_path, table(laser__fl__hub=[1.0, np.nan, np.inf, 4.0]), suffix))
        one = run.signals["laser.fl.hub"]
        np.testing.assert_array_equal(one.usable, [True, False, False, True])
        assert set(one.flags[1:3]) == {int(Flag.MISSING)}

    def test_stamps_that_do_not_increase_are_left_out(self, tmp_path: Path, suffix: str) -> None:
        """The rows that go back, stand still, or have no stamp, until time is ahead again."""
        t = [0.0, 0.2, 0.1, 0.2, np.nan, 0.3]
        run = read_table(written(tmp_path, {"t": t, "laser.fl.hub": [1.0, 2, 3, 4, 5, 6]}, suffix))
        np.testing.assert_array_equal(run.signals["laser.fl.hub"].t, [0.0, 0.2, 0.3])
        np.testing.assert_array_equal(run.signals["laser.fl.hub"].values[:, 0], [1.0, 2.0, 6.0])
        assert any("3 rows have a time that does not increase (first: row 3)" in p for p in run.problems)
        np.testing.assert_array_equal(run.signals["laser.fl.hub"].flags, [0, 0, Flag.CLOCK])

    def test_rows_that_come_twice_leave_the_rest_usable(self, tmp_path: Path, suffix: str) -> None:
        """One row in twenty twice, and stamps that are missing: the clock goes on, and each time is there once."""
        rows = np.sort(np.concatenate([np.arange(2000), np.arange(0, 2000, 20)]))
        t = 0.004 * rows
        t[np.arange(50, 2000, 211)] = np.nan
        run = read_table(written(tmp_path, {"t": t, "laser.fl.hub": 0.3 + 1e-4 * rows}, suffix))
        one = run.signals["laser.fl.hub"]
        assert one.usable.all()
        assert len(one.t) > 1980
        assert any("rows have a time that does not increase" in p and "left out" in p for p in run.problems)

    @pytest.mark.parametrize("back", [0, 25])
    def test_a_clock_that_stands_or_is_set_back_is_flagged_where_it_goes_on(
        self, tmp_path: Path, suffix: str, back: int
    ) -> None:
        """Tens of rows have no time of their own, so that the samples on both sides are not consecutive."""
        ticks = np.arange(1000)
        ticks[500:] = ticks[500:] - back if back else np.maximum(ticks[500:] - 30, 499)
        run = read_table(written(tmp_path, {"t": 0.004 * ticks, "laser.fl.hub": 0.3 + 1e-4 * np.arange(1000)}, suffix))
        one = run.signals["laser.fl.hub"]
        (flagged,) = np.flatnonzero(~one.usable)
        assert one.t[flagged] == pytest.approx(0.004 * 500)
        assert one.flags[flagged] == Flag.CLOCK

    @pytest.mark.parametrize(
        ("columns", "message"),
        [
            ({"time": [0.0, 1.0], "laser.fl.hub": [0.0, 1.0]}, "no column 't'"),
            ({"t": [1.0, 1.0], "laser.fl.hub": [0.0, 1.0]}, "fewer than two rows"),
            ({"t": [0.0, 1.0], "speed": [0.0, 1.0]}, "no column is a channel"),
        ],
    )
    def test_what_cannot_be_used_is_refused(
        self, tmp_path: Path, suffix: str, columns: dict[str, list[float]], message: str
    ) -> None:
        """Nothing usable: an error, not an empty run."""
        with pytest.raises(RunError, match=message):
            open_run(written(tmp_path, columns, suffix))

    def test_metadata(self, tmp_path: Path, suffix: str) -> None:
        """Known words are checked, unknown keys said, defaults filled in."""
        run = read_table(written(tmp_path, table(), suffix, {"brakes": "off", "vehicel": "x"}))
        assert run.brakes == "off"
        assert any("vehicel" in p and "did you mean 'vehicle'" in p for p in run.problems)
        assert read_table(written(tmp_path, table(), suffix, {})).brakes == "unknown"
        for wrong, words in (
            ({"brakes": "on"}, "off, used or unknown"),
            ({"wheel_reference": "rim"}, "contact or hub"),
        ):
            with pytest.raises(RunError, match=words):
                read_table(written(tmp_path, table(), suffix, wrong))

    def test_a_truncated_file_says_so(self, tmp_path: Path, suffix: str) -> None:
        """A file cut short is never half a run without a word."""
        run = open_run(CAR / "sine.parquet")
        whole = tmp_path / f"whole{suffix}"
        if suffix == ".parquet":
            shutil.copy(CAR / "sine.parquet", whole)
        else:
            write_table(run, whole)
        data = whole.read_bytes()
        for part in (0, 3, len(data) // 2, len(data) - 5):
            cut = tmp_path / f"cut{suffix}"
            cut.write_bytes(data[:part])
            if suffix == ".parquet" or part < 4:
                with pytest.raises(RunError, match=r"truncated|fewer than two rows|no column"):
                    open_run(cut)
                continue
            found = open_run(cut)
            assert any("cut short" in problem for problem in found.problems)
            n = len(found.signals["imu.rate"].t)
            assert n < len(run.signals["imu.rate"].t)
            assert n >= part / len(data) * len(run.signals["imu.rate"].t) - 50
            for name, one in found.signals.items():
                np.testing.assert_array_equal(one.values, run.signals[name].values[:n])

    def test_words_in_a_column_of_numbers(self, tmp_path: Path, suffix: str) -> None:
        """The column is left out and named; the rest is read."""
        run = read_table(written(tmp_path, {**table(), "correvit.speed.x": ["a", "b", "c", "d"]}, suffix))
        assert any("'correvit.speed.x' is not numbers" in p for p in run.problems)
        assert "laser.fl.hub" in run.signals

    def test_a_word_among_numbers_counts_as_missing(self, tmp_path: Path, suffix: str) -> None:
        """That cell is named; the column's others are read."""
        run = read_table(written(tmp_path, {**table(), "laser.fr.hub": ["1.5", " +2e0", "ERR", "4"]}, suffix))
        assert any("'laser.fr.hub' has 1 cell that is no number" in p and "'ERR'" in p for p in run.problems)
        np.testing.assert_array_equal(run.signals["laser.fr.hub"].values[:, 0], [1.5, 2.0, np.nan, 4.0])

    def test_different_stamps_are_not_written(self, tmp_path: Path, suffix: str) -> None:
        """One table has one time base: resample first; nothing to write is refused too."""
        flags = np.zeros(3, np.uint8)
        one = Signal(np.array([0.0, 0.1, 0.2]), np.zeros((3, 1)), flags)
        other = Signal(np.array([0.0, 0.1, 0.3]), np.zeros((3, 1)), flags)
        for signals in ({"laser.fl.hub": one, "laser.fr.hub": other}, {}):
            with pytest.raises(RunError, match="one common time base"):
                write_table(Run("r", signals), tmp_path / f"r{suffix}")
            assert not (tmp_path / f"r{suffix}").exists()


def test_broken_metadata_is_said(tmp_path: Path) -> None:
    """A JSON file beside a CSV that is no object."""
    file = written(tmp_path, table(), ".csv")
    for text in ("{", "[1]"):
        file.with_suffix(".json").write_text(text, encoding="utf-8")
        assert any("metadata" in p for p in read_table(file).problems)


def test_unknown_kinds_of_files(tmp_path: Path) -> None:
    """What is not there, and what is no table."""
    with pytest.raises(RunError, match="no such file"):
        open_run(tmp_path / "no.parquet")
    (tmp_path / "a.xls").write_text("x")
    with pytest.raises(RunError, match="unknown kind of file"):
        open_run(tmp_path / "a.xls")
    with pytest.raises(RunError, match="an exchange table ends in"):
        write_table(Run("r", {}), tmp_path / "a.xls")


def test_the_vocabulary_is_consistent() -> None:
    """Every column belongs to one channel; names, families, corners and widths agree."""
    assert len(COLUMNS) == sum(channel.width for channel in CHANNELS.values())
    for name, channel in CHANNELS.items():
        corner = f".{channel.corner}." if channel.corner else None
        assert channel.family == (name.replace(corner, ".") if corner else name)
        assert len(channel.columns) == channel.width
        for k, column in enumerate(channel.columns):
            assert COLUMNS[column] == (channel, k)


def test_the_reference_runs_have_every_channel() -> None:
    """30 s at 250 Hz, all channels of the vocabulary that the readme promises, nothing wrong."""
    for name in ("sine", "sweep", "liftoff", "rough"):
        run = open_run(CAR / f"{name}.parquet")
        assert run.problems == ()
        assert run.missing == ()
        assert run.duration == pytest.approx(30.0, abs=0.1)


@pytest.mark.parametrize(("separator", "decimal"), [(",", "."), (";", "."), (";", ","), ("\t", ","), ("\t", ".")])
def test_tables_as_spreadsheets_write_them(tmp_path: Path, separator: str, decimal: str) -> None:
    """Semicolons or tabs, with a comma or a point; an empty cell is a missing sample."""
    lines = [["t", "laser.fl.hub", "laser.fr.hub"], ["0.0", "1.5", ""], ["0.1", "-2.25", "3"], ["0.2", "1e-3", "4.5"]]
    text = "".join(separator.join(line) + "\n" for line in lines[1:]).replace(".", decimal)
    file = tmp_path / "run.csv"
    file.write_text(separator.join(lines[0]) + "\n" + text, encoding="utf-8")
    run = read_table(file)
    assert run.problems == ()
    np.testing.assert_array_equal(run.signals["laser.fl.hub"].values[:, 0], [1.5, -2.25, 1e-3])
    assert list(run.signals["laser.fr.hub"].usable) == [False, True, True]


def test_two_columns_of_one_name_are_refused(tmp_path: Path) -> None:
    """Which of them is meant is not guessed."""
    file = tmp_path / "run.csv"
    file.write_text("t,laser.fl.hub,laser.fl.hub\n0,1,2\n1,2,3\n", encoding="utf-8")
    with pytest.raises(RunError, match=r"laser\.fl\.hub: more than one column of that name"):
        read_table(file)


def test_files_that_a_table_names_are_looked_for_beside_it(tmp_path: Path) -> None:
    """Else the name stays as it is: of a file from where lacet is run, or of one that is shipped."""
    (tmp_path / "runs").mkdir()
    (tmp_path / "rig.toml").write_text("", encoding="utf-8")
    file = tmp_path / "runs" / "run.csv"
    file.write_text("t,laser.fl.hub\n0,1\n1,2\n", encoding="utf-8")
    named = {"rig": "../rig.toml", "vehicle": "v" * 5000}
    file.with_suffix(".json").write_text(json.dumps(named), encoding="utf-8")
    run = read_table(file)
    assert Path(run.rig).samefile(tmp_path / "rig.toml")
    assert run.vehicle == named["vehicle"]


def test_a_table_is_read_without_pandas():
    """It takes a second to load, which the first listing of runs would wait for."""
    code = (
        "import sys; from pathlib import Path; from lacet.daq.formats.exchange import read_table; "
        f"read_table(Path({str(CAR / 'sine.parquet')!r})); sys.exit('pandas' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=HOME, check=False).returncode == 0


@pytest.mark.filterwarnings("error")
def test_a_table_in_latin_1_is_read_and_what_is_cut_in_it_reported(tmp_path: Path):
    """A degree sign of one byte in the name of a column of another system, and in a line that is cut short."""
    path = tmp_path / "run.csv"
    lines = ["t,car.speed,angle [°]", *(f"{k / 100:.2f},{20 + k / 100:.2f},{k}" for k in range(300)), "3.00,°"]
    path.write_bytes("\n".join(lines).encode("latin-1"))
    run = read_table(path)
    assert len(run.signals["car.speed"].t) == 300
    assert any("angle [°]" in line for line in run.problems)
    assert any("1 lines are not whole" in line for line in run.problems)
