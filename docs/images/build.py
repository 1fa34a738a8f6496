"""Draw the picture of README and start page anew from the study of ``make demo``: ``python docs/images/build.py``."""

from __future__ import annotations

import sys
from pathlib import Path

from lacet.services.render.figures.png import png
from lacet.services.render.figures.study_plots import fall_figure
from lacet.services.workspace.study import Study

PICTURE = Path(__file__).parent / "error-falls.png"


def main(study: str = "demo-out/study", picture: Path = PICTURE) -> None:
    """Write how the error of a study fell, version by version."""
    picture.write_bytes(png(fall_figure(Study.open(Path(study)).versions())))
    print(f"wrote {picture}")


if __name__ == "__main__":
    main(*sys.argv[1:2])
