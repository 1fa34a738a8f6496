"""Elements of a self-contained HTML page."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING

from lacet.services.render.figures.panels import Panels
from lacet.services.render.figures.svg import STYLE as CHARTS
from lacet.services.render.figures.svg import figure_svg, svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 1180px; margin: 2rem auto; padding: 0 1rem; }
h1 { margin-bottom: 0; } h2 { margin-top: 2.4rem; border-bottom: 1px solid #8886; }
table { border-collapse: collapse; font-size: 0.9rem; } th, td { padding: 0.15rem 0.7rem; text-align: right; }
th:first-child, td:first-child, td.text, th.text { text-align: left; } tr:nth-child(even) { background: #8881; }
figure { margin: 1em 0; break-inside: avoid; } .big { font-size: 1.25rem; } .note { opacity: 0.8; }
details { margin: 0.6rem 0; } summary { cursor: pointer; } .fail { color: #b3261e; font-weight: 600; }
@media (prefers-color-scheme: dark) { .fail { color: #ff8a80; } }
@media print { @page { size: A4 landscape; margin: 12mm; } body { margin: 0; max-width: none; } }
"""


def page(title: str, body: str) -> str:
    """A complete page."""
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>\n'
        f'<meta name="viewport" content="width=device-width"><style>{STYLE}{CHARTS}</style></head>\n'
        f"<body>\n{body}\n</body></html>\n"
    )


def section(title: str, *pieces: str) -> str:
    """A section with its heading."""
    return f"<section><h2>{html.escape(title)}</h2>{''.join(pieces)}</section>"


def details(title: str, *pieces: str) -> str:
    """A section that is folded until opened."""
    return f"<details><summary>{html.escape(title)}</summary>{''.join(pieces)}</details>"


def pre(text: str) -> str:
    """Preformatted text."""
    return f"<pre>{html.escape(text)}</pre>"


def picture(drawn: Panels | Figure) -> str:
    """A picture within the page."""
    return f"<figure>{svg(drawn) if isinstance(drawn, Panels) else figure_svg(drawn)}</figure>"
