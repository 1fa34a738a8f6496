"""Settings of the documentation site: the pages of this folder, by the kinds that index.md lists them under."""

from __future__ import annotations

import re
from importlib.metadata import version as installed
from pathlib import Path

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

HERE = Path(__file__).parent

project = "lacet"
author = "the lacet developers"
version = release = installed("lacet")
extensions = ["myst_nb"]
source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb"}
html_theme = "furo"
html_title = "lacet"
html_show_copyright = False
html_theme_options = {"navigation_with_keys": True}
html_search_scorer = str(HERE / "search_order.js")
exclude_patterns = ["reference/generate.py", "notebooks/build.py"]
# Notebooks are kept with their results: `make notebook` runs them, and a test compares.
nb_execution_mode = "off"
myst_heading_anchors = 4

_KIND = re.compile(r"^\*\*(?P<kind>[^*]+)\*\*", re.MULTILINE)
_LINK = re.compile(r"\]\((?P<page>[^)#:]+?)(?:\.md|\.ipynb)\)")
_OUTSIDE = re.compile(r"\]\((?P<file>(?:\.\./)+[^)#:]+\.md)\)")
_NAMED = re.compile(
    r"\[(?P<name>[\w/-]+\.(?:md|ipynb))\]\((?P<page>(?!(?:\.\./)+[A-Z])(?:[\w./-]+/)?(?P=name)(?:#[\w-]+)?)\)"
)
"""A link that shows the name of a page's file."""
_FENCES = ("wire", "csv")
"""Kinds of blocks for which there is no highlighting."""


def kinds_of(text: str) -> dict[str, list[str]]:
    """Kind of pages → the pages that index.md links to under it, in order, each under the first kind that has it."""
    out: dict[str, list[str]] = {}
    seen: set[str] = set()
    parts = _KIND.split(text)
    for kind, part in zip(parts[1::2], parts[2::2], strict=True):
        pages = [page for page in dict.fromkeys(_LINK.findall(part)) if page not in seen]
        seen.update(pages)
        if pages:
            out[kind] = pages
    return out


def _contents(page: str, text: str) -> dict[str, list[str]]:
    """Heading → pages below `page` in the site's navigation."""
    beside = sorted(one.stem for one in (HERE / page).parent.glob("*.md") if one.stem != (HERE / page).name)
    match page:
        case "index":
            decisions = sorted(f"decisions/{one.stem}" for one in (HERE / "decisions").glob("*.md"))
            return {**kinds_of(text), "Decisions": decisions}
        case "reference/index" | "wires/README":
            return {"Pages": beside}
        case _:
            return {}


def _for_the_site(app: Sphinx, page: str, source: list[str]) -> None:
    """What only the site needs: navigation, titles for names of files, pages outside this folder as downloads."""
    text = source[0]

    def link(found: re.Match[str]) -> str:
        inside = ((HERE / page).parent / found["file"]).resolve().is_relative_to(HERE.resolve())
        return found[0] if inside else f"](path:{found['file']})"

    for kind, pages in _contents(page, text).items():
        text += f"\n\n```{{toctree}}\n:hidden:\n:caption: {kind}\n\n" + "\n".join(pages) + "\n```\n"
    source[0] = _OUTSIDE.sub(link, _NAMED.sub(r"[](\g<page>)", text))


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    for name in _FENCES:
        app.add_lexer(name, TextLexer)
    app.connect("source-read", _for_the_site)
