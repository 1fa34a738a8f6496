"""The first page of a study's report in HTML and in Markdown."""

from __future__ import annotations

import html
from collections.abc import Sequence

from lacet.services.render.html import picture, table_html
from lacet.services.render.report_summary import Summary
from lacet.services.render.tables import Table, bare_intervals

_FALLS, _SIZES, _OPEN, _RUNS = "How well it predicts", "What was added", "What stays open", "Runs"
"""Headings of the first page."""


def first_page(found: Summary) -> str:
    """The first page as HTML."""
    about = " · ".join(f"{html.escape(label)}: {html.escape(text)}" for label, text in found.about)
    pieces = [
        f"<h1>{html.escape(found.title)}</h1>",
        f'<p class="note">{about}</p>',
        f'<p class="big">{html.escape(found.verdict)}</p>',
        f"<p>{html.escape(found.fall)}</p>",
    ]
    if found.sizes is not None:
        pieces.append(f"<h2>{_SIZES}</h2>{table_html(found.sizes)}")
    pieces += [
        picture(found.picture),
        f"<h2>{_FALLS}</h2>{table_html(found.errors)}",
        f"<h2>{_OPEN}</h2><ul>{''.join(f'<li>{html.escape(line)}</li>' for line in found.open)}</ul>",
        f"<h2>{_RUNS}</h2>{table_html(found.runs)}",
    ]
    return f'<section class="first">{"".join(pieces)}</section>'


def markdown(found: Summary, picture_file: str, parts: Sequence[tuple[str, Table]]) -> str:
    """The first page and further tables as Markdown; `picture_file` : the picture beside it, or empty."""
    pieces = [
        f"# {_plain(found.title)}",
        "\n".join(f"- {label}: {_plain(text)}" for label, text in found.about),
        f"**{_plain(found.verdict)}**",
        _plain(found.fall),
    ]
    if found.sizes is not None:
        pieces += [f"## {_SIZES}", table_markdown(found.sizes)]
    if picture_file:
        pieces.append(f"![{_plain(found.picture.title)}, before and after]({picture_file})")
    pieces += [
        f"## {_FALLS}", table_markdown(found.errors),
        f"## {_OPEN}", "\n".join(f"- {_plain(line)}" for line in found.open),
        f"## {_RUNS}", table_markdown(found.runs),
    ]  # fmt: skip
    for title, table in parts:
        pieces += [f"## {title}", table_markdown(table)]
    return "\n\n".join(pieces) + "\n"


def table_markdown(found: Table) -> str:
    """A table in Markdown, numbers to the right."""
    found = bare_intervals(found)
    lines = [
        _line(found.head),
        _line(["---" if k < found.text_columns else "---:" for k in range(len(found.head))], plain=False),
        *map(_line, found.rows),
    ]
    table = "\n".join(lines) if found.rows else ""
    note = "  \n".join(_plain(line.strip()) for line in found.note.splitlines())
    return "\n\n".join(part for part in (table, note) if part)


def _line(cells: Sequence[str], plain: bool = True) -> str:
    return f"| {' | '.join(_plain(cell) if plain else cell for cell in cells)} |"


def _plain(text: str) -> str:
    """Text whose signs mean nothing in Markdown."""
    for sign in "\\`*_|<>[]":
        text = text.replace(sign, f"\\{sign}")
    return text
