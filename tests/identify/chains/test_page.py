"""docs/identify-chain.md: every Python block runs, on the TX40's own data."""

import os
import re

import pytest

from tests.support.places import HOME


def test_the_page_is_true(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """53 of 60 published parameters within one published σ, held-out error printed, the missing laws named."""
    page = (HOME / "docs" / "identify-chain.md").read_text(encoding="utf-8")
    monkeypatch.chdir(os.fspath(HOME))
    blocks = re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert len(blocks) == 2
    for block in blocks:
        exec(compile(block, "docs/identify-chain.md", "exec"), {})
    assert "held out: error ÷ floor" in capsys.readouterr().out
