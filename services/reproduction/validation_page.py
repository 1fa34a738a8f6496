"""The page of a campaign's validation, as the paper's figures 4 to 10: direct and cross validation side by side."""

from __future__ import annotations

import html
from collections.abc import Sequence

from lacet.identify.validation.score import Comparison
from lacet.services.render.figures.study_plots import side_by_side_charts
from lacet.services.render.html import page, picture, section


def validation_page(about: str, used: Sequence[Comparison], held: Comparison) -> str:
    """The page of runs `used` (direct validation), each beside the one `held` out (cross validation)."""
    title = "Direct and cross validation"
    sides = f"Left: a run that the fit used. Right: {html.escape(held.name)}, held out"
    curves = "Black: measured. Red: modelled. Blue: the error, drawn about the measured mean"
    lead = f"<h1>{title}</h1><p>{html.escape(about)}. {sides}. {curves}.</p>"
    each = (section(f"{part.name} and {held.name}", picture(side_by_side_charts(part, held))) for part in used)
    return page(title, lead + "".join(each))
