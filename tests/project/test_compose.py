"""`docker-compose.yml` and the Dockerfile, as far as they can be checked without an engine."""

from __future__ import annotations

import json
import os
import re
import subprocess
import time
from pathlib import Path

import jsonschema

from lacet.daq.bus.router_file import ROUTER_FILE, ROUTER_LISTEN
from lacet.daq.formats.log import LogReader
from lacet.daq.rig import Rig
from lacet.daq.vehicle import Vehicle
from lacet.services.commands.__main__ import build_parser
from tests.support.compose import compose_file, lacet_commands
from tests.support.places import HOME

COMPOSE = compose_file()
SCHEMA = json.loads((HOME / "tests" / "data" / "compose" / "compose_spec.json").read_text(encoding="utf-8"))


def test_it_follows_the_compose_specification():
    jsonschema.Draft7Validator.check_schema(SCHEMA)
    faults = [f"{list(e.path)}: {e.message}" for e in jsonschema.Draft7Validator(SCHEMA).iter_errors(COMPOSE)]
    assert faults == []


def test_the_schema_would_find_a_fault():
    wrong = json.loads(json.dumps(COMPOSE))
    wrong["services"]["worker"]["comand"] = ["lacet"]
    assert list(jsonschema.Draft7Validator(SCHEMA).iter_errors(wrong))


def test_every_lacet_command_in_it_is_one():
    found = {name: lacet_commands(service) for name, service in COMPOSE["services"].items()}
    assert [args[0] for commands in found.values() for args in commands] == ["keys", "worker", "ui", "replay", "record"]
    for commands in found.values():
        for args in commands:
            build_parser().parse_args(args)


def test_the_shell_script_is_one():
    script = COMPOSE["services"]["recorder"]["command"]
    assert script[:2] == ["sh", "-euc"]
    assert subprocess.run(["sh", "-n", "-c", script[2]], check=False).returncode == 0


def test_rig_and_vehicle_are_shipped():
    args = next(args for args in lacet_commands(COMPOSE["services"]["recorder"]) if args[0] == "record")
    parsed = build_parser().parse_args(args)
    assert set(Rig.load(parsed.rig).buses) == {"can0", "can1", "serial0", "udp0"}
    assert Vehicle.load(parsed.vehicle).name == "peugeot-406"


def test_services_wait_for_what_they_need_and_volumes_are_declared():
    services = COMPOSE["services"]
    assert services["router"]["healthcheck"]["test"]
    for name, service in services.items():
        for other, how in service.get("depends_on", {}).items():
            assert how["condition"] != "service_healthy" or "healthcheck" in services[other], name
        for volume in service.get("volumes", []):
            source = volume.split(":")[0]
            assert source in COMPOSE["volumes"] or source.startswith("./")


def test_nothing_is_open_on_the_host_and_everybody_meets_at_the_router_with_keys():
    services = COMPOSE["services"]
    assert not any("network_mode" in service for service in services.values())
    # The page alone is reached from the host, by the host alone, and asks for its token there.
    assert {name: service["ports"] for name, service in services.items() if "ports" in service} == {
        "workbench": ["127.0.0.1:8765:8765"]
    }
    (made,) = lacet_commands(services["keys"])
    folder, names = made[1], {made[i + 1] for i, word in enumerate(made) if word in ("--car", "--worker", "--router")}
    assert services["router"]["command"] == ["--config", f"{folder}/router/{ROUTER_FILE}"]
    assert "router" in names
    port = ROUTER_LISTEN.rpartition(":")[2]
    for name in ("worker", "workbench", "recorder"):
        for args in lacet_commands(services[name]):
            if args[0] in ("worker", "ui", "record"):
                assert args[args.index("--connect") + 1] == f"tls/router:{port}"
                assert args[args.index("--keys") + 1] in {f"{folder}/{name}" for name in names}
    for service in services.values():
        assert any(volume.split(":")[:2] == ["keys", folder] for volume in service["volumes"])


def test_nothing_but_volumes_and_memory_can_be_written():
    for name, service in COMPOSE["services"].items():
        if name != "keys":  # makes the keys, once
            assert service["read_only"] is True, name
            assert service["tmpfs"] == ["/tmp"], name
    for name in ("worker", "workbench", "recorder"):
        places = COMPOSE["services"][name]["environment"]
        assert all(place.startswith("/tmp") for place in places.values()), name
        assert {"HOME", "NUMBA_CACHE_DIR", "MPLCONFIGDIR"} <= set(places)


def test_what_runs_is_watched_and_started_again(tmp_path: Path):
    services = COMPOSE["services"]
    for name in ("router", "worker", "workbench", "recorder"):
        assert services[name]["healthcheck"]["test"], name
    assert services["recorder"]["restart"] == "on-failure"
    assert all(services[name]["restart"] == "unless-stopped" for name in ("router", "worker", "workbench"))
    # The recorder's own check, run: true while a log grows, false afterwards.
    kind, line = services["recorder"]["healthcheck"]["test"]
    assert kind == "CMD-SHELL"
    log = tmp_path / "run.mcap"
    log.write_bytes(b"x")
    for age, healthy in ((0.0, True), (60.0, False)):
        os.utime(log, (time.time() - age,) * 2)
        done = subprocess.run(["sh", "-c", line.replace("/runs", str(tmp_path))], check=False)
        assert (done.returncode == 0) is healthy
    # Losses are no failure, everything else is.
    script = services["recorder"]["command"][2]
    for code, expected in ((0, 0), (3, 0), (1, 1)):
        text = f"(exit {code}) {script[script.rindex('||') :]}"
        assert subprocess.run(["sh", "-euc", text], check=False).returncode == expected


def test_the_capture_is_there_and_of_this_rig():
    source = COMPOSE["services"]["recorder"]["volumes"][0].split(":")[0]
    reader = LogReader(HOME / source)
    assert set(reader.sources()) == set(Rig.load("peugeot-406").buses)


def test_what_the_dockerfile_copies_is_there_and_gets_past_dockerignore():
    text = (HOME / "Dockerfile").read_text(encoding="utf-8")
    sources = [word for line in re.findall(r"^COPY (.*)$", text, re.MULTILINE) for word in line.split()[:-1]]
    ignored = (HOME / ".dockerignore").read_text(encoding="utf-8").split()
    assert {"daq", "drivers", "identify", "lacet", "services", "simulate"} <= set(sources)
    for source in sources:
        assert (HOME / source).exists(), source
        assert source not in ignored
