"""`docker-compose.campaign.yml`, as far as it can be checked without an engine."""

from __future__ import annotations

import json
import re
import subprocess
from typing import Any

import jsonschema
import pytest

from lacet.services.commands.__main__ import build_parser
from tests.support.compose import compose_file
from tests.support.places import HOME

FILE = "docker-compose.campaign.yml"
COMPOSE = compose_file(name=FILE)
SERVICES: dict[str, dict[str, Any]] = COMPOSE["services"]
SCHEMA = json.loads((HOME / "tests" / "data" / "compose" / "compose_spec.json").read_text(encoding="utf-8"))


def test_it_follows_the_compose_specification() -> None:
    """And the schema would find a fault."""
    assert [e.message for e in jsonschema.Draft7Validator(SCHEMA).iter_errors(COMPOSE)] == []
    wrong = json.loads(json.dumps(COMPOSE))
    wrong["services"]["worker"]["depends_on"]["scheduler"]["condition"] = "service_well"
    assert list(jsonschema.Draft7Validator(SCHEMA).iter_errors(wrong))


@pytest.mark.parametrize("name", ["scheduler", "worker"])
def test_dask_understands_the_commands(name: str) -> None:
    """Every option of the scheduler and the workers is one that the locked version has."""
    pytest.importorskip("distributed")
    from distributed.cli.dask_scheduler import main as scheduler
    from distributed.cli.dask_worker import main as worker

    program, what, *words = SERVICES[name]["command"]
    assert (program, what) == ("dask", name)
    parsed = {"scheduler": scheduler, "worker": worker}[name].make_context(name, list(words)).params
    if name == "worker":
        assert parsed["scheduler"] == "tcp://scheduler:8786"
        assert (parsed["nthreads"], str(parsed["n_workers"])) == (1, "1")
    else:
        assert (parsed["host"], str(parsed["port"])) == ("0.0.0.0", "8786")


def test_all_are_one_image_with_dask() -> None:
    """Built once, from the lock of a campaign, by an argument that the Dockerfile has."""
    assert {service["image"] for service in SERVICES.values()} == {"lacet-campaign"}
    build = SERVICES["scheduler"]["build"]
    docker = (HOME / "Dockerfile").read_text(encoding="utf-8")
    assert re.search(r"^ARG LOCK=run\.txt$", docker, re.MULTILINE)
    assert "requirements/${LOCK}" in docker
    assert (HOME / "requirements" / build["args"]["LOCK"]).is_file()


def test_the_health_check_is_python() -> None:
    """It compiles, and fails where nobody listens."""
    kind, program, option, code = SERVICES["scheduler"]["healthcheck"]["test"]
    assert (kind, program, option) == ("CMD", "python", "-c")
    compile(code, FILE, "exec")
    assert subprocess.run(["python3", "-c", code.replace("8786", "9")], capture_output=True, check=False).returncode


def test_services_wait_for_the_scheduler_and_nothing_is_published() -> None:
    """Workers and command see the same runs and sums under the same paths."""
    for name in ("worker", "campaign"):
        assert SERVICES[name]["depends_on"]["scheduler"]["condition"] == "service_healthy"
        runs, sums = SERVICES[name]["volumes"]
        assert runs == "./replay_logs/anti-roll-bars:/runs:ro"
        assert sums.split(":")[0] in COMPOSE["volumes"]
    assert (HOME / "replay_logs" / "anti-roll-bars").is_dir()
    assert compose_file({"LACET_RUNS": "/data"}, FILE)["services"]["worker"]["volumes"][0] == "/data:/runs:ro"
    assert not any("ports" in service or "network_mode" in service for service in SERVICES.values())


def test_the_command_of_its_comment_parses() -> None:
    """`lacet campaign` as the file's head says it."""
    head = (HOME / FILE).read_text(encoding="utf-8").split("\nservices:")[0]
    words = " ".join(line.lstrip("# ") for line in head.splitlines())
    found = re.search(r"lacet (campaign /runs.*?campaign\.json)", words)
    assert found
    args = build_parser().parse_args(found[1].split())
    assert args.scheduler == "tcp://scheduler:8786"
    assert build_parser().parse_args(["campaign", "x"]).scheduler is None
