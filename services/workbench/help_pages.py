"""Help on the page: terms with a sentence each, pages of the documentation, and runs to try everything on."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from lacet.daq.errors import UsageError
from lacet.services.progress import planned
from lacet.services.render.terms import TERMS
from lacet.services.workbench.jobs import JobProgress
from lacet.services.workbench.refusals import NotThere
from lacet.services.workbench.run_files import FOLDER, RAW
from lacet.services.workbench.session_cache import SessionCache
from lacet.services.workspace.decode import decode_log, decoding_plan

_ROOT = Path(__file__).resolve().parents[2]
DOCS = _ROOT / "docs"
"""The documentation; a wheel has none."""
CAPTURES = _ROOT / "replay_logs" / "anti-roll-bars"
"""Captures of a simulated car with two hidden anti-roll bars; a wheel has none."""
EXAMPLES = {"used": ("sinus", "rough"), "held": ("spiral",)}
"""Role → captures that the tour brings in."""


def terms_payload() -> dict[str, Any]:
    """Every term by its key, with its page where there is one; and the runs of the tour, None where there are none."""
    return {
        "terms": {
            key: {"name": term.name, "says": term.says, "page": term.page if (DOCS / term.page).is_file() else None}
            for key, term in TERMS.items()
        },
        "examples": EXAMPLES if CAPTURES.is_dir() else None,
    }


def doc_page(name: str) -> str:
    """A page of the documentation, as it is written. Raises NotThere."""
    known = {file.name: file for file in DOCS.glob("*.md")}
    if name not in known:
        raise NotThere(f"there is no page '{name[:80]}' of the documentation here")
    return known[name].read_text(encoding="utf-8")


def bring_examples(cache: SessionCache, teller: JobProgress) -> dict[str, Any]:
    """Copy the tour's captures into the study's folder and decode those that are no runs yet."""
    if not CAPTURES.is_dir():
        raise UsageError("the example runs are in lacet's source folder, which is not here")
    for name in (name for names in EXAMPLES.values() for name in names):
        raw, out = cache.folder / RAW / f"{name}.mcap", cache.folder / FOLDER / f"{name}.mcap"
        if out.exists():
            continue
        for file in (raw, out):
            file.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(CAPTURES / raw.name, raw)
        teller.progress(planned(decoding_plan()))
        decode_log(raw, out, progress=teller.progress)
    return {"runs": EXAMPLES}
