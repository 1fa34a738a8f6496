"""The pictures of the stories anew, into docs/images/stories: ``python -m benchmarks.stories`` (2 minutes).

Each page is played in a temporary folder; its pictures are of the study it makes.
"""

from __future__ import annotations

import argparse
import contextlib
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

from matplotlib.figure import Figure

from benchmarks.stories.page import STORIES, play, steps
from lacet.identify.validation.restoring_force import restoring_surfaces
from lacet.services.render.figures.failure_plots import surface_figure
from lacet.services.render.figures.png import png
from lacet.services.render.figures.study_plots import fall_figure
from lacet.services.workspace.session import Session
from lacet.services.workspace.study import Study

IMAGES = STORIES.parent / "images" / "stories"


def fall() -> Figure:
    """Error ÷ floor by version."""
    figure = fall_figure(Study.open(Path("bars")).versions())
    (axes,) = figure.axes
    axes.set_xticks(axes.get_xticks(), [label.get_text().replace("added ", "") for label in axes.get_xticklabels()])
    axes.tick_params(axis="x", labelsize=8)
    return figure


def surface() -> Figure:
    """Restoring-force surfaces of the base model's error."""
    study = Study.open(Path("groove")).go_to(1)
    return surface_figure(restoring_surfaces(Session(study).values.fitted(study.version())))


PICTURES: Mapping[str, tuple[str, Callable[[], Figure]]] = {
    "bars-and-friction.md": ("bars-and-friction.png", fall),
    "an-effect-of-ones-own.md": ("groove-surface.png", surface),
}
"""Page → its picture's name and how it is drawn, in the folder where the page was played."""


def main() -> None:
    """Play and draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.parse_args()
    IMAGES.mkdir(parents=True, exist_ok=True)
    for page, (name, draw) in PICTURES.items():
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            for step in steps(page):
                print(play(step), end="", flush=True)
            (IMAGES / name).write_bytes(png(draw()))
        print(IMAGES / name)


if __name__ == "__main__":
    main()
