"""Jobs on a study: versions made, gone back from, chosen anew; cancelled; another writer beside the page."""

from __future__ import annotations

import json
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from lacet.daq.errors import UsageError
from lacet.daq.formats.open_run import open_run
from lacet.services.commands.__main__ import main
from lacet.services.progress import ServiceStage, ServiceStep
from lacet.services.render.html import details
from lacet.services.render.html import page as html_page
from lacet.services.workbench.events import Events, state_of
from lacet.services.workbench.jobs import JobProgress, Jobs
from lacet.services.workbench.server import Settings, create_app
from lacet.services.workbench.session_cache import SessionCache
from lacet.services.workspace.kept.kept_values import KeptValues
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study
from tests.services.workbench.bench_page import Page
from tests.support.tables import CAR, piece, written


def test_the_whole_story(page: Page):
    assert page.get("compare/1", 202)["needs"] == "compare"
    added = page.run("add", effect="anti_roll_bar.front")
    assert added["version"] == 2
    assert added["used"]["after"] < added["used"]["before"]
    assert page.get("compare/2")["effects"] == {"anti_roll_bar.front": {}}  # made with the version
    found = page.get("study")
    assert found["current"] == 2
    assert [v["parent"] for v in found["versions"]] == [0, 1]
    page.run("undo")
    assert page.get("study")["current"] == 1
    page.run("goto", version=2)
    assert page.run("remove", effect="anti_roll_bar.front")["version"] == 3
    assert page.get("study")["versions"][2]["used_error"] == page.get("study")["versions"][0]["used_error"]
    before = [p for p in page.get("parameters?version=2")["parameters"] if p["before"][0]["other"]]
    assert before[0]["before"][0]["version"] == 1
    sheet = {p["name"]: p["half95_sheet"] for p in page.get("parameters?version=1")["parameters"]}
    assert all(p["before"][0]["other"]["half95_sheet"] == sheet[p["name"]] for p in before), "rounded by it"


def test_runs_chosen_anew_are_a_new_version_with_the_same_effects(page: Page):
    page.run("add", effect="anti_roll_bar.front")
    page.run("choose", used=["rough", "spare"], held=["sine"])
    found = page.get("study")
    assert [Path(p).name for p in found["used"]] == ["rough.parquet", "spare.parquet"]
    assert [v["runs_differ"] for v in found["versions"]] == [True, True, False]
    assert found["versions"][2]["effects"] == {"anti_roll_bar.front": {}}
    assert {r["name"]: r["role"] for r in page.get("runs")} == {"rough": "used", "spare": "used", "sine": "held"}
    # A version on other runs is still compared with its own.
    assert [r["name"] for r in page.run("compare", version=2)["runs"]] == ["sine", "rough"]
    page.run("undo")
    found = page.get("study")
    assert (found["current"], [Path(p).name for p in found["used"]]) == (2, ["sine.parquet"])
    assert Study.open(page.folder).go_to(3).used == ("runs/rough.parquet", "runs/spare.parquet")


def test_versions_from_before_runs_could_be_chosen_keep_theirs(page: Page):
    file = page.folder / "versions" / "001.json"
    body = json.loads(file.read_text(encoding="utf-8"))
    del body["used"], body["held"]
    file.write_text(json.dumps(body), encoding="utf-8")
    page.run("choose", used=["spare"], held=[])
    page.run("goto", version=1)
    study = Study.open(page.folder)
    assert (study.used, study.held) == (("runs/sine.parquet",), ("runs/rough.parquet",))


def test_a_study_is_made_from_files_dropped_in(tmp_path: Path):
    run = written(piece("sine", 5.0, 11.0), tmp_path / "sine.parquet")
    with TestClient(create_app(Settings(tmp_path / "new", draws=19)), base_url="http://127.0.0.1:8765") as client:
        page = Page(client)
        assert page.get("study")["exists"] is False
        assert page.get("runs") == []
        assert client.put("/api/runs/sine.parquet", content=run.read_bytes()).json()["name"] == "sine"
        job = page.until_over(page.post("study/runs", {"used": ["sine"], "held": []})["id"])
        assert (
            "drop its rig.toml here" in job["error"]
        )  # a table does not bring its rig along, and nothing half made stays behind
        assert page.get("study")["exists"] is False
        for name in ("rig.toml", "vehicle.toml"):
            assert client.put(f"/api/runs/{name}", content=(CAR / name).read_bytes()).status_code == 200
        job = page.until_over(page.post("study/runs", {"used": ["sine"], "held": []})["id"])
        assert job["state"] == "done", job["error"]
        found = page.get("study")
        assert (found["current"], found["used"]) == (1, ["runs/sine.parquet"])
    assert main(["study", str(tmp_path / "new")]) == 0


def test_the_same_samples_under_two_names_do_not_check_each_other(page: Page, folder: Path):
    """A copy held out would be a run the fit has seen, and its error no check."""
    run = open_run(folder / "runs" / "sine.parquet")
    written(replace(run, manoeuvre="another"), folder / "runs" / "copy.csv")
    found = {r["name"]: r for r in page.get("runs")}
    assert found["copy"]["quality"] == "flagged"
    assert "the same samples as sine" in found["copy"]["says"]
    assert found["rough"]["quality"] == "good"
    for used, held in ((["sine"], ["copy"]), (["sine", "copy"], ["rough"])):
        job = page.until_over(page.post("study/runs", {"used": used, "held": held})["id"])
        assert job["state"] == "failed"
        assert "hold the same samples" in job["error"]
    assert page.get("study")["current"] == 1


def test_a_broken_file_of_the_study_is_named_with_its_remedy(page: Page, folder: Path):
    (folder / "diagnoses" / "001.json").write_text("{", encoding="utf-8")
    text = page.get("study", 400)["error"]
    assert "001.json" in text
    assert "remove it and look again for what is missing" in text
    (folder / "diagnoses" / "001.json").unlink()
    (folder / "versions" / "001.json").write_text("{}", encoding="utf-8")
    text = page.get("study", 400)["error"]
    assert "001.json cannot be read" in text
    assert "good copy" in text


def test_a_making_that_is_cancelled_leaves_no_half_study(folder: Path, monkeypatch: pytest.MonkeyPatch):
    for name in ("study.json", "versions/001.json"):
        (folder / name).unlink()
    reached, go_on = threading.Event(), threading.Event()
    record = Session.record

    def slow(self: Session, *args: Any) -> Any:
        reached.set()
        assert go_on.wait(20.0)
        self.progress(ServiceStep(ServiceStage.SCORING))
        return record(self, *args)

    monkeypatch.setattr(Session, "record", slow)
    with TestClient(create_app(Settings(folder)), base_url="http://127.0.0.1:8765") as client:
        page = Page(client)
        number = page.post("study/runs", {"used": ["sine"], "held": []})["id"]
        assert reached.wait(20.0)
        assert client.delete(f"/api/jobs/{number}").json()["text"] == "stopping"
        go_on.set()
        assert page.until_over(number)["state"] == "cancelled"
        assert page.get("study")["exists"] is False
        assert not (folder / "study.json").exists()
        assert (folder / "rig.toml").exists()  # it was there before


def test_a_cancelled_job_changes_nothing_and_the_next_goes_on(page: Page, monkeypatch: pytest.MonkeyPatch):
    before = state_of(page.folder)
    reached, go_on = threading.Event(), threading.Event()
    comparisons = KeptValues.comparisons

    def slow(self: KeptValues, *args: Any, **more: Any) -> Any:
        reached.set()
        assert go_on.wait(20.0)
        return comparisons(self, *args, **more)

    monkeypatch.setattr(KeptValues, "comparisons", slow)
    first = page.start("add", effect="coulomb.rear")
    waiting = page.start("undo")
    assert reached.wait(20.0)
    assert page.get("study")["busy"]["do"] == "add"
    page.client.delete(f"/api/jobs/{waiting}")
    assert page.get(f"jobs/{waiting}")["state"] == "cancelled"
    page.client.delete(f"/api/jobs/{first}")
    go_on.set()
    assert page.until_over(first)["state"] == "cancelled"
    assert state_of(page.folder) == before
    assert page.run("add", effect="anti_roll_bar.rear")["version"] == 2


def test_a_second_writer_is_told_and_nothing_is_overwritten(page: Page, monkeypatch: pytest.MonkeyPatch):
    page.run("compare", version=1)
    record = Study.record

    def beaten(self: Study, *args: Any) -> Study:
        monkeypatch.setattr(Study, "record", record)
        assert main(["add", str(self.folder), "coulomb.rear"]) == 0  # the command line is quicker
        return record(self, *args)

    monkeypatch.setattr(Study, "record", beaten)
    job = page.until_over(page.start("add", effect="anti_roll_bar.front"))
    assert job["state"] == "failed"
    assert "another lacet went from version 1 to 2" in job["error"]
    found = page.get("study")
    assert [list(v["effects"]) for v in found["versions"]] == [[], ["coulomb.rear"]]
    # The page goes on from there, and what it had computed for its own second version is not shown for this one.
    assert page.run("compare", version=2)["effects"] == found["versions"][1]["effects"]
    errors = json.loads((page.folder / "versions" / "002.json").read_text(encoding="utf-8"))["result"]["rows"]["used"]
    assert page.get("compare/2")["used"] == errors
    (page.folder / ".writing").touch()
    assert page.get("study")["other_writer"]
    job = page.until_over(page.start("add", effect="anti_roll_bar.front"))
    assert "another lacet is writing" in job["error"]


def test_two_pages_see_the_same_jobs_and_the_command_lines_changes(page: Page):
    number = page.start("compare", version=1)
    assert page.start("compare", version=1) in (number, number + 1)
    assert page.until_over(number)["state"] == "done"
    before = state_of(page.folder)
    assert main(["effect", str(page.folder), "bump = suspension: p * travel**2 * sign(rate)"]) == 0
    now = state_of(page.folder)
    assert [part for part in now if now[part] != before[part]] == ["effects"]


def test_a_run_that_changes_is_read_again(page: Page, folder: Path):
    first = page.run("compare", version=1)
    written(piece("sine", 4.0, 10.0), folder / "runs" / "sine.parquet")
    assert page.get("compare/1", 202)["needs"] == "compare"
    again = page.run("compare", version=1)
    assert again["used"]["sine"] != first["used"]["sine"]
    (folder / "runs" / "sine.parquet").unlink()
    assert "sine.parquet" in page.get("compare/1", 400)["error"]


def test_runs_are_summed_up_in_words(page: Page):
    (page.folder / "runs" / "broken.mcap").write_bytes(b"not at all")
    (page.folder / "runs" / ".half.part.csv").write_bytes(b"t\n")
    found = {run["name"]: run for run in page.get("runs")}
    assert set(found) == {"sine", "rough", "spare", "broken"}
    assert found["broken"]["quality"] == "cannot be read"
    assert found["broken"]["says"]
    assert (found["sine"]["role"], found["rough"]["role"], found["spare"]["role"]) == ("used", "held", "unused")
    assert found["sine"]["seconds"] == pytest.approx(6.0, abs=0.1)
    channels = {c["name"]: c for c in page.get("runs/sine")["channels"]}
    assert channels["wheel.fl.force"]["unit"] == "N"
    assert channels["wheel.fl.force"]["components"] == ["x", "y", "z"]


def test_the_report_is_one_file_that_runs_nothing(page: Page, monkeypatch: pytest.MonkeyPatch):
    def drawn(session: Session, file: Path) -> None:  # its pictures take long, and are tested elsewhere
        file.write_text(html_page(session.study.folder.name, details("more", "text")), encoding="utf-8")

    monkeypatch.setattr("lacet.services.workbench.tasks.write_report", drawn)
    assert page.get("export/report.html", 409)["needs"] == "report"
    page.run("report")
    answer = page.client.get("/api/export/report.html")
    assert answer.status_code == 200
    assert "default-src 'none'" in answer.headers["content-security-policy"]
    assert answer.text.startswith("<!doctype html>")
    assert "<script" not in answer.text


def test_while_a_job_computes_small_questions_are_told_so(folder: Path):
    cache = SessionCache(folder)
    with cache.computing(), pytest.raises(UsageError.__base__, match="at work"), cache.computing(0.01):
        pass


def test_a_bug_is_told_and_the_thread_goes_on(capsys: pytest.CaptureFixture[str]):
    def bug(_: Any, __: JobProgress) -> None:
        raise ZeroDivisionError("oh")

    jobs = Jobs({"bug": bug, "fine": lambda args, teller: args["x"]}, Events())
    first, second = jobs.submit("bug", {}), jobs.submit("fine", {"x": 1})
    while not second.over:
        pass
    assert (first.state, second.state, second.result) == ("failed", "done", 1)
    assert "lacet itself" in str(first.error)
    assert "ZeroDivisionError" in capsys.readouterr().err
    jobs.close()
