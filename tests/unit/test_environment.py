"""Foreign packages with the names of lacet's folders are found, in every way they can come in."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from services import environment

ROOT = environment.HOME


def package(folder: Path, name: str) -> Path:
    """An empty package `name` in `folder`."""
    (folder / name).mkdir(parents=True)
    (folder / name / "__init__.py").touch()
    return folder / name


def distribution(folder: Path, name: str, holds: str) -> None:
    """The metadata of an installed distribution that owns the package `holds`."""
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n", encoding="utf-8")
    (info / "RECORD").write_text(f"{holds}/__init__.py,,\n", encoding="utf-8")


def test_this_environment_is_fit():
    assert environment.foreign_packages() == {}
    assert environment.complaint({}) == ""


@pytest.mark.parametrize("name", environment.FOLDERS)
def test_a_package_elsewhere_is_named_with_its_place(name, tmp_path, monkeypatch):
    place = package(tmp_path, name)
    for other in [key for key in sys.modules if key.split(".")[0] == name]:
        monkeypatch.delitem(sys.modules, other)
    monkeypatch.syspath_prepend(str(tmp_path))
    foreign = environment.foreign_packages()
    assert foreign == {name: str(place)}
    text = environment.complaint(foreign)
    assert str(place) in text
    assert "make clean" in text


def test_a_package_mixed_into_an_installed_lacet_is_named_with_its_distribution(tmp_path, monkeypatch):
    home = tmp_path / "site-packages"
    for name in environment.FOLDERS:
        package(home, name)
        for other in [key for key in sys.modules if key.split(".")[0] == name]:
            monkeypatch.delitem(sys.modules, other)
    monkeypatch.syspath_prepend(str(home))
    distribution(home, "lacet", "identify")
    assert environment.foreign_packages(home=home) == {}
    distribution(home, "file-identify", "identify")
    foreign = environment.foreign_packages(home=home)
    assert list(foreign) == ["identify"]
    assert "file-identify" in foreign["identify"]


def test_the_command_says_what_to_do_before_it_falls_over(tmp_path):
    package(tmp_path, "identify")
    code = (
        f"import sys; sys.path[:0] = [{str(tmp_path)!r}, {str(ROOT)!r}]; "
        "from services.__main__ import main; sys.exit(main())"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False, cwd=tmp_path
    )
    assert done.returncode == 2
    assert "'identify' at" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_check_runs_as_a_file_of_its_own(tmp_path):
    check = [sys.executable, "-I", str(ROOT / "services" / "environment.py")]
    done = subprocess.run(check, capture_output=True, text=True, timeout=60, check=False, cwd=tmp_path)
    assert "Traceback" not in done.stderr
    assert done.returncode == 0, done.stderr
