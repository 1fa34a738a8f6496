"""A driver of the user's own: the page's example, run only from beside a rig that is named, and only after trust."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from lacet.daq.errors import FileFault, RigError, UsageError
from lacet.daq.formats.log import LogReader
from lacet.daq.formats.open_run import open_run
from lacet.daq.frames import Frames
from lacet.daq.rig import Rig
from lacet.services.acquisition.own_drivers import own_drivers, trust_file
from lacet.services.acquisition.stream_decoder import Decoder
from lacet.services.commands.__main__ import main
from lacet.services.workbench.uploads import _TOML
from tests.drivers.driver_cases import decode_all, decode_split, same_blocks
from tests.support.places import HOME
from tests.support.rig import T0, write_capture

PAGE = (HOME / "docs/own-driver.md").read_text(encoding="utf-8")
BLOCKS = dict(re.findall(r"^```(?:python|toml) (\S+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))
STREAM = b"L 1.0\r\nFL 12.34\r\nFR -3.50\r\nnoise\r\nRL 1.0\r\nRR 2.25\r\nFL 13.00\r\nFL 1"


@pytest.fixture
def car(tmp_path, monkeypatch) -> Path:
    """The page's files in a folder, a capture beside them, and a configuration folder of its own."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    (tmp_path / "car/drivers").mkdir(parents=True)
    for name, text in BLOCKS.items():
        (tmp_path / "car" / name).write_text(text, encoding="utf-8")
    reads = [STREAM[i : i + 7] for i in range(0, len(STREAM), 7)]
    frames = Frames.from_iter("serial0", [("serial0", T0 + i * 10**6, 0, read) for i, read in enumerate(reads)])
    write_capture(tmp_path / "raw.mcap", Rig.load(tmp_path / "car/rig.toml"), {"serial0": frames})
    return tmp_path / "car"


def decoded(car: Path, *more: str) -> tuple[int, Path]:
    out = car / "run.mcap"
    return main(
        ["decode", str(car.parent / "raw.mcap"), "-o", str(out), "--rig", str(car / "rig.toml"), "--force", *more]
    ), out


def test_the_page_s_driver_has_about_forty_lines_and_decodes(car, capsys):
    assert set(BLOCKS) == {"drivers/draw_wire.py", "rig.toml"}
    assert len([line for line in BLOCKS["drivers/draw_wire.py"].splitlines() if line.strip()]) <= 40
    code, _ = decoded(car)
    assert code == 2
    assert re.search(
        r"car/drivers holds programs \(draw_wire.py\) that were not trusted yet.*--trust, once", capsys.readouterr().err
    )
    code, out = decoded(car, "--trust")
    assert code == 3  # two lines that are none are losses
    blocks = LogReader(out).blocks()
    np.testing.assert_allclose(blocks["suspension.fl.travel"].values[:, 0], [0.01234, 0.013])
    np.testing.assert_allclose(blocks["suspension.fr.travel"].values[:, 0], [-0.0035])
    assert blocks["suspension.fl.travel"].t_ns[0] == T0 + 10**6  # the read that held its first byte
    assert LogReader(out).start.documents["drivers/draw_wire.py"] == BLOCKS["drivers/draw_wire.py"]
    assert decoded(car)[0] == 3  # once is enough
    assert "bad line" in capsys.readouterr().out


def test_the_page_s_driver_does_not_depend_on_how_bytes_are_read(car):
    driver = own_drivers(Rig.load(car / "rig.toml"), trust=True).classes["draw_wire"]("serial0")
    whole, counts = decode_all(driver, Frames.from_iter("serial0", [("serial0", T0, 0, STREAM)]))
    single = Frames.from_iter("serial0", [("serial0", T0, 0, bytes([byte])) for byte in STREAM])
    for cuts in (range(1, len(STREAM)), range(0, len(STREAM), 5)):
        other, split_counts = decode_split(driver, single, cuts)
        same_blocks(whole, other)
        assert split_counts == counts
    assert counts == {"received": len(STREAM), "samples": 5, "bad_line": 2}


def test_lines_that_come_in_one_read_are_all_in_the_run(car):
    """Four sensors at 100 Hz on an adapter that hands over its bytes every 16 ms."""
    lines = [(10 * k, f"{corner} {k}.0\n".encode()) for k in range(200) for corner in ("FL", "FR", "RL", "RR")]
    reads = [
        ("serial0", T0 + 16 * n * 10**6, 0, b"".join(text for t, text in lines if 16 * (n - 1) < t <= 16 * n))
        for n in range(126)
    ]
    (car.parent / "raw.mcap").unlink()
    write_capture(
        car.parent / "raw.mcap", Rig.load(car / "rig.toml"),
        {"serial0": Frames.from_iter("serial0", [read for read in reads if read[3]])},
    )  # fmt: skip
    code, out = decoded(car, "--trust")
    assert code == 0
    run = open_run(out)
    for corner in ("fl", "fr", "rl", "rr"):
        signal = run.signals[f"suspension.{corner}.travel"]
        np.testing.assert_allclose(signal.values[:, 0], np.arange(200) / 1000.0)
        assert np.abs(np.diff(signal.t) - 0.01).max() < 0.01
    assert [line for line in run.problems if "samples that came together" in line and 'clock = "steady"' in line]


def test_changed_new_and_missing_files_ask_again(car, capsys):
    assert decoded(car, "--trust")[0] == 3
    file = car / "drivers/draw_wire.py"
    file.write_text(file.read_text() + "\n")
    (car / "drivers/other.py").write_text("")
    assert decoded(car)[0] == 2
    assert "is not as it was trusted (changed: draw_wire.py; new: other.py)" in capsys.readouterr().err
    assert decoded(car, "--trust")[0] == 3
    (car / "drivers/other.py").unlink()
    assert decoded(car)[0] == 2
    assert "(gone: other.py)" in capsys.readouterr().err
    # The same files elsewhere are another folder.
    assert list(json.loads(trust_file().read_text())["folders"]) == [str((car / "drivers").resolve())]
    trust_file().write_text("{}")
    with pytest.raises(FileFault, match=r"no list of trusted folders.*remove it"):
        own_drivers(Rig.load(car / "rig.toml"))


def test_nothing_is_run_before_trust_nor_from_a_log_the_bus_or_an_upload(car, capsys, tmp_path):
    (car / "drivers/draw_wire.py").write_text(
        f"open({str(tmp_path / 'ran')!r}, 'w')\n" + BLOCKS["drivers/draw_wire.py"]
    )
    decoded(car)
    rig = Rig.load(car / "rig.toml")
    with pytest.raises(UsageError, match=r"no driver 'draw_wire'.*found only with that rig file: --rig FILE"):
        Decoder(rig)
    uploaded = _TOML["rig.toml"](car / "rig.toml")
    assert uploaded.sensors[0].driver == "draw_wire"  # runs are read with it; nothing is decoded
    # Even trusted, the raw log alone runs nothing, though it holds the driver's text.
    assert not (tmp_path / "ran").exists()
    assert decoded(car, "--trust")[0] == 3
    (tmp_path / "ran").unlink()
    assert main(["decode", str(car / "run.mcap"), "-o", str(car / "again.mcap")]) == 2
    assert "found only with that rig file: --rig FILE" in capsys.readouterr().err
    assert not (tmp_path / "ran").exists()


def test_an_unknown_driver_is_refused_when_the_rig_is_loaded(car):
    text = BLOCKS["rig.toml"]
    (car / "rig.toml").write_text(text.replace("draw_wire", "draw_wires"))
    with pytest.raises(
        RigError,
        match=r"no driver is called 'draw_wires'; did you mean 'draw_wire'\? \(there are: correvit, dbc, dr",
    ):
        Rig.load(car / "rig.toml")
    (car / "rig.toml").write_text(text.replace("draw_wire", "igle"))
    with pytest.raises(RigError, match="did you mean 'igel'"):
        Rig.load(car / "rig.toml")
    assert Rig.load(car / "rig.toml", kept=True).sensors[0].driver == "igle"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("def broken(:\n", r"draw_wire.py, line 1: invalid syntax"),
        ("import nothing_of_that_name\n", r"draw_wire.py, line 1: ModuleNotFoundError: No module named 'nothing_of"),
        ("x = 1\n", "a driver is one class derived from .*, and it has no class"),
        (BLOCKS["drivers/draw_wire.py"].replace('name = "draw_wire"', 'name = "wire"'), "must say name = 'draw_wire'"),
    ],
)  # fmt: skip
def test_a_file_that_is_no_driver_is_refused_with_its_place(car, text, says):
    (car / "drivers/draw_wire.py").write_text(text)
    with pytest.raises(UsageError, match=says):
        own_drivers(Rig.load(car / "rig.toml"), trust=True)


def test_a_name_of_lacet_s_own_is_refused(car):
    (car / "drivers/igel.py").write_text("")
    (car / "rig.toml").write_text(BLOCKS["rig.toml"].replace("draw_wire", "igel"))
    with pytest.raises(UsageError, match=r"igel.py: 'igel' is a driver of lacet's; give yours another name"):
        own_drivers(Rig.load(car / "rig.toml"), trust=True)


def test_a_driver_that_fails_ends_its_own_sensor_and_nothing_else(car, capsys):
    """The file is written; with the driver corrected all is decoded again."""
    file = car / "drivers/draw_wire.py"
    good = file.read_text()
    file.write_text(good.replace("        found = {}\n", "        found = {}\n        frames.no_such_name\n"))
    code, *_ = decoded(car, "--trust", "--json", str(car / "out.json"))
    said = capsys.readouterr().out
    assert code == 3
    assert "sensor draw-wires: its driver failed and decoded nothing more: AttributeError" in said
    line = 1 + file.read_text().splitlines().index("        frames.no_such_name")
    assert f"(draw_wire.py, line {line})" in said
    failures = json.loads((car / "out.json").read_text())["failures"]
    assert list(failures) == ["draw-wires"]
    file.write_text(good)
    assert decoded(car, "--trust")[0] == 3
    assert "its driver failed" not in capsys.readouterr().out


def test_a_driver_that_fails_at_the_end_is_named_too(car, capsys):
    """No frame is unread then."""
    file = car / "drivers/draw_wire.py"
    end = "\n    def finish(self, state):\n        raise ValueError('no end')\n"
    file.write_text(
        file.read_text()
        .replace('"bad_line": 0}', '"skipped_bytes": 0}')
        .replace('bad_line": len', 'skipped_bytes": len')
        + end
    )
    assert decoded(car, "--trust")[0] == 3
    said = capsys.readouterr().out
    assert "sensor draw-wires: its driver failed and decoded nothing more: ValueError: no end" in said
    assert "0 lost" in said


def test_a_driver_that_cannot_count_is_named_too(car, capsys):
    """What it decoded before stays."""
    file = car / "drivers/draw_wire.py"
    file.write_text(file.read_text().replace("return dict(state[1])", "return dict(state[7])"))
    code, out = decoded(car, "--trust")
    assert code == 3
    assert "its driver failed and decoded nothing more: IndexError" in capsys.readouterr().out
    assert LogReader(out).blocks()["suspension.fl.travel"].values.shape == (2, 1)
