"""What a browser may not do: leave the folder, come from elsewhere, write too much, run code."""

from __future__ import annotations

import errno
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asammdf import MDF
from asammdf import Signal as MdfSignal
from fastapi.testclient import TestClient

from lacet.services.workbench import run_files, uploads
from lacet.services.workbench.access_guard import POLICY, cookie_name, new_token, user_token
from lacet.services.workbench.run_channels import RunChannels
from lacet.services.workbench.server import Settings, create_app, serve
from tests.services.workbench.bench_page import Page
from tests.support.rig import make_capture

HERE = "http://127.0.0.1:8765"


@pytest.fixture
def empty(tmp_path: Path) -> Iterator[TestClient]:
    """A server on a folder that is not there yet, which takes a kilobyte."""
    with TestClient(create_app(Settings(tmp_path / "new", most_upload=1000)), base_url=HERE) as client:
        yield client


@pytest.mark.parametrize("name", [
    "../escape.csv", "..%2Fescape.csv", "%2e%2e/escape.csv", "/etc/escape.csv", "a/b.csv", "..\\escape.csv",
    ".hidden.csv", "nul\0.csv".replace("\0", "%00"), "study.json", "effects.py", "run.exe", "x" * 300 + ".csv",
    "line%0Abreak.csv", "", "rough%E2%80%AEvsc.csv", "zero%E2%80%8Bwidth.csv",
    "isolated%E2%81%A6.csv", "tag%F3%A0%80%81.csv",
])  # fmt: skip
def test_a_name_never_leaves_the_folder(empty: TestClient, tmp_path: Path, name: str):
    answer = empty.put(f"/api/runs/{name}", content=b"t\n0\n")
    assert answer.status_code in (400, 404, 405)
    assert answer.json()["error"]
    assert not [p for p in tmp_path.rglob("*") if p.is_file()]


def test_a_question_that_is_not_sent_as_json_says_so(page: Page):
    answer = page.client.post("/api/jobs", content=b'{"do": "undo", "args": {}}')
    assert answer.status_code == 400
    said = answer.json()["error"]
    assert said.endswith("Send it as JSON: Content-Type: application/json")
    assert ": :" not in said
    wrong = page.client.post("/api/jobs", json={"args": 1})
    assert (wrong.status_code, "Content-Type" in wrong.text) == (400, False)


def test_another_host_name_or_origin_is_refused(page: Page):
    client = page.client
    for host in ("evil.example", "evil.example:8765", "127.0.0.1.evil.example", "192.168.1.7:8765", ""):
        assert client.get("/api/study", headers={"Host": host}).status_code == 403, host
    for host in ("localhost:8765", "127.0.0.1:8765", "[::1]:8765"):
        assert client.get("/api/study", headers={"Host": host}).status_code == 200, host
    body = {"do": "undo", "args": {}}
    for origin in ("https://evil.example", "http://127.0.0.1:9999", "null", "http://127.0.0.1:8765.evil.example"):
        assert client.post("/api/jobs", json=body, headers={"Origin": origin}).status_code == 403, origin
        assert client.put("/api/runs/a.csv", content=b"x", headers={"Origin": origin}).status_code == 403
        assert client.delete("/api/jobs/1", headers={"Origin": origin}).status_code == 403
    assert client.post("/api/jobs", json=body, headers={"Sec-Fetch-Site": "cross-site"}).status_code == 403
    assert not page.get("jobs")
    assert client.post("/api/jobs", json=body, headers={"Origin": HERE}).status_code == 200


def test_elsewhere_a_token_is_needed(tmp_path: Path):
    token = new_token()
    app = create_app(Settings(tmp_path, host="0.0.0.0", token=token))
    with TestClient(app, base_url="http://192.168.1.7:8765", follow_redirects=False) as client:
        assert client.get("/api/study").status_code == 401
        assert client.get("/").status_code == 401
        assert client.get("/?token=wrong").status_code == 401
        assert client.put("/api/runs/a.csv", content=b"x").status_code == 401
        assert client.get("/api/study", headers={"Cookie": f"{cookie_name('x:8765')}=wrong"}).status_code == 401
        assert client.get("/api/study", headers={"Host": "evil.example"}).status_code == 403
        opened = client.get(f"/?token={token}")
        assert opened.status_code == 303
        assert opened.headers["location"] == "/"
        assert {"HttpOnly", "SameSite=Strict"} <= set(opened.headers["set-cookie"].split("; "))
        assert client.get("/api/study").status_code == 200
    assert len(token) >= 32
    with pytest.raises(Exception, match="needs a token"):
        serve(Settings(tmp_path, host="0.0.0.0"))


def test_two_servers_of_a_machine_have_cookies_of_their_own(tmp_path: Path):
    tokens = new_token(), new_token()
    opened: list[str] = []
    for port, token in zip((8765, 8766), tokens, strict=True):
        app = create_app(Settings(tmp_path / str(port), token=token))
        base = f"http://127.0.0.1:{port}"
        with TestClient(app, base_url=base, follow_redirects=False) as client:
            opened.append(client.get(f"/?token={token}").headers["set-cookie"].split(";")[0])
            both = {"Cookie": "; ".join(opened)}
            assert client.get("/api/study", headers=both).status_code == 200, "the other server's cookie comes along"
    assert len({cookie.split("=")[0] for cookie in opened}) == 2


def test_the_users_token_stays_and_is_theirs_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    token = user_token()
    assert user_token() == token
    assert len(token) >= 32
    (file,) = tmp_path.rglob("ui-token")
    assert file.stat().st_mode & 0o077 == 0
    file.chmod(0o644)
    assert user_token() != token, "others may have read it"
    monkeypatch.setenv("XDG_STATE_HOME", str(file))  # no folder: a token all the same
    assert len(user_token()) >= 32


def test_a_page_may_load_nothing_from_elsewhere(page: Page):
    headers = page.client.get("/api/study").headers
    assert headers["content-security-policy"] == POLICY
    assert "unsafe" not in POLICY
    assert headers["x-content-type-options"] == "nosniff"
    assert not [name for name in headers if name.startswith("access-control")]
    assert page.client.get("/../server.py").status_code == 404
    assert page.client.get("/%2e%2e/server.py").status_code == 404


def test_an_upload_is_bounded(empty: TestClient, tmp_path: Path):
    assert empty.put("/api/runs/a.csv", content=b"x" * 1001).status_code == 413

    def trickle() -> Iterator[bytes]:
        yield from [b"x" * 400] * 3

    assert empty.put("/api/runs/a.csv", content=trickle()).status_code == 413  # without its length announced
    assert not [p for p in tmp_path.rglob("*") if p.is_file()]
    assert empty.put("/api/runs/a.csv", content=b"x" * 1000).status_code == 200


def test_a_full_disk_leaves_nothing(empty: TestClient, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def full(file: Any, data: bytes) -> None:
        file.write(data[:10])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(uploads, "write", full)
    answer = empty.put("/api/runs/a.csv", content=b"x" * 100)
    assert (answer.status_code, "disk is full" in answer.json()["error"]) == (507, True)
    monkeypatch.undo()
    monkeypatch.setattr(uploads, "free", lambda _: uploads.SPARE + 99)
    assert empty.put("/api/runs/a.csv", content=b"x" * 100).status_code == 507
    assert not [p for p in tmp_path.rglob("*") if p.is_file()]


def test_what_was_broken_off_is_swept_up(tmp_path: Path):
    runs = tmp_path / "new" / "runs"
    runs.mkdir(parents=True)
    old, fresh, run = runs / ".1.part.csv", runs / ".2.part.csv", runs / "a.part.csv"
    for file in (old, fresh, run):
        file.write_bytes(b"t\n")
    for file in (old, run):
        os.utime(file, (1.0, 1.0))
    with TestClient(create_app(Settings(tmp_path / "new")), base_url=HERE) as client:
        assert [r["file"] for r in client.get("/api/runs").json()] == ["a.part.csv"]
    assert sorted(p.name for p in runs.iterdir()) == [".2.part.csv", "a.part.csv"]


def test_nothing_is_replaced_unasked(page: Page):
    before = (page.folder / "runs" / "sine.parquet").read_bytes()
    for name in ("runs/sine.parquet", "runs/rig.toml"):
        assert "replace it in the list" in page.client.put(f"/api/{name}", content=b"x").json()["error"]
    assert (page.folder / "runs" / "sine.parquet").read_bytes() == before


def test_a_file_is_replaced_or_removed_with_what_follows_said_before(page: Page):
    """Nothing is erased; the study's versions stay readable, and its rig cannot be taken from it."""
    before = {
        name: (page.folder / name).read_bytes() for name in ("runs/sine.parquet", "runs/spare.parquet", "rig.toml")
    }
    assert page.get("runs/spare/consequences") == {
        "name": "spare", "files": ["spare.parquet"], "versions": [], "says": [], "may_remove": True,
    }  # fmt: skip
    found = page.get("runs/sine/consequences")
    assert found["versions"] == [1]
    assert "version 1 uses this run" in found["says"][0]
    assert "nothing more can be computed for it" in found["says"][0]
    assert "version 1 was fitted with the instruments" in page.get("runs/rig.toml/consequences")["says"][0]
    assert page.client.delete("/api/runs/rig.toml").status_code == 400
    assert (page.folder / "rig.toml").read_bytes() == before["rig.toml"]
    assert page.client.delete("/api/runs/spare").json() == {
        "removed": [Path(n).name for n in _removed(page)],
        "kept_in": "removed",
    }
    assert [(page.folder / name).read_bytes() for name in _removed(page)] == [before["runs/spare.parquet"]]
    assert {run["name"] for run in page.get("runs")} == {"sine", "rough"}
    text = before["rig.toml"] + b"\n# mended\n"
    assert page.client.put("/api/runs/rig.toml?replace=true", content=b"format = 'nonsense'\n").status_code == 400
    assert (page.folder / "rig.toml").read_bytes() == before["rig.toml"]
    assert page.client.put("/api/runs/rig.toml?replace=true", content=text).status_code == 200
    assert (page.folder / "rig.toml").read_bytes() == text
    other = (page.folder / "runs" / "rough.parquet").read_bytes()
    assert page.client.put("/api/runs/sine.parquet?replace=true", content=other).status_code == 200
    assert (page.folder / "runs" / "sine.parquet").read_bytes() == other
    kept = [(page.folder / name).read_bytes() for name in _removed(page)]
    assert sorted(kept) == sorted(before.values())
    assert page.client.delete("/api/runs/sine").status_code == 200
    assert page.get("study")["current"] == 1, "its numbers stay"
    assert page.client.delete("/api/runs/../study.json").status_code in (400, 404, 405)
    assert page.client.delete("/api/runs/nothing").status_code == 400


def _removed(page: Page) -> list[str]:
    return sorted(f"removed/{file.name}" for file in (page.folder / "removed").iterdir())


def test_a_capture_is_removed_with_the_run_decoded_from_it(tmp_path: Path):
    make_capture(tmp_path / "raw.mcap", 1.0, 47110)
    with TestClient(create_app(Settings(tmp_path / "new")), base_url=HERE) as client:
        page = Page(client)
        page.until_over(
            client.put("/api/runs/raw.mcap", content=(tmp_path / "raw.mcap").read_bytes()).json()["job"]["id"]
        )
        assert len(client.delete("/api/runs/raw").json()["removed"]) == 2
        assert page.get("runs") == []
    with TestClient(create_app(Settings(tmp_path / "new")), base_url=HERE) as client:
        assert client.get("/api/jobs").json() == [], "and is not decoded again"


def test_the_list_of_runs_is_there_before_they_are_read(page: Page, monkeypatch: pytest.MonkeyPatch):
    go = threading.Event()
    read = run_files.summary

    def slow(path: Path, kept: Any) -> dict[str, Any]:
        assert go.wait(30.0)
        return read(path, kept)

    monkeypatch.setattr(run_files, "summary", slow)
    found = page.get("runs?wait=false")
    assert {run["name"]: (run["quality"], run["role"]) for run in found} == {
        "sine": ("being read", "used"), "rough": ("being read", "held"), "spare": ("being read", "unused"),
    }  # fmt: skip
    go.set()
    end = time.monotonic() + 30.0
    whole = page.get("runs?wait=false")
    while {run["quality"] for run in whole} != {"good"}:
        assert time.monotonic() < end, whole
        time.sleep(0.05)
        whole = page.get("runs?wait=false")
    assert page.get("runs") == whole


def test_rig_and_vehicle_are_read_before_they_are_kept(empty: TestClient, tmp_path: Path):
    answer = empty.put("/api/runs/rig.toml", content=b"format = 'nonsense'\n")
    assert answer.status_code == 400
    assert "rig.toml" in answer.json()["error"]
    assert ".part" not in answer.json()["error"]
    assert not (tmp_path / "new" / "rig.toml").exists()


def test_a_map_may_come_after_its_file(tmp_path: Path):
    """An MDF file says what it lacks, and is read as soon as its map is there; so is what is told of a CSV table."""
    t = np.arange(500) / 250.0
    mdf = MDF(version="4.10")
    mdf.append([MdfSignal(0.3 + 0.01 * np.sin(t), t, name="Laser4", unit="m")])
    mdf.save(tmp_path / "drive.mf4", overwrite=True)
    mdf.close()
    with TestClient(create_app(Settings(tmp_path / "new")), base_url=HERE) as client:
        content = (tmp_path / "drive.mf4").read_bytes()
        assert client.put("/api/runs/drive.mf4", content=content).json()["name"] == "drive"
        (before,) = client.get("/api/runs").json()
        assert before["quality"] == "cannot be read"
        assert "mf4.toml" in before["says"][0]
        wrong = client.put(
            "/api/runs/mf4.toml", content=b'format = "lacet-mf4 1"\n[channels]\nlaser.rr.hob = "Laser4"\n'
        )
        assert wrong.status_code == 400
        assert "laser.rr.hub" in wrong.json()["error"]
        right = b'format = "lacet-mf4 1"\n[channels]\nlaser.rr.hub = "Laser4"\n'
        assert client.put("/api/runs/mf4.toml", content=right).status_code == 200
        (after,) = client.get("/api/runs").json()
        assert (after["format"], after["channels"]) == ("mf4", 1)
        assert client.put("/api/runs/table.csv", content=b"t,laser.rr.hub\n0,0.3\n0.004,0.3\n").status_code == 200
        assert client.put("/api/runs/table.json", content=b'{"manoeuver": "slalom"}').status_code == 400
        assert client.get("/api/runs/table").json()["manoeuvre"] == ""
        assert client.put("/api/runs/table.json", content=b'{"manoeuvre": "slalom"}').status_code == 200
        assert client.get("/api/runs/table").json()["manoeuvre"] == "slalom"


def test_a_raw_capture_is_decoded(tmp_path: Path):
    make_capture(tmp_path / "raw.mcap", 1.0, 47110)
    with TestClient(create_app(Settings(tmp_path / "new")), base_url=HERE) as client:
        answer = client.put("/api/runs/raw.mcap", content=(tmp_path / "raw.mcap").read_bytes()).json()
        assert answer["raw"]
        while (job := client.get(f"/api/jobs/{answer['job']['id']}").json())["state"] in ("waiting", "running"):
            time.sleep(0.02)
        assert job["state"] == "done", job
        (run,) = client.get("/api/runs").json()
        assert (run["file"], run["role"], run["format"]) == ("raw.mcap", "unused", "mcap")
        assert run["channels"] > 10
    assert (tmp_path / "new" / "raw" / "raw.mcap").read_bytes() == (tmp_path / "raw.mcap").read_bytes()


def test_a_capture_whose_decoding_was_broken_off_is_no_dead_end(tmp_path: Path):
    """Killed while decoding: the next server decodes it. Decoding cancelled: it is listed, and dropped in again."""
    new = tmp_path / "new"
    (new / "raw").mkdir(parents=True)
    make_capture(new / "raw" / "raw.mcap", 1.0, 47110)
    content = (new / "raw" / "raw.mcap").read_bytes()
    with TestClient(create_app(Settings(new)), base_url=HERE) as client:
        page = Page(client)
        (job,) = page.get("jobs")
        assert page.until_over(job["id"])["state"] == "done"
        assert [r["quality"] for r in page.get("runs")] == ["good"]
        assert client.put("/api/runs/raw.mcap", content=content).status_code == 409  # decoded: nothing to do again
        (new / "runs" / "raw.mcap").unlink()
        (run,) = page.get("runs")
        assert (run["name"], run["quality"]) == ("raw.mcap", "cannot be read")
        assert "drop it here again" in run["says"][0]
        assert client.put("/api/runs/raw.mcap", content=content[:-9000]).status_code == 409  # another: not replaced
        answer = client.put("/api/runs/raw.mcap", content=content).json()
        assert page.until_over(answer["job"]["id"])["state"] == "done"
        assert [r["name"] for r in page.get("runs")] == ["raw"]
    assert (new / "raw" / "raw.mcap").read_bytes() == content


@pytest.mark.parametrize(("line", "word"), [
    ("suspension: p * __import__('os').system('touch /tmp/x')", ""),
    ("suspension: p * travel ** travl", "travl"),
    ("suspension: p * travel + q", ""),
    ("nowhere: p * travel", "nowhere"),
    ("suspension: p * (travel", ""),
])  # fmt: skip
def test_a_line_is_read_and_never_run(page: Page, line: str, word: str):
    found = page.post("effect/check", {"name": "bump", "line": line})
    if not found["ok"]:
        assert found["error"]
        assert word in line[found["at"] : found["until"]]
    assert page.post("effect", {"name": "bump", "line": line + "\nimport os"}, 400)["error"]
    assert not (page.folder / "effects" / "lines.txt").exists()


def test_a_line_is_kept_and_in_the_catalogue(page: Page):
    line = "suspension: p * travel**2 * sign(rate)"
    checked = page.post("effect/check", {"name": "bump", "line": line})
    assert checked["ok"]
    assert checked["parameters"][0]["unit"] == "N/m²"
    assert not (page.folder / "effects" / "lines.txt").exists()
    kept = page.post("effect", {"name": "bump", "line": line})
    assert kept["line"] == f"bump = {line}"
    acts = {item["effect"]: item["acts_on"] for item in kept["tried"]}
    assert acts["bump.front"] == ["suspension.fl", "suspension.fr"]
    assert acts["bump.rl"] == ["suspension.rl"]
    assert kept["tells"] == "tried on sine.parquet: acts, with finite values"
    own = [e for e in page.get("effects")["effects"] if e["own"]]
    assert {e["effect"] for e in own} >= {"bump.front", "bump.rear"}
    assert not page.post("effect/check", {"name": "anti_roll_bar", "line": line})["ok"]


def test_a_line_without_finite_values_is_not_kept(page: Page):
    line = "suspension: p * log(travel/1 m)"
    assert page.post("effect/check", {"name": "bump", "line": line})["ok"]
    said = page.post("effect", {"name": "bump", "line": line}, 400)["error"]
    assert "no finite value in suspension.fl at t = " in said
    assert not (page.folder / "effects" / "lines.txt").exists()


def test_a_line_is_kept_untried_while_a_job_is_at_work(page: Page, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("lacet.services.workbench.user_effects.WAIT", 0.05)
    app: Any = page.client.app
    with app.state.bench.cache.computing():
        kept = page.post("effect", {"name": "bump", "line": "suspension: p * travel**2"})
    assert kept["tried"] == []
    assert kept["tells"] == "not tried on a run yet: lacet is at work on something else"
    assert page.post("effect", {"name": "bump", "line": "suspension: p * travel**3"})["tried"]


def test_a_question_that_cannot_be_read_is_answered(page: Page):
    client = page.client
    assert client.post("/api/jobs", content=b"{", headers={"Content-Type": "application/json"}).status_code == 400
    assert client.post("/api/jobs", json=[1]).status_code == 400
    assert page.post("jobs", {"do": "format"}, 400)["error"].startswith("there is no job 'format'")
    assert page.post("jobs", {"do": "undo", "args": [1]}, 400)["error"]
    for do, args in (("add", {}), ("goto", {"version": "2"}), ("choose", {"used": "sine"}), ("choose", {"used": []}),
                     ("choose", {"used": ["../../etc/passwd"]}), ("decode", {"file": "../study.json"}),
                     ("add", {"effect": "coulomb.rear", "shape": {"v": "1"}})):  # fmt: skip
        job = page.until_over(page.start(do, **args))
        assert job["state"] == "failed", (do, args)
        assert "lacet itself" not in job["error"]


@pytest.mark.parametrize("kind", ["vehicle", "rig"])
def test_a_car_s_file_of_another_name_is_told_its_name(empty: TestClient, tmp_path: Path, kind: str):
    answer = empty.put("/api/runs/pickup.toml", content=f'format = "lacet-{kind} 1"\nname = "pickup"\n'.encode())
    assert answer.status_code == 400
    assert (
        f"pickup.toml: is no channel map but a lacet-{kind} file: give it the name {kind}.toml"
        in answer.json()["error"]
    )
    assert not any(tmp_path.rglob("pickup.toml"))


def test_a_run_that_is_gone_is_said_to_be_and_no_log_of_another_system(tmp_path: Path):
    for name in ("gone.mcap", "gone.csv"):
        found = run_files.summary(tmp_path / name, RunChannels(tmp_path))
        assert found["quality"] == "cannot be read"
        assert found["says"] == ["there is no such file: put it back, or open the study in the folder of its runs"]
