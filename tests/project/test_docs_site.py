"""The documentation site is built without a warning, has every page in its navigation and can be searched."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

from tests.support.places import HOME

DOCS = HOME / "docs"


def built(source: Path, out: Path) -> subprocess.CompletedProcess[str]:
    """`make docs` of a folder."""
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", str(source), str(out)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_the_site_has_every_page_and_needs_no_network(tmp_path: Path) -> None:
    done = built(DOCS, tmp_path)
    assert done.returncode == 0, done.stderr
    pages = {one.relative_to(DOCS).with_suffix(".html") for kind in ("md", "ipynb") for one in DOCS.rglob(f"*.{kind}")}
    assert {one.relative_to(tmp_path) for one in tmp_path.rglob("*.html")} >= pages
    index = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert re.findall(r'caption-text">([^<]+)<', index)[:4] == ["Start", "How to", "Explanation", "Reference"]
    assert ">The workbench<" in index
    shown = "".join(page.read_text(encoding="utf-8") for page in tmp_path.glob("*.html"))
    links = re.findall(r'<a class="reference internal" href="[^"]*"><span class="[^"]*">([^<]+)<', shown)
    assert "Axes" in links  # of [channels.md](channels.md#axes)
    assert [link for link in links if link.endswith((".md", ".ipynb")) and link != "report.md"] == []
    assert "LOOKED_UP.some" in (tmp_path / "_static" / "language_data.js").read_text(encoding="utf-8")
    assert "latency" in (tmp_path / "searchindex.js").read_text(encoding="utf-8")
    assert not re.findall(r'(?:src|<link[^>]*href)="https?:', index)


def test_a_broken_link_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "decisions").mkdir()
    for file in ("conf.py", "search_order.js"):
        shutil.copy(DOCS / file, tmp_path)
    (tmp_path / "other.md").write_text("# Other\n")
    (tmp_path / "index.md").write_text("# Pages\n\n**Start**\n- [x](other.md)\n- [y](absent.md)\n")
    done = built(tmp_path, tmp_path / "out")
    assert done.returncode == 1
    faults = [line for line in done.stderr.splitlines() if "WARNING" in line]
    assert [line for line in faults if "'absent.md'" in line], done.stderr
    assert [line for line in faults if "absent" not in line] == []
