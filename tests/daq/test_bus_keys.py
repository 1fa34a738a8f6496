"""Who may do what on the bus: certificates of another, expired or absent ones, and names that are not one's own."""

from __future__ import annotations

import json
import shutil
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import Any

import pytest
import zenoh

from lacet.daq.bus import publisher as bus_publisher
from lacet.daq.bus.certificates import Role, make_certificate
from lacet.daq.bus.credentials import Credentials, check_endpoint
from lacet.daq.bus.listener import BusListener
from lacet.daq.bus.marks import set_mark
from lacet.daq.bus.publisher import RunPublisher
from lacet.daq.bus.router_file import ROUTER_FILE
from lacet.daq.bus.session import Keys, common_settings, open_session
from lacet.daq.bus.spool import Spool
from lacet.daq.errors import UsageError
from lacet.daq.formats.wire import StartRecord
from lacet.services.acquisition.worker import RunResult, Worker
from lacet.services.commands.__main__ import main
from tests.daq.test_bus import assert_whole, publish, wait_until
from tests.daq.test_bus_hostile import ATTACKS
from tests.support.rig import T0, free_port, rig_text

RUN = Keys("clio", "run-1")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Keys of two cars, two workers and a router; `other`: of an authority of somebody else."""
    top = tmp_path_factory.mktemp("keys")
    everybody = ["--car", "clio", "--car", "zoe", "--worker", "lab", "--worker", "desk", "--router", "depot"]
    listen = f"tls/127.0.0.1:{free_port()}"
    for name in ("keys", "other"):
        assert main(["keys", str(top / name), *everybody, "--router-listen", listen]) == 0
    return top


@dataclass
class Sealed:
    """A router of the car `clio`, and whoever comes."""

    folder: Path
    endpoint: str
    router: zenoh.Session
    opened: list[zenoh.Session]

    def come(self, name: str, authority: str = "keys") -> zenoh.Session:
        """A client of that name."""
        credentials = Credentials.load(self.folder / authority / name)
        session = open_session(connect=(self.endpoint,), wait=1.0, credentials=credentials)
        self.opened.append(session)
        return session


def routed(folder: Path, name: str) -> Iterator[Sealed]:
    endpoint = f"tls/127.0.0.1:{free_port()}"
    router = open_session(listen=(endpoint,), credentials=Credentials.load(folder / "keys" / name))
    sealed = Sealed(folder, endpoint, router, [])
    yield sealed
    for session in (*sealed.opened, router):
        session.close()


@pytest.fixture
def sealed(folder: Path) -> Iterator[Sealed]:
    yield from routed(folder, "clio")


@pytest.fixture
def false_car(folder: Path) -> Iterator[Sealed]:
    yield from routed(folder, "zoe")


def test_a_run_goes_from_the_car_to_a_worker_with_keys(sealed: Sealed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(bus_publisher, "OTHERS", 0.1)
    run_over(sealed.router, sealed.come("lab"), tmp_path)


def test_a_certified_car_that_sends_anything_changes_nothing(
    sealed: Sealed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(bus_publisher, "OTHERS", 0.1)
    false, stop, sent = sealed.come("zoe"), Event(), list[str]()

    def attack() -> None:
        kept: list[Any] = []
        while not stop.is_set():
            for name, send in ATTACKS.items():
                for keys in (RUN, Keys("zoe", "run-1")):
                    kept += send(false, keys)
                sent.append(name)
            for item in kept[20:]:
                item.undeclare()
            del kept[20:]

    attacker = threading.Thread(target=attack)
    attacker.start()
    run_over(sealed.router, sealed.come("lab"), tmp_path)
    stop.set()
    attacker.join(20.0)
    assert len(sent) >= len(ATTACKS)


def test_the_car_and_a_worker_may_set_markers_and_nobody_else(sealed: Sealed):
    with_spool = Spool()
    publisher = RunPublisher(sealed.router, "clio", StartRecord("run-1", T0, "", rig_text()), with_spool)
    asked: list[str] = []

    def on_mark(text: str) -> dict[str, Any]:
        asked.append(text)
        return {"text": text, "seconds": 1.5}

    publisher.on_mark = on_mark
    try:
        lab = set_mark(sealed.come("lab"), "of the lab")
        assert lab == [{"run_id": "run-1", "text": "of the lab", "seconds": 1.5}]
        assert len(set_mark(sealed.come("clio"), "of the car", "clio")) == 1
        assert set_mark(sealed.come("zoe"), "of another car", "clio") == []
        assert asked == ["of the lab", "of the car"]
    finally:
        publisher.close()
        with_spool.close()


def run_over(car: zenoh.Session, worker_session: zenoh.Session, folder: Path) -> None:
    """A run over two sessions, in which live blocks are lost: whole, acknowledged, its result to be had."""
    listener = BusListener(worker_session)
    worker = Worker(listener, folder, "lab", lambda path: {"mass": 1200.0}, notify=print)
    results: list[RunResult] = []
    thread = threading.Thread(target=lambda: results.extend(worker.run(Event(), once=True)))
    thread.start()
    spool = Spool()
    publisher = RunPublisher(car, "clio", StartRecord("run-1", T0, "", rig_text()), spool, 0.3)
    whole = publish(publisher)
    publisher.finish({}, {})
    assert set(publisher.wait_for_ack(10.0)) == {"lab"}
    thread.join(10.0)
    assert_whole(results[0], whole)
    other = BusListener(worker_session)
    while (message := other.get(5.0)) is not None and message.kind != "result":
        pass
    assert message is not None
    assert json.loads(message.payload)["result"] == {"mass": 1200.0}
    for item in (listener, other, publisher, spool):
        item.close()


def test_a_run_goes_through_a_router_of_its_own_configuration(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(bus_publisher, "OTHERS", 0.1)
    file = folder / "keys" / "depot" / ROUTER_FILE
    assert "PRIVATE KEY" not in file.read_text(encoding="utf-8")  # in base64, and for its owner only
    assert file.stat().st_mode & 0o077 == 0
    router = zenoh.open(zenoh.Config.from_file(str(file)))
    (endpoint,) = json.loads(file.read_text(encoding="utf-8"))["listen"]["endpoints"]
    sealed = Sealed(folder, endpoint, router, [])
    car, worker, false = sealed.come("clio"), sealed.come("lab"), sealed.come("zoe")
    got = listen_at(worker)
    false.put(RUN.key("block", "imu.accel"), b"false")
    false.put(Keys("zoe", "run-2").key("block", "imu.accel"), b"true")
    wait_until(lambda: got != [])
    assert got == ["lacet/zoe/run-2/block/imu.accel"]
    run_over(car, worker, tmp_path)
    for session in (car, worker, false, router):
        session.close()


def listen_at(session: zenoh.Session) -> list[str]:
    """Keys of what arrives at a session, from now on."""
    got: list[str] = []
    session.declare_subscriber("lacet/**", zenoh.handlers.Callback(lambda sample: got.append(str(sample.key_expr))))
    session.liveliness().declare_subscriber(
        "lacet/**", zenoh.handlers.Callback(lambda sample: got.append(str(sample.key_expr))), history=True
    )
    time.sleep(0.2)
    return got


@pytest.mark.parametrize("fault", ["none", "expired", "another authority", "no certificate", "no TLS"])
def test_who_has_no_valid_certificate_does_not_come_in(sealed: Sealed, tmp_path: Path, fault: str):
    keys = sealed.folder / "keys"
    shutil.copytree(keys, tmp_path / "keys")
    credentials = Credentials.load(tmp_path / "keys" / "lab")
    changed: dict[str, Any] = {}
    if fault == "expired":
        make_certificate(tmp_path / "keys", "lab", days=-1.0)
        with pytest.raises(UsageError, match="lacet keys DIR --worker lab"):
            Credentials.load(tmp_path / "keys" / "lab")
    elif fault == "another authority":
        credentials = Credentials.load(sealed.folder / "other" / "lab")
    elif fault == "no certificate":
        changed = {"transport/link/tls": {"root_ca_certificate": str(keys / "lab" / "authority.pem")}}
    config = zenoh.Config()
    settings = {
        "mode": "client", "connect/endpoints": [sealed.endpoint], "connect/timeout_ms": 700,
        **common_settings(), **credentials.settings(), **changed,
    }  # fmt: skip
    if fault == "no TLS":
        settings["connect/endpoints"] = [sealed.endpoint.replace("tls/", "tcp/")]
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    if fault == "none":  # so that the others fail by their fault alone
        zenoh.open(config).close()
        return
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)


def test_a_router_of_another_authority_is_not_spoken_to(folder: Path, sealed: Sealed):
    with pytest.raises(UsageError, match="of one authority"):
        sealed.come("lab", "other")


def test_a_car_writes_under_its_own_name_only(sealed: Sealed):
    worker, false = sealed.come("lab"), sealed.come("zoe")
    got, at_car = listen_at(worker), listen_at(sealed.router)
    kept = [false.liveliness().declare_token(Keys(car, "run-1").key("alive")) for car in ("clio", "zoe")]
    for car in ("clio", "zoe"):
        for parts in (("block", "imu.accel"), ("manifest",), ("ledger",), ("ack", "lab"), ("result", "lab")):
            false.put(Keys(car, "run-1").key(*parts), b"false")
    false.put("lacet/*/run-1/block/imu.accel", b"false")
    sealed.router.put(RUN.key("manifest"), b"true")
    wait_until(lambda: RUN.key("manifest") in got)
    assert set(got) == {RUN.key("manifest")}  # a router passes on what is its own car's, at most
    assert all(key.startswith(("lacet/zoe/run-1/", RUN.key("manifest"))) for key in at_car)
    assert not any("/ack/" in key or "/result/" in key for key in at_car)
    assert kept


def test_a_false_car_with_its_own_router_is_stopped_by_the_worker(false_car: Sealed):
    worker = false_car.come("lab")
    got = listen_at(worker)
    answers = [
        false_car.router.declare_queryable(
            Keys(car, "run-1").key("start"), lambda query: query.reply(str(query.key_expr), b"false")
        )
        for car in ("clio", "zoe")
    ]
    tokens = [false_car.router.liveliness().declare_token(Keys(car, "run-1").key("alive")) for car in ("clio", "zoe")]
    for car in ("clio", "zoe"):
        false_car.router.put(Keys(car, "run-1").key("block", "imu.accel"), b"false")
    wait_until(lambda: "lacet/zoe/run-1/block/imu.accel" in got)
    assert sorted(got) == ["lacet/zoe/run-1/alive", "lacet/zoe/run-1/block/imu.accel"]
    assert [reply.ok is not None for reply in worker.get(Keys("zoe", "run-1").key("start"), timeout=1.0)] == [True]
    assert [reply for reply in worker.get(RUN.key("start"), timeout=0.5) if reply.ok] == []
    assert (len(answers), len(tokens)) == (2, 2)


def test_only_a_worker_acknowledges_and_under_its_own_name(sealed: Sealed):
    got: list[str] = []
    listener = sealed.router.declare_subscriber(
        RUN.key("ack", "*"), lambda sample: got.append(sample.payload.to_string())
    )
    lab, desk, car = sealed.come("lab"), sealed.come("desk"), sealed.come("zoe")
    for session, said in ((car, "a car"), (desk, "another worker"), (lab, "the worker")):
        session.put(RUN.key("ack", "lab"), said)
    wait_until(lambda: "the worker" in got)
    assert got == ["the worker"]
    lab.put(RUN.key("block", "imu.accel"), b"false")  # and a worker sends no samples
    desk.put(RUN.key("ack", "desk"), "the other")
    wait_until(lambda: "the other" in got)
    listener.undeclare()


def test_a_name_that_was_struck_off_may_do_nothing(sealed: Sealed, tmp_path: Path):
    shutil.copytree(sealed.folder / "keys", tmp_path / "keys")
    former = Credentials.load(sealed.folder / "keys" / "lab")  # its holder has them still
    assert main(["keys", str(tmp_path / "keys"), "--remove", "lab"]) == 0
    endpoint = f"tls/127.0.0.1:{free_port()}"
    router = open_session(listen=(endpoint,), credentials=Credentials.load(tmp_path / "keys" / "clio"))
    got: list[str] = []
    handle = router.declare_subscriber("lacet/**", lambda sample: got.append(str(sample.key_expr)))
    session = open_session(connect=(endpoint,), credentials=former)
    desk = open_session(connect=(endpoint,), credentials=Credentials.load(tmp_path / "keys" / "desk"))
    session.put(RUN.key("ack", "lab"), b"")
    desk.put(RUN.key("ack", "desk"), b"")
    wait_until(lambda: got != [])
    assert got == [RUN.key("ack", "desk")]
    handle.undeclare()
    for item in (session, desk, router):
        item.close()


def test_beyond_this_machine_keys_are_needed(folder: Path):
    credentials = Credentials.load(folder / "keys" / "clio")
    for endpoint in (
        "tcp/127.0.0.1:7447",
        "tcp/localhost:7447",
        "tcp/[::1]:7447",
        "tcp/127.0.0.9:7447#so_sndbuf=65000",
    ):
        check_endpoint(endpoint, None)
    for endpoint in ("tcp/10.0.0.7:7447", "tcp/0.0.0.0:7447", "tcp/[::]:7447", "udp/127.0.0.1:7447", "tls/a:1"):
        with pytest.raises(UsageError, match="lacet keys DIR --car"):
            check_endpoint(endpoint, None)
    for endpoint in ("foo:bar", "tcp/", "tcp/localhost", "tcp/localhost:", "tcp:localhost:7447", "localhost:7447", ""):
        for keys in (None, credentials):
            with pytest.raises(UsageError, match="is no address of a router: write tcp/HOST:PORT"):
                check_endpoint(endpoint, keys)
    check_endpoint("tls/10.0.0.7:7447", credentials)
    with pytest.raises(UsageError, match=r"tls/10\.0\.0\.7:7447"):
        check_endpoint("tcp/10.0.0.7:7447", credentials)


def test_the_commands_refuse_addresses_beyond_this_machine_and_keys_of_others(folder: Path, tmp_path: Path, capsys):
    car = ["record", "--rig", "peugeot-406", "--vehicle", "peugeot-406", "-o", str(tmp_path / "log.mcap")]
    keys = ["--keys", str(folder / "keys" / "zoe")]
    for words, remedy in (
        ([*car, "--listen", "tcp/0.0.0.0:7447"], "tls/0.0.0.0:7447 with --keys"),
        ([*car, "--connect", "tcp/10.0.0.7:7447"], "tls/10.0.0.7:7447 with --keys"),
        (["worker", "--connect", "tcp/10.0.0.7:7447"], "tls/10.0.0.7:7447 with --keys"),
        (["ui", str(tmp_path / "study"), "--connect", "tcp/10.0.0.7:7447"], "tls/10.0.0.7:7447 with --keys"),
        (["worker", *keys], "a worker's are needed"),
        ([*car, "--keys", str(folder / "keys" / "lab")], "a car's are needed"),
        ([*car, "--keys", str(tmp_path)], "make them with `lacet keys`"),
        (["worker", "--keys", str(folder / "keys" / "lab"), "--name", "desk"], "that of the certificate, lab"),
    ):
        assert main(words) == 2
        assert remedy in capsys.readouterr().err
    assert not (tmp_path / "log.mcap").exists()


def test_names_are_checked_and_kept(folder: Path, tmp_path: Path, capsys):
    top = tmp_path / "keys"
    for words, remedy in (
        ([], "--car NAME"),
        (["--car", "My Car"], "small letters"),
        (["--car", "authority"], "small letters"),
        (["--remove", "nobody"], "not certified here"),
        (["--car", "a", "--days", "0"], "above 0"),
    ):
        assert main(["keys", str(top), *words]) == 2
        assert remedy in capsys.readouterr().err
    assert not top.exists()
    assert main(["keys", str(top), "--car", "a", "--worker", "w"]) == 0
    before = (top / "w" / "certificate.pem").read_bytes()
    assert main(["keys", str(top), "--car", "b", "--json", str(tmp_path / "keys.json")]) == 0
    assert "into the others' folders" in capsys.readouterr().out
    assert json.loads((tmp_path / "keys.json").read_text(encoding="utf-8"))["cars"] == ["a", "b"]
    assert (top / "w" / "certificate.pem").read_bytes() == before
    for name in ("a", "b", "w"):
        assert Credentials.load(top / name).names.of(Role.CAR) == ["a", "b"]
        assert (top / name / "key.pem").stat().st_mode & 0o077 == 0
    assert main(["keys", str(top), "--worker", "a"]) == 2
    assert "is a car already" in capsys.readouterr().err
    assert {path.name for path in top.iterdir()} == {"a", "b", "w", "authority", "names.json"}
