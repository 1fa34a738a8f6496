"""Elements of a self-contained HTML page."""

from __future__ import annotations

import base64
import html

from matplotlib.figure import Figure

from lacet.services.render.figures.study_plots import png

STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 1180px; margin: 2rem auto; padding: 0 1rem; }
h1 { margin-bottom: 0; } h2 { margin-top: 2.4rem; border-bottom: 1px solid #8886; }
table { border-collapse: collapse; font-size: 0.9rem; } th, td { padding: 0.15rem 0.7rem; text-align: right; }
th:first-child, td:first-child, td.text, th.text { text-align: left; } tr:nth-child(even) { background: #8881; }
img { max-width: 100%; background: white; } .big { font-size: 1.25rem; } .note { opacity: 0.8; }
details { margin: 0.6rem 0; } summary { cursor: pointer; } .fail { color: #b3261e; font-weight: 600; }
@media (prefers-color-scheme: dark) { .fail { color: #ff8a80; } }
"""


def page(title: str, body: str) -> str:
    """A complete page."""
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>\n'
        f'<meta name="viewport" content="width=device-width"><style>{STYLE}</style></head>\n'
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


def picture(figure: Figure) -> str:
    """A figure embedded in the page."""
    data = base64.b64encode(png(figure)).decode("ascii")
    return f'<p><img alt="" src="data:image/png;base64,{data}"></p>'
