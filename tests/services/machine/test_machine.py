"""What `lacet doctor` finds on computers that are made here, and on this one."""

from __future__ import annotations

import re
import socket
import sys
import webbrowser
from importlib import metadata
from pathlib import Path

import pytest

from lacet.daq import parts
from lacet.services.acquisition.host_clock import describe_synchronisation
from lacet.services.acquisition.log_medium import RESERVE_BYTES
from lacet.services.commands.__main__ import main
from lacet.services.machine import computer, packages, wires
from lacet.services.machine.finding import Finding, State
from tests.services.commands.test_json import conforms
from tests.support.places import HOME


def interface(networks: Path, name: str, kind: int, flags: int) -> None:
    """A network interface as the kernel shows it."""
    (networks / name).mkdir(parents=True)
    (networks / name / "type").write_text(f"{kind}\n")
    (networks / name / "flags").write_text(f"{flags:#x}\n")


def states(found: list[Finding]) -> dict[str, State]:
    return {one.name: one.state for one in found}


class TestCan:
    def test_interfaces_are_those_of_the_type_can(self, tmp_path: Path) -> None:
        for name, kind, flags in (("can0", 280, 0x40081), ("can1", 280, 0x40080), ("eth0", 1, 0x1003)):
            interface(tmp_path, name, kind, flags)
        (tmp_path / "bonding_masters").write_text("")
        assert wires.can_interfaces(tmp_path) == {"can0": True, "can1": False}
        assert wires.can_interfaces(tmp_path / "nowhere") == {}

    def test_one_that_is_down_or_named_by_a_rig_and_not_there_has_the_command_with_its_bit_rate(self) -> None:
        found = wires.can_findings({"can0": True, "vcan1": False}, {"can0": 1_000_000, "can2": 250_000}, True)
        assert states(found) == {"CAN can0": State.OK, "CAN can2": State.WARNING, "CAN vcan1": State.WARNING}
        remedy = {one.name: one.remedy for one in found}
        assert "sudo ip link set can2 up type can bitrate 250000" in remedy["CAN can2"]
        assert remedy["CAN vcan1"] == "sudo ip link set vcan1 up"

    @pytest.mark.parametrize(("kernel_has_it", "remedy"), [(True, "ip link set can0 up"), (False, "Linux")])
    def test_without_a_rig_none_is_no_warning(self, kernel_has_it: bool, remedy: str) -> None:
        (one,) = wires.can_findings({}, {}, kernel_has_it)
        assert one.state is State.ABSENT
        assert remedy in one.remedy

    def test_a_rig_on_a_system_without_socketcan(self) -> None:
        (one,) = wires.can_findings({}, {"can0": 500_000}, False)
        assert (one.state, "Linux" in one.remedy) == (State.WARNING, True)


class TestSerial:
    def test_a_port_this_user_may_not_use_has_its_group_in_the_remedy(self) -> None:
        found = wires.serial_findings({"/dev/ttyUSB0": "FT232R"}, {}, lambda _: False, lambda _: "dialout")
        assert [(one.state, one.remedy) for one in found] == [
            (State.WARNING, "sudo usermod -aG dialout $USER, then log in again")
        ]
        (alone,) = wires.serial_findings({"/dev/ttyUSB0": ""}, {}, lambda _: False, lambda _: "root")
        assert alone.remedy == "use sudo"

    def test_a_port_that_the_rig_names_must_be_there(self, tmp_path: Path) -> None:
        far, near = str(tmp_path / "ttyUSB7"), str(tmp_path / "pty")
        Path(near).touch()
        asked = {far: "serial0", near: "serial1"}
        found = wires.serial_findings({"COM3": "CP210x"}, asked, lambda _: True, lambda _: "")
        assert states(found) == {
            f"serial {far}": State.WARNING, f"serial {near}": State.OK, "serial COM3": State.OK
        }  # fmt: skip

    def test_none(self) -> None:
        assert [one.state for one in wires.serial_findings({}, {}, lambda _: True, lambda _: "")] == [State.ABSENT]


def test_a_udp_port_that_another_program_listens_at() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        (taken,) = wires.udp_findings({"udp0": port})
    (free,) = wires.udp_findings({"udp0": port})
    assert (taken.state, free.state) == (State.WARNING, State.OK)
    assert "--from udp0=" in taken.remedy


def test_the_socket_buffer_has_the_size_of_the_receivers_in_its_remedy(tmp_path: Path) -> None:
    file = tmp_path / "rmem_max"
    assert wires.receive_buffer(file) == []
    file.write_text("212992\n")
    (small,) = wires.receive_buffer(file)
    assert small.remedy == f"sudo sysctl -w net.core.rmem_max={wires.RECEIVE_BUFFER}"
    file.write_text(f"{wires.RECEIVE_BUFFER}\n")
    assert states(wires.receive_buffer(file)) == {"large socket buffer": State.OK}


class TestComputer:
    @pytest.mark.parametrize(
        ("status", "state"), [(0x2001, State.OK), (0x40, State.WARNING)], ids=["synchronised", "not"]
    )
    def test_the_clock_in_the_words_of_the_recording(self, status: int, state: State) -> None:
        assert computer.clock(describe_synchronisation(status, 1000, 2500, 100)).state is state

    def test_a_system_that_does_not_say(self) -> None:
        assert computer.clock("unknown: the system does not say").state is State.ABSENT

    @pytest.mark.parametrize(
        ("free", "state"), [(RESERVE_BYTES + 6_000_000_000, State.OK), (RESERVE_BYTES + 4_000_000_000, State.WARNING)]
    )
    def test_the_disk_of_a_folder_that_is_not_there_yet(self, tmp_path: Path, free: int, state: State) -> None:
        found = computer.disk(tmp_path / "runs" / "today", lambda folder: (10 * free, 0, free * (folder == tmp_path)))
        assert found.state is state
        assert "GB for logs" in found.says

    def test_the_browser(self) -> None:
        def none() -> None:
            raise webbrowser.Error("could not locate runnable browser")

        found = computer.browser(none, lambda name: None)
        assert (found.state, "none found" in found.says) == (State.ABSENT, True)
        found = computer.browser(none, {"chromium": "/usr/bin/chromium"}.get)
        assert (found.state, "/usr/bin/chromium, but there is no display" in found.says) == (State.ABSENT, True)
        assert computer.browser(lambda: webbrowser.GenericBrowser("firefox")).says == "firefox"


class TestPackages:
    def test_an_old_package_and_one_that_is_not_here(self, monkeypatch: pytest.MonkeyPatch) -> None:
        there = metadata.version

        def version(name: str) -> str:
            if name == "scipy":
                raise metadata.PackageNotFoundError(name)
            return {"numpy": "1.26.4", "matplotlib": "3.1"}.get(name) or there(name)

        monkeypatch.setattr(packages.metadata, "version", version)
        found = {one.name: one for one in packages.packages()}
        assert found["packages"].state is State.WARNING
        assert re.search(r"numpy is 1\.26\.4, wanted is >=2\.1", found["packages"].says)
        assert "scipy is not installed" in found["packages"].says
        assert found["part plots"].state is State.WARNING
        assert "pip install 'lacet[plots]' --upgrade" in found["part plots"].remedy

    def test_a_part_that_is_not_here_is_no_warning(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(packages.sys.modules, "mujoco", None)
        monkeypatch.setattr(parts.shutil, "which", lambda _: "/usr/bin/pip")
        found = {one.name: one for one in packages.packages()}
        assert found["part sim"].state is State.ABSENT
        assert found["part sim"].remedy == f"{sys.executable} -m pip install 'lacet[sim]'"
        monkeypatch.setattr(parts.shutil, "which", lambda _: str(Path(sys.executable).parent / "pip"))
        assert parts.install_command("sim") == "pip install 'lacet[sim]'"  # the shell finds this environment's

    def test_a_folder_that_is_not_installed(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def nothing(name: str) -> None:
            raise metadata.PackageNotFoundError(name)

        monkeypatch.setattr(packages.metadata, "distribution", nothing)
        assert packages.packages()[0].state is State.WARNING
        assert packages.versions() == {}

    @pytest.mark.parametrize(("version", "state"), [("3.11.9", State.OK), ("3.99.0", State.WARNING)])
    def test_python(self, monkeypatch: pytest.MonkeyPatch, version: str, state: State) -> None:
        monkeypatch.setattr(packages.platform, "python_version", lambda: version)
        assert packages.python().state is state

    def test_the_versions_said_to_be_tried_are_those_of_the_page(self) -> None:
        text = (HOME / "docs" / "install.md").read_text(encoding="utf-8")
        assert f"Tried: Python {', '.join(packages.TRIED)}." in text


def test_the_command_on_this_computer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "doctor.json"
    code = main(["doctor", "--rig", "peugeot-406", "--logs", str(tmp_path), "--json", str(file)])
    result = conforms(file, "doctor")
    found = {one["name"]: one["state"] for one in result["checks"]}
    assert {"Python", "lacet", "packages", "part ui", "CAN can0", "clock", "browser"} <= set(found)
    assert result["warnings"] == list(found.values()).count("warning")
    assert code == (3 if result["warnings"] else 0)
    assert result["packages"]["numpy"] == metadata.version("numpy")
    out = capsys.readouterr().out
    for one in result["checks"]:
        assert one["says"] in out
        assert one["remedy"] in out
