"""A campaign on a local cluster is the fit in one process, whatever happens to its workers."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lacet.daq.errors import UsageError
from lacet.daq.formats.result import write_result
from lacet.identify.regression.wls import Fit, FitOptions, fit
from lacet.identify.validation.score import compare
from lacet.services.campaign import cluster
from lacet.services.campaign.cluster import Cluster, connected
from lacet.services.campaign.fitting import Campaign, CampaignFit, fit_campaign
from lacet.services.campaign.results import campaign_result
from lacet.services.campaign.run_reference import Settings
from lacet.services.commands.__main__ import main
from lacet.services.commands.campaign import payload_note
from lacet.services.one_thread import one_thread
from lacet.services.progress import AnyStep, ServiceStage
from lacet.services.workspace.loading import load
from tests.services.commands.test_json import conforms
from tests.support.short_runs import CAR, write_short_runs

pytest.importorskip("distributed")
RIG, VEHICLE = CAR / "rig.toml", CAR / "vehicle.toml"
SETTINGS = Settings(RIG.read_text(encoding="utf-8"), VEHICLE.read_text(encoding="utf-8"))


def in_one_process(campaign: Campaign, options: FitOptions) -> Fit:
    """The same fit without tasks: the runs in memory, one after the other."""
    seeds = tuple(run.reference.seed for run in campaign.runs)
    with one_thread():
        loaded = load([run.reference.place for run in campaign.runs], RIG, VEHICLE)
        return fit(campaign.settings.model(), loaded.prepared, replace(options, seeds=seeds))


def assert_equal(found: CampaignFit, whole: Fit) -> None:
    """To 1e-10 of the intervals; residuals' floors too."""
    fitted = found.fitted
    sigma = np.sqrt(np.diag(whole.covariance))
    scale = np.where(sigma > 0.0, sigma, 1.0)
    assert np.max(np.abs(fitted.theta - whole.theta) / scale) < 1e-10
    assert np.max(np.abs(fitted.correction - whole.correction) / scale) < 1e-10
    for one, other in (
        (fitted.covariance, whole.covariance), (fitted.covariance_iid, whole.covariance_iid),
        (fitted.covariance_sheet, whole.covariance_sheet),
    ):  # fmt: skip
        assert np.max(np.abs(one - other) / np.outer(scale, scale)) < 1e-10
    assert dict(fitted.sigma) == pytest.approx(dict(whole.sigma), rel=1e-10)
    assert found.counts == whole.equations.sample_counts()


def test_a_worker_is_killed_and_a_run_is_broken(tmp_path: Path) -> None:
    """The result is that of one process all the same; the broken run and the copy are named."""
    runs = [str(run) for run in write_short_runs(tmp_path, 2, 4.0)]
    broken, copy = tmp_path / "broken.parquet", tmp_path / "copy.parquet"
    broken.write_bytes(b"PAR1 and nothing else")
    copy.write_bytes(Path(runs[0]).read_bytes())
    killed: list[int] = []
    with connected(None, 2) as client:

        def progress(step: AnyStep) -> None:
            """Kill a worker when the equations of the first run are there."""
            if step.stage is ServiceStage.CAMPAIGN_PASS and workers.passes == 4 and not killed:
                killed.append(next(iter(client.run(os.getpid).values())))
                os.kill(killed[0], signal.SIGKILL)

        workers = Cluster(client, progress)
        given = [runs[0], str(broken), *runs[1:], str(copy)]
        found = fit_campaign(workers, Campaign.of(workers, given, SETTINGS), draws=4)
    assert len(killed) == 1
    assert workers.deaths == 1
    assert [run.reference.place for run in found.campaign.runs] == runs
    assert set(found.campaign.broken) == {"broken", "copy"}
    assert "the same content as sine-0000" in found.campaign.broken["copy"]
    whole = in_one_process(found.campaign, FitOptions())
    assert_equal(found, whole)
    write_result(str(tmp_path / "result.json"), "campaign", campaign_result(found, workers))
    result = conforms(tmp_path / "result.json", "campaign")
    assert result["passes"] == 7
    assert result["workers_lost"] == 1
    one = compare(whole, whole.runs[1], 4, found.campaign.runs[1].reference.seed)
    for row, score in one.scores.items():
        assert found.scores[one.name][row]["floor"] == pytest.approx(score.floor, rel=1e-9)
        assert found.scores[one.name][row]["rms"] == pytest.approx(score.rms, rel=1e-7)


@pytest.mark.slow
def test_equal_bits_on_any_number_of_workers(tmp_path: Path) -> None:
    """One, two and three workers; resumed from kept sums; robust, with a sensor fault in the model."""
    runs = [str(run) for run in write_short_runs(tmp_path / "runs", 3, 4.0)]
    settings = replace(SETTINGS, effects=("sensor_gain.force.fl",))
    options = FitOptions(robust=True, draws=2)
    found: list[CampaignFit] = []
    for number, store in ((1, ""), (2, "sums"), (3, ""), (2, "sums")):
        where = str(tmp_path / store) if store else ""
        with connected(None, number) as client:
            workers = Cluster(client)
            found.append(
                fit_campaign(workers, Campaign.of(workers, runs, replace(settings, store=where)), options, draws=3)
            )
    for other in found[1:]:
        for name in ("theta", "covariance", "covariance_sheet", "root", "correction"):
            np.testing.assert_array_equal(getattr(found[0].fitted, name), getattr(other.fitted, name), err_msg=name)
        assert repr(found[0].scores) == repr(other.scores)  # bit by bit, also where a number does not exist (NaN)
    assert_equal(found[0], in_one_process(found[0].campaign, options))


@pytest.mark.slow
def test_the_command_on_a_scheduler_elsewhere(tmp_path: Path) -> None:
    """The same command with an address: scheduler and worker are processes of their own."""
    runs = [str(run) for run in write_short_runs(tmp_path / "runs", 2, 4.0)]
    listed, where, out = tmp_path / "runs.txt", tmp_path / "scheduler.json", tmp_path / "result.json"
    listed.write_text("# two runs\n\n" + "\n".join(runs), encoding="utf-8")
    dask = [sys.executable, "-m", "dask"]
    scheduler = subprocess.Popen(
        [*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", "--dashboard-address", "127.0.0.1:0",
         "--scheduler-file", str(where)], stderr=subprocess.DEVNULL,
    )  # fmt: skip
    worker = subprocess.Popen(
        [*dask, "worker", "--scheduler-file", str(where), "--nthreads", "1", "--host", "127.0.0.1"],
        stderr=subprocess.DEVNULL,
    )
    try:
        for _ in range(600):
            if where.exists() and where.read_text():
                break
            subprocess.run(["sleep", "0.1"], check=True)
        address = json.loads(where.read_text())["address"]
        words = ["campaign", "--list", str(listed), "--scheduler", address, "--rig", str(RIG), "--vehicle"]
        assert main([*words, str(VEHICLE), "--json", str(out)]) in (0, 3)
    finally:
        for process in (worker, scheduler):
            process.terminate()
            process.wait(30)
    result = json.loads(out.read_text())
    assert [run["place"] for run in result["runs"]] == runs
    assert result["passes"] == 7
    assert result["parameters"]


def test_an_address_where_nobody_listens(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is named."""
    monkeypatch.setattr(cluster, "CONNECTING", 0.5)
    with (
        pytest.raises(UsageError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"),
        connected("tcp://127.0.0.1:9", None),
    ):
        pass


def test_without_dask_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """The extra."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UsageError, match=r"lacet\[campaign\]"), connected(None, 1):
        pass


@pytest.mark.parametrize("known", [True, False])
def test_a_payload_in_each_run_hides_the_car_s_mass_and_that_is_said(known: bool) -> None:
    note = payload_note({"whole_vehicle": [{"name": "mass", "identifiable": known}]})
    assert note.startswith("each run has a payload of its own (--payload)") != known
    assert payload_note({"whole_vehicle": None}) == ""
