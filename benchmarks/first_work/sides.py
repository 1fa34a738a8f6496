"""The two checkouts that are compared: the present commit and f0e8420, each laid out anew and compiled."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import tarfile
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

HOME = Path(__file__).resolve().parents[2]
BUILD = HOME / "build" / "first_work"
"""Kept between runs, outside git: checkouts, input runs, studies, what was measured."""
THEN = "f0e8420"
"""The commit that is compared with: before values were kept and passes over the samples were shared."""
FOREIGN = ("PYTHONDONTWRITEBYTECODE", "PYTHONPATH", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Taken out of the environment: threads are as each commit sets them, bytecode is kept."""


class NoCommit(Exception):
    """The commit to compare with is not in this clone."""


@dataclass(frozen=True)
class Side:
    """One checkout.

    `name` "then" or "now"; `commit` its abbreviated hash; `folder` where it lies; `module` what `python -m` runs for
    `lacet`.
    """

    name: str
    commit: str
    folder: Path
    module: str

    @property
    def work(self) -> Path:
        """Folder of this side's studies."""
        return self.folder.with_name(f"{self.folder.name}-work")

    @property
    def environment(self) -> dict[str, str]:
        """Environment of its commands; bytecode of lacet and of the packages lies apart from both checkouts."""
        kept = {key: value for key, value in os.environ.items() if key not in FOREIGN}
        return {**kept, "PYTHONPATH": str(self.folder), "PYTHONPYCACHEPREFIX": str(BUILD / "bytecode")}

    def lacet(self, *words: object) -> list[str]:
        """Command line of a sub-command."""
        return [sys.executable, "-m", self.module, *map(str, words)]


def full_hash(commit: str) -> str:
    """Full hash of a commit of this clone. Raises NoCommit."""
    words = ["git", "-C", str(HOME), "rev-parse", "--verify", "--quiet", f"{commit}^{{commit}}"]
    found = subprocess.run(words, capture_output=True, text=True)
    if found.returncode:
        raise NoCommit(
            f"commit {commit} is not in this clone, so there is nothing to compare with. A shallow clone lacks it: "
            "`git fetch --unshallow` brings it."
        )
    return found.stdout.strip()


def laid_out(commit: str) -> Path:
    """Folder with the files of a commit, from `git archive`."""
    whole = full_hash(commit)
    folder = BUILD / f"checkout-{whole[:7]}"
    if not (folder / "pyproject.toml").is_file():
        archive = subprocess.run(["git", "-C", str(HOME), "archive", whole], capture_output=True, check=True).stdout
        part = folder.with_suffix(f".{os.getpid()}")
        with tarfile.open(fileobj=BytesIO(archive)) as files:
            files.extractall(part, filter="data")
        part.rename(folder)
    return folder


def sides() -> tuple[Side, Side]:
    """The commit then and the present one, compiled. Raises NoCommit.

    What is not committed is not measured.
    """
    found: list[Side] = []
    for name, commit, module in (("then", THEN, "services"), ("now", "HEAD", "lacet")):
        side = Side(name, full_hash(commit)[:7], laid_out(commit), module)
        side.work.mkdir(exist_ok=True)
        found.append(side)
    _compile(found[0], sysconfig.get_path("stdlib"), "-x", "/(test|idlelib|site-packages)/")
    _compile(found[0], sysconfig.get_path("purelib"), *(side.folder for side in found))
    return found[0], found[1]


def _compile(side: Side, *words: object) -> None:
    """Compile folders into the folder of bytecode; files of packages that are for other Pythons are left out."""
    command = [sys.executable, "-m", "compileall", "-q", *map(str, words)]
    subprocess.run(command, env=side.environment, stdout=subprocess.DEVNULL, check=False)


def uncommitted() -> bool:
    """Whether tracked files differ from the present commit, which alone is measured."""
    words = ["git", "-C", str(HOME), "status", "--porcelain", "--untracked-files=no"]
    return bool(subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip())
