"""Representations of the library's objects, as short texts for a prompt and small HTML tables for a notebook."""

from __future__ import annotations

import html
from collections.abc import Sequence

LONGEST = 1900
"""Length of the longest representation [characters]."""


def shortened(text: str) -> str:
    """A text, cut at the end of a line where it is longer than a representation may be."""
    if len(text) <= LONGEST:
        return text
    kept = text[: LONGEST - 40]
    kept = kept[: kept.rindex("\n")]
    return f"{kept}\n  … and {text.count(chr(10)) - kept.count(chr(10))} lines more"


def html_of(text: str) -> str:
    """Plain text as HTML."""
    return f"<pre>{html.escape(text)}</pre>"


def html_table(caption: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table as HTML, its first column left-aligned, the others right-aligned."""

    def line(cells: Sequence[str], tag: str) -> str:
        sides = ["left", *("right" for _ in cells[1:])]
        parts = [
            f'<{tag} style="text-align:{side}">{html.escape(cell)}</{tag}>'
            for side, cell in zip(sides, cells, strict=True)
        ]
        return f"<tr>{''.join(parts)}</tr>"

    body = "".join(line(row, "td") for row in rows)
    top = f"<caption>{html.escape(caption)}</caption><thead>{line(head, 'th')}</thead>"
    return f"<table>{top}<tbody>{body}</tbody></table>"
