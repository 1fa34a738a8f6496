"""Failure analysis of a model as sections of HTML and as one self-contained file."""

from __future__ import annotations

import html
from collections.abc import Sequence

from lacet.identify.validation.failure_analysis import FailureAnalysis
from lacet.services.render.failure_text import explainable_table, failure_sentences, follows_table, phase_table
from lacet.services.render.figures.failure_plots import (
    against_charts,
    explainable_figure,
    map_figure,
    phase_figure,
    spectrum_charts,
    surface_figure,
)
from lacet.services.render.html import details, page, picture, section, table_html

MOST_ROWS = 3
"""Number of rows shown in pictures; the others are in the tables."""


def where_pieces(found: FailureAnalysis) -> list[str]:
    """The failure analysis as sections of HTML, the map first; one line where nothing fails or is unexplained."""
    unexplained = any(x.something or x.depends_on_history for x in found.explainable.values())
    if not found.failing and not unexplained:
        return [f"<p>{html.escape(failure_sentences(found))}</p>"]
    out = [
        f'<p class="big">{html.escape(failure_sentences(found))}</p>',
        picture(map_figure(found.parts, found.phases)),
        f"<h3>By phase</h3>{picture(phase_figure(found.in_phase))}",
        details("the table", table_html(phase_table(found))),
    ]
    if found.explainable:
        out += [
            f"<h3>How much is left to explain</h3>{picture(explainable_figure(found.explainable))}",
            table_html(explainable_table(found)),
        ]
    out.append(f"<h3>What the error follows</h3>{table_html(follows_table(found))}")
    for k, row in enumerate(found.worst[:MOST_ROWS]):
        own: list[str] = []
        if against := found.against[row]:
            own.append(picture(against_charts(against)))
        if row in found.spectra:
            own.append(picture(spectrum_charts(found.spectra[row])))
        # Some thirty panels take seconds to lay out, hence for the worst row only.
        if k == 0 and found.against_every:
            own.append(details(f"{row} against every state", picture(against_charts(found.against_every))))
        out += own if k == 0 else [details(row, *own)]
    if found.surfaces:
        out.append(f"<h3>Restoring-force surfaces</h3>{picture(surface_figure(found.surfaces))}")
        out.append(details("the whole force", picture(surface_figure(found.surfaces, "force"))))
    return out


def where_page(found: FailureAnalysis, name: str, number: int, effects: Sequence[str]) -> str:
    """One self-contained HTML page on version `number` of study `name`, with `effects` beyond the base model."""
    added = ", ".join(effects) or "nothing"
    head = (
        f"<h1>{html.escape(name)}: where the model fails</h1>"
        f'<p class="note">version {number}; added to the base model: {html.escape(added)}</p>'
    )
    return page(f"lacet where: {name}", head + section("Where it fails", *where_pieces(found)))
