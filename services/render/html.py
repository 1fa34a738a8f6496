"""Elements of a self-contained HTML page."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import TYPE_CHECKING

from lacet.services.render.figures.panels import Panels
from lacet.services.render.figures.svg import STYLE as CHARTS
from lacet.services.render.figures.svg import figure_svg, svg
from lacet.services.render.tables import Table, bare_intervals

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 1180px; margin: 2rem auto; padding: 0 1rem; }
h1 { margin: 0; line-height: 1.2; } h2 { margin-top: 2.4rem; border-bottom: 1px solid #8886; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; font-size: 0.9rem; margin: 0.5rem 0; }
th, td { padding: 0.15rem 0.7rem; text-align: left; vertical-align: top; } th { border-bottom: 1px solid #8886; }
th.n, td.n { text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums; }
tbody tr:nth-child(even) { background: #8881; }
figure { margin: 1em 0; break-inside: avoid; } .big { font-size: 1.25rem; } .note { opacity: 0.8; }
details { margin: 0.6rem 0; } summary { cursor: pointer; } .fail { color: #b3261e; font-weight: 600; }
details.part { border-top: 1px solid #8886; margin: 0; padding: 0.5rem 0; }
.part > summary { font-weight: 600; font-size: 1.15rem; }
.first h2 { font-size: 1.05rem; margin: 1rem 0 0; border: 0; } .first ul { margin: 0.3rem 0; padding-left: 1.2rem; }
@media (prefers-color-scheme: dark) { .fail { color: #ff8a80; } }
@media print {
  @page { size: A4; margin: 12mm; } :root { color-scheme: light; }
  body { margin: 0; padding: 0; max-width: none; font-size: 9.5pt; line-height: 1.35; }
  h1 { font-size: 15pt; } .big { font-size: 11pt; } .first figure { margin: 0.4em 0; }
  table { font-size: 8.5pt; } tr { break-inside: avoid; }
  details.part { padding: 0.1rem 0; } .part > summary { font-size: 10pt; }
}
"""


def page(title: str, body: str, script: str = "", style: str = "") -> str:
    """A complete page; `script` draws what its body holds as data, with `style`."""
    ends = f"<script>{script}</script>\n" if script else ""
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>\n'
        f'<meta name="viewport" content="width=device-width"><style>{STYLE}{CHARTS}{style}</style></head>\n'
        f"<body>\n{body}\n{ends}</body></html>\n"
    )


def section(title: str, *pieces: str) -> str:
    """A section with its heading."""
    return f"<section><h2>{html.escape(title)}</h2>{''.join(pieces)}</section>"


def details(title: str, *pieces: str) -> str:
    """A section that is folded until opened."""
    return f"<details><summary>{html.escape(title)}</summary>{''.join(pieces)}</details>"


def folded(title: str, *pieces: str) -> str:
    """A part of a page that is folded until opened, with its heading."""
    return f'<details class="part"><summary>{html.escape(title)}</summary>{"".join(pieces)}</details>'


def table_html(found: Table) -> str:
    """A table, numbers to the right; the ± of half intervals is in their column's head: a sheet reads numbers."""
    found = bare_intervals(found)

    def line(tag: str, cells: Sequence[str]) -> str:
        parts = (
            f"<{tag}>{html.escape(cell)}</{tag}>" if k < found.text_columns
            else f'<{tag} class="n">{html.escape(cell)}</{tag}>'
            for k, cell in enumerate(cells)
        )  # fmt: skip
        return f"<tr>{''.join(parts)}</tr>"

    note = "".join(f'<p class="note">{html.escape(text.strip())}</p>' for text in found.note.splitlines())
    if not found.rows and note:
        return note
    body = "".join(line("td", cells) for cells in found.rows)
    return (
        f'<div class="scroll"><table><thead>{line("th", found.head)}</thead><tbody>{body}</tbody></table></div>{note}'
    )


def picture(drawn: Panels | Figure) -> str:
    """A picture within the page."""
    return f"<figure>{svg(drawn) if isinstance(drawn, Panels) else figure_svg(drawn)}</figure>"
