"""What the page is shown is what was computed: parts add up, pictures and numbers are the same, and the command's."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi.routing import APIRoute
from fastapi.testclient import TestClient

from lacet.daq.formats.open_run import open_run
from lacet.identify.car.rows import Row
from lacet.identify.validation.score import FAILS
from lacet.services.commands.__main__ import main
from lacet.services.render.rows import with_verdict
from lacet.services.workbench import run_channels
from lacet.services.workbench.packed_arrays import packed, unpacked
from lacet.services.workbench.residual_views import where_payload
from lacet.services.workbench.routes import api, nothing
from lacet.services.workbench.server import Settings, create_app
from lacet.services.workbench.session_cache import SessionCache
from lacet.services.workbench.study_views import version_payload
from lacet.services.workspace.kept import kept_values
from lacet.services.workspace.study import Study
from tests.services.workbench.bench_page import Page
from tests.services.workbench.conftest import DRAWS
from tests.support.places import HOME


def arrays(page: Page, path: str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """A binary answer."""
    answer = page.client.get(f"/api/{path}")
    assert answer.status_code == 200, answer.text
    return unpacked(answer.content)


def test_the_page_of_the_api_lists_the_server_s_routes():
    page = (HOME / "docs" / "workbench-api.md").read_text(encoding="utf-8")
    listed = set()
    for cell in re.findall(r"^\| (`(?:GET|POST|PUT|DELETE) .*?) \| ", page, re.MULTILINE):
        method = cell[1:].partition(" ")[0]
        for path in re.findall(r"/api/[\w/-]+", cell):
            listed.add((method, re.sub(r"\b[A-Z]+\b", "{}", path)))
    served = {
        (method, re.sub(r"\{.*?\}", "{}", route.path))
        for route in api.routes
        if isinstance(route, APIRoute) and route.endpoint is not nothing
        for method in route.methods
    }
    assert listed == served


def test_numbers_go_through_the_wire_aligned():
    body = packed({"t": np.arange(3.0), "ü": np.array([np.nan, 1.5])}, unit="N·m", row="x", floor=float("nan"))
    head, found = unpacked(body)
    assert head["unit"] == "N·m"
    assert head["floor"] is None
    length = int.from_bytes(body[:4], "little")
    assert (4 + length) % 4 == 0
    assert np.array_equal(found["t"], [0.0, 1.0, 2.0])
    assert np.isnan(found["ü"][0])
    assert found["ü"][1] == 1.5


def test_shares_add_up_to_the_model_and_give_the_score(shared: Page):
    for run in shared.get("compare/1")["runs"]:
        for row in run["rows"]:
            head, found = arrays(shared, f"series/1/{run['name']}/{row['row']}")
            parts = [a for name, a in found.items() if name.startswith("effect:")]
            assert parts, row
            total = np.sum([*parts, found["zeros"]], axis=0, dtype=float)
            assert total == pytest.approx(found["modelled"], abs=1e-5 * float(np.max(np.abs(parts))))
            rms = np.sqrt(np.mean((found["measured"] - found["modelled"]).astype(float) ** 2))
            assert rms == pytest.approx(row["rms"], rel=1e-2, abs=1e-6 * float(np.max(np.abs(found["measured"]))))
            assert (head["unit"], head["floor"]) == (row["unit"], row["floor"])


def test_a_cell_of_the_map_is_the_residual_there(shared: Page):
    found = shared.get("map/1")
    assert {run["name"]: run["used"] for run in found["runs"]} == {"sine": True, "rough": False}
    for run in found["runs"]:
        for row in ("suspension.fl", "chassis.fz"):
            head, series = arrays(shared, f"series/1/{run['name']}/{row}")
            place = np.floor((series["t"] - run["t0"]) / found["cell"]).astype(int)
            squares = (series["measured"] - series["modelled"]).astype(float) ** 2
            for cell in (0, 3, run["cells"] - 2):
                here = (place == cell) & (np.abs(series["t"] - run["t0"] - found["cell"] * cell) > 1e-4)
                ratio = np.sqrt(squares[place == cell].mean()) / head["floor"]
                assert here.any()
                assert run["rows"][row][cell] == pytest.approx(ratio, rel=0.05)
        assert run["phases"][0]["start"] <= run["t0"] + 1.0


def test_the_answer_is_the_command_lines(shared: Page, tmp_path: Path):
    for command, more in (("compare", ["--no-pictures"]), ("where", [])):
        file = tmp_path / f"{command}.json"
        main([command, str(shared.folder), "--json", str(file), *more])
        theirs = json.loads(file.read_text(encoding="utf-8"))
        ours = shared.get(f"{command}/1")
        for part in (*ours.get("against", {}).values(), ours.get("surfaces", {})):
            assert all(one.pop("shown") for one in part.values())
        for key in set(theirs) - {"format", "command", "pictures", "wheel_forces"}:  # the page has a picture of these
            assert ours[key] == theirs[key], (command, key)
    for run in shared.get("compare/1")["runs"]:
        assert all(row.pop("fails") is (row["ratio"] > FAILS and row["judged"]) for row in run["rows"])
        assert all(row.pop("level") in range(5) for row in run["rows"])
        assert all(row.pop("noise_alone") in (False, True) for row in run["rows"])
        flat = {row["row"]: row for row in run["rows"]}
        assert flat == shared.get("compare/1")["used" if run["used"] else "held"][run["name"]]


def test_the_ranking_is_kept_and_shown(shared: Page):
    found = shared.get("study")["diagnosis"]
    assert {c["effect"] for c in found["candidates"]} == {"anti_roll_bar.front", "anti_roll_bar.rear", "coulomb.rear"}
    on_disk = json.loads((shared.folder / "diagnoses" / "001.json").read_text(encoding="utf-8"))
    units = [candidate.pop("unit") for candidate in found["candidates"]]
    labels = {candidate["effect"]: candidate.pop("label") for candidate in found["candidates"]}
    assert labels["coulomb.rear"] == "coulomb, rear"
    shown_by = {candidate.pop("shown_by") for candidate in found["candidates"]}
    assert shown_by == {"steering or one-sided bumps together with heave", "smooth driving"}
    assert units == [Row.parse(c["rows"][0]).unit if c["rows"] else "" for c in on_disk["candidates"]]
    assert found == on_disk


def test_the_page_gets_states_and_surfaces_in_display_units(shared: Page):
    """It converts no unit and names no corner itself."""
    where = shared.get("where/1")
    travel = shared.get("against/1/suspension.fl/travel")
    assert travel["shown"]["unit"] == "mm"
    assert travel["shown"]["state"] == pytest.approx([1e3 * value for value in travel["state"]])
    asked = shared.get("against/1/chassis.fz/speed")
    assert (asked["shown"]["unit"], asked["shown"]["state"]) == ("m/s", asked["state"])
    turned = shared.get("against/1/chassis.fz/roll rate")
    assert turned["shown"]["unit"] == "°/s"
    assert turned["shown"]["state"] == pytest.approx(np.degrees(turned["state"]))
    surface = where["surfaces"]["rl"]
    assert (surface["shown"]["label"], surface["shown"]["unit"]) == ("rear left", "N")
    assert (surface["shown"]["travel_unit"], surface["shown"]["rate_unit"]) == ("mm", "mm/s")
    assert surface["shown"]["travel"] == pytest.approx([1e3 * edge for edge in surface["travel"]])
    head, _ = arrays(shared, "series/1/sine/suspension.fl")
    assert head["labels"]["spring.fl"] == "spring, front left"
    checked = shared.post("effect/check", {"name": "own", "line": "suspension: p * load"})
    assert [p["unit"] for p in checked["parameters"]] == [""]  # a plain number


def test_states_that_are_known_already_have_display_units_too(monkeypatch: pytest.MonkeyPatch, folder: Path):
    """As those that are asked for one by one."""
    known = {"against": {"chassis.mx": {"roll angle": {"unit": "rad", "state": [-0.01, 0.02]}}}, "surfaces": {}}
    monkeypatch.setattr(SessionCache, "found_where", lambda self, number: (None, known))
    shown = where_payload(SessionCache(folder), 1)["against"]["chassis.mx"]["roll angle"]["shown"]
    assert shown["state"] == pytest.approx(np.degrees([-0.01, 0.02]))
    assert (shown["unit"], shown["row_unit"]) == ("°", "N·m")


def test_any_state_and_any_spectrum_can_be_asked_for(shared: Page):
    where = shared.get("where/1")
    row = where["worst"][0]
    found = shared.get("against/1/chassis.fz/speed")
    assert (found["row_unit"], found["unit"]) == ("N", "m/s")
    assert len(found["state"]) == len(found["mean"]) > 3
    assert sum(found["count"]) == arrays(shared, "series/1/sine/chassis.fz")[1]["t"].size
    spectrum = shared.get(f"spectrum/1/{row}")
    assert len(spectrum["frequency"]) == len(spectrum["residual"]) == len(spectrum["floor"])
    assert spectrum["level"] == where["coherence"][row]["level"]
    assert "did you mean" in shared.get("against/1/chassis.fz/sped", 404)["error"]
    assert shared.get("against/1/chassis.zz/speed", 404)["error"]


def test_a_preview_shows_the_effects_own_row_before_and_after(shared: Page):
    assert shared.run("preview", effect="anti_roll_bar.front")["run"] == "sine"
    head, found = arrays(shared, "preview/1/anti_roll_bar.front")
    assert head["row"] in ("suspension.fl", "suspension.fr")
    _, series = arrays(shared, f"series/1/sine/{head['row']}")
    assert found["now"] == pytest.approx(series["measured"] - series["modelled"], abs=1e-3)
    for name in ("now", "after"):
        assert head[f"rms_{name}"] == pytest.approx(np.sqrt(np.mean(found[name].astype(float) ** 2)), rel=1e-4)
    assert head["rms_after"] < 0.5 * head["rms_now"]
    assert f"{head['row']} in sine" in head["says"]
    assert shared.get("preview/1/nothing", 404)["error"]


def test_the_signature_lies_on_the_residual_of_a_car_that_has_the_effect(shared: Page):
    shared.run("preview", effect="anti_roll_bar.front")
    head, found = arrays(shared, "preview/1/anti_roll_bar.front")
    assert head["state"] == "travel difference across the axle"
    assert head["state_unit"] == "mm"
    assert head["part"] > 0.8
    assert found["law"] == pytest.approx(found["mean"], abs=0.15 * float(np.max(np.abs(found["mean"]))))
    assert np.corrcoef(found["law_at"], found["law"])[0, 1] > 0.99, "a bar is a line over the difference of travel"


@pytest.fixture
def ranked(shared: Page, tmp_path: Path) -> Iterator[Page]:
    """A server on a copy of the study that is ranked, which may be changed."""
    folder = Path(shutil.copytree(shared.folder, tmp_path / "car"))
    with TestClient(create_app(Settings(folder, draws=DRAWS)), base_url="http://127.0.0.1:8765") as client:
        yield Page(client)


def test_a_preview_is_the_fit_that_adding_makes(ranked: Page, monkeypatch: pytest.MonkeyPatch):
    page = ranked
    page.run("preview", effect="anti_roll_bar.front")
    head, found = arrays(page, "preview/1/anti_roll_bar.front")
    monkeypatch.setattr(kept_values, "fit", lambda *_, **__: pytest.fail("the preview's fit serves"))
    added = page.run("add", effect="anti_roll_bar.front")
    _, series = arrays(page, f"series/2/{head['run']}/{head['row']}")
    assert found["after"] == pytest.approx(series["measured"] - series["modelled"], abs=1e-3)
    assert added["row"]["row"] in page.get("study")["row_labels"]
    assert added["says"].startswith(f"Added anti_roll_bar.front: {added['row']['row']} ")
    assert added["helps"]


def test_every_place_shows_the_same_error_of_a_row(shared: Page):
    """The rail, the car, the failure analysis and the table by version: pooled over the runs used."""
    version = shared.get("study")["versions"][0]
    where = shared.get("where/1")
    scores = shared.get("compare/1")
    for error in version["errors"]:
        row = error["row"]
        used = [rows[row] for rows in scores["used"].values() if row in rows]
        rms, floor = (np.sqrt(np.mean([s[key] ** 2 for s in used])) for key in ("rms", "floor"))
        assert error["ratio"] == pytest.approx(rms / floor), row
        assert where["rows"][row] == pytest.approx(error["ratio"]), row
        every = {name: rows[row]["ratio"] for part in ("used", "held") for name, rows in scores[part].items()
                 if row in rows and rows[row]["judged"]}  # fmt: skip
        assert error["worst"] == max(every.values())
        assert every[error["worst_run"]] == error["worst"]
    assert version["used_error"] == pytest.approx(np.sqrt(np.mean([e["ratio"] ** 2 for e in version["errors"]])))


def test_coherence_is_in_the_order_of_the_power_that_it_explains(shared: Page):
    row = shared.get("where/1")["worst"][0]
    found = shared.get(f"spectrum/1/{row}")
    power = np.array(found["residual"])
    explained = {name: float(np.sum(np.array(c) * power) / np.sum(power)) for name, c in found["coherence"].items()}
    assert list(explained) == sorted(explained, key=lambda name: -explained[name])
    assert found["explained"] == pytest.approx(explained)
    by_peak = sorted(explained, key=lambda name: -max(found["coherence"][name]))
    assert by_peak != list(explained), "the highest line is another order"


def test_effects_have_colours_that_stay(page: Page):
    """Of the base model, and of others as they were first added; what is added later changes none."""
    before = arrays(page, "series/1/sine/suspension.rl")[0] if page.run("compare") else {}
    page.run("add", effect="coulomb.rear")
    page.run("add", effect="anti_roll_bar.rear")
    after = arrays(page, "series/3/sine/suspension.rl")[0]["colours"]
    assert {key: after[key] for key in before["colours"]} == before["colours"]
    assert after["anti_roll_bar.rear"] == after["coulomb.rear"] + 1
    assert len({after["spring.rl"], after["damper.rl"], after["coulomb.rear"], after["anti_roll_bar.rear"]}) == 4


def test_a_row_of_hardly_more_than_noise_has_no_variance_explained():
    noise = {"rms": 1.0, "floor": 1.0, "vaf": 40.0, "ratio": 1.0}
    assert with_verdict(noise)["noise_alone"]
    assert not with_verdict({**noise, "vaf": 99.0})["noise_alone"]
    assert not with_verdict({**noise, "rms": 5.0, "ratio": 5.0})["noise_alone"]


def test_a_channel_has_holes_where_it_cannot_be_used(shared: Page):
    head, found = arrays(shared, "channels/sine?names=wheel.fl.force,imu.rate&samples=true")
    run = open_run(shared.folder / "runs" / "sine.parquet").signals["wheel.fl.force"]
    about = head["channels"]["wheel.fl.force"]
    assert (about["unit"], about["block"]) == ("N", 1)
    x = np.where(run.usable, run.values[:, 0], np.nan)
    assert found[about["parts"]["x"]] == pytest.approx(x, nan_ok=True, rel=1e-6)
    assert about["t"] == head["channels"]["imu.rate"]["t"], "a table's times come once"
    assert "did you mean" not in shared.get("channels/sine?names=nothing", 404)["error"]


def test_an_overview_is_the_extremes_of_all_samples(shared: Page, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(run_channels, "BLOCKS", 100)
    monkeypatch.setattr(run_channels, "_LAYOUT", "fewer blocks")
    head, found = arrays(shared, "channels/sine?names=wheel.fl.force,imu.rate")
    whole, samples = arrays(shared, "channels/sine?names=wheel.fl.force,imu.rate&samples=true")
    for name, about in head["channels"].items():
        t = samples[whole["channels"][name]["t"]]
        block = about["block"]
        assert block * 100 >= t.size > block * 50
        assert found[about["t"]][::2] == pytest.approx(t[::block])
        assert found[about["t"]][-1] == t[-1]
        for part, array in about["parts"].items():
            values = samples[whole["channels"][name]["parts"][part]]
            blocks = [values[k : k + block] for k in range(0, t.size, block)]
            expected = np.ravel([(np.nanmin(own), np.nanmax(own)) for own in blocks])
            np.testing.assert_array_equal(found[array], expected)
    again = shared.client.get("/api/channels/sine?names=wheel.fl.force,imu.rate").content
    assert unpacked(again)[0] == head, "the overview that was stored"


@pytest.mark.parametrize(("samples", "block"), [(5, 1), (16_384, 1), (16_385, 8), (65_536, 8), (150_000, 32)])
def test_an_overview_has_as_many_blocks_as_pictures_need(samples: int, block: int):
    assert run_channels.block_of(samples) == block


def test_the_car_is_where_its_file_says(shared: Page):
    car = shared.get("car")
    x = {name: corner["x"] for name, corner in car["corners"].items()}
    assert x["fl"] - x["rl"] == pytest.approx(car["wheelbase"])
    y = {name: corner["y"] for name, corner in car["corners"].items()}
    assert y["fl"] - y["fr"] == pytest.approx(car["track"]["front"])
    assert all(y[name] > 0 for name in ("fl", "rl"))
    places = {row["row"]: row["place"] for row in car["rows"]}
    assert places["suspension.rl"] == "rl"
    assert places["chassis.mz"] == "chassis"
    wheel = next(s for s in car["sensors"] if s["channel"] == "wheel.rr.force")
    assert (wheel["x"], wheel["y"]) == pytest.approx((x["rr"], y["rr"]), abs=0.2)


def test_what_has_not_been_computed_says_which_job_does_it(page: Page):
    for path, job in (
        ("compare/1", "compare"), ("map/1", "compare"), ("where/1", "where"), ("series/1/sine/tyre.fl", "compare"),
        ("preview/1/coulomb.rear", "diagnose"),
    ):  # fmt: skip
        assert page.get(path, 202)["needs"] == job
    assert page.get("compare/7", 400)["error"].endswith("(it has 1)")
    assert page.get("nothing", 404)["error"]


def test_parameters_and_tables(shared: Page):
    found = shared.get("parameters")
    stored = json.loads((shared.folder / "versions" / "001.json").read_text(encoding="utf-8"))["result"]
    assert [p["name"] for p in found["parameters"]] == [p["name"] for p in stored["parameters"]]
    table = shared.client.get("/api/export/parameters.csv").text.splitlines()
    assert len(table) == 1 + len(stored["parameters"]) + len(stored["not_identifiable"])
    versions = shared.client.get("/api/export/versions.csv").text.splitlines()
    assert len(versions) == 1 + 2 + sum(len(rows) for part in stored["rows"].values() for rows in part.values())
    study = json.loads(shared.client.get("/api/export/study.json").text)
    assert study["result"] == stored
    assert shared.get("export/report.html", 409)["needs"] == "report"
    assert shared.get("export/passwd", 404)["error"]


def test_wheel_forces_of_a_run_held_out_are_a_picture(shared: Page):
    """And a run that was used has none."""
    answer = shared.client.get("/api/forces/1/rough")
    assert answer.status_code == 200, answer.text
    assert (answer.headers["content-type"], answer.content[:4]) == ("image/png", b"\x89PNG")
    assert shared.client.get("/api/forces/1/sine").status_code == 404


def test_the_car_in_numbers_is_the_result_in_plain_words(shared: Page):
    found = shared.get("values?version=1")
    result = json.loads((shared.folder / "versions" / "001.json").read_text(encoding="utf-8"))["result"]
    assert [d["name"] for d in found["derived"]] == [d["name"] for d in result["derived"]]
    rate = next(d for d in found["derived"] if d["name"] == "ride_rate.fl")
    own = next(d for d in result["derived"] if d["name"] == "ride_rate.fl")
    assert (rate["label"], rate["place"], rate["unit"]) == ("ride rate", "fl", "N/m")
    assert (rate["value"], rate["half95_sheet"]) == (own["value"], own["half95_sheet"])
    assert own["half95_sheet"] > own["half95"]
    words = {p["name"]: (p["label"], p["symbol"]) for p in found["parameters"]}
    assert words["M6"] == ("sprung mass", "M6")
    assert words["spring.rl.k"] == ("rear left spring rate", "ks9")
    assert words["damper.fr.c"] == ("front right damper rate", "hs36")
    assert words["tyre_stiffness.fl.kt"] == ("front left tyre stiffness", "ks33")
    assert len({label for label, _ in words.values()}) == len(words)
    assert all(p["other"] is None and p["differs"] is None for p in found["parameters"])
    curve, own = found["dampers"]["fl"], result["damper_curves"]["fl"]
    assert curve["rate"] == pytest.approx([1e3 * v for v in own["rate"]])
    assert (curve["rate_unit"], curve["travel_unit"]) == ("mm/s", "mm")


def test_versions_differ_where_noise_does_not_explain_it(page: Page):
    page.run("add", effect="anti_roll_bar.front")
    found = page.get("values?version=2&against=1")
    by_name = {p["name"]: p for p in found["parameters"]}
    assert by_name["anti_roll_bar.front.k"]["label"] == "front anti-roll bar rate"
    assert by_name["anti_roll_bar.front.k"]["other"] is None
    assert by_name["spring.fl.k"]["differs"], "the bar had been in the springs"
    before = page.get("values?version=1")["parameters"]
    for p in before:
        beside = by_name[p["name"]]
        if beside["other"]:
            assert beside["other"]["value"] == p["value"]
            far = abs(beside["value"] - p["value"]) > np.hypot(beside["half95"], p["half95"])
            assert beside["differs"] == far
    assert any(p["differs"] is False for p in found["parameters"])
    # the table of all versions says the same
    for p in page.get("parameters?version=2")["parameters"]:
        (one,) = p["before"]
        assert one == {"version": 1, **{key: by_name[p["name"]][key] for key in ("other", "differs", "change")}}
    back = page.get("values?version=1&against=2")
    assert {p["name"] for p in back["gone"]} == set(by_name) - {p["name"] for p in before} >= {"anti_roll_bar.front.k"}


def test_a_version_says_what_of_its_values_cannot_be(shared: Page):
    """Of a version made before lacet looked, and of one of right channels, nothing."""
    study = Study.open(shared.folder)
    version = study.version()
    assert version.result["implausible"] == []
    assert version_payload(study, version)["doubts"] == []
    spring = {"name": "spring.fl.k", "value": -27e3, "unit": "N/m", "half95_sheet": 1e3, "low": 0.0, "high": 2e5}
    wrong = replace(version, result={**version.result, "implausible": [spring]})
    (said,) = version_payload(study, wrong)["doubts"]
    assert said.startswith("spring.fl.k (-27000 ± 1000 N/m) has a value that no car has")
    earlier = {key: value for key, value in version.result.items() if key != "implausible"}
    assert version_payload(study, replace(version, result=earlier))["doubts"] == []


def test_a_formula_is_its_states_along_the_run(shared: Page):
    head, found = arrays(shared, "formula/1/sine?text=travel_fl%20-%20travel_fr")
    assert head["unit"] == "m"
    parts = [arrays(shared, f"formula/1/sine?text=travel_{c}")[1]["values"] for c in ("fl", "fr")]
    assert found["values"] == pytest.approx(parts[0] - parts[1], abs=1e-7)
    assert np.ptp(found["values"]) > 0.005
    head, angle = arrays(shared, "formula/1/sine?text=roll")
    assert head["unit"] == "rad"
    assert np.corrcoef(angle["values"], found["values"])[0, 1] < -0.9, "left side up is travel less on the left"
    assert arrays(shared, "formula/1/sine?text=1/max(abs(speed),%202%20m/s)")[1]["values"].size
    wrong = {
        "travel": "travel_fl", "travl_fl": "did you mean", "travel_fl + ay": "m/s", "2 * 3": "no measured state",
        "travel_fl +": "no arithmetic", "open('x')": "",
    }  # fmt: skip
    for text, words in wrong.items():
        answer = shared.client.get("/api/formula/1/sine", params={"text": text})
        assert answer.status_code == 400, text
        assert words in answer.json()["error"]
    assert shared.client.get("/api/formula/1/spare?text=ay").status_code == 404
