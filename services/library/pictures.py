"""Pictures of the library's results, which a notebook shows and a file keeps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from lacet.daq.errors import UsageError
from lacet.daq.parts import require


class Compared(Protocol):
    """What a step of a waterfall is: a comparison, by its error ÷ noise floor over all rows and runs."""

    @property
    def overall(self) -> float: ...


@dataclass(frozen=True)
class Picture:
    """A picture: shown by a notebook as the last value of a cell, written to a file by `save`.

    Attributes
    ----------
    title : what is drawn.
    png : its bytes.
    """

    title: str
    png: bytes = field(repr=False)

    def _repr_png_(self) -> bytes:
        return self.png

    def save(self, path: str | Path) -> Path:
        """Write it. Raises UsageError when the name does not end with .png, and when it cannot be written."""
        path = Path(path)
        if path.suffix.lower() != ".png":
            raise UsageError(f"{path}: pictures are PNG; give a name that ends with .png")
        try:
            path.write_bytes(self.png)
        except OSError as error:
            raise UsageError(f"{path}: cannot be written: {error.strerror}") from None
        return path


def drawn(title: str, draw: Callable[[], bytes]) -> Picture:
    """The picture that `draw` makes. Raises MissingPart without the part ``plots``."""
    require("plots")
    return Picture(title, draw())


def waterfall(steps: Mapping[str, Compared]) -> Picture:
    """Draw how the error ÷ noise floor fell from one comparison to the next.

    Parameters
    ----------
    steps : label → comparison with the same runs, in the order in which effects were added.

    Raises UsageError for fewer than two steps.

    Examples
    --------
    >>> comparison = lacet.compare(fitted)
    >>> better = lacet.compare(lacet.add(fitted, "anti_roll_bar.front"))
    >>> lacet.waterfall({"base model": comparison, "front bar": better})
    Picture(title='error ÷ noise floor: base model → front bar')
    """
    if len(steps) < 2:
        raise UsageError("a waterfall has two steps at least: the base model's comparison, and one with an effect more")

    def draw() -> bytes:
        from lacet.services.render.figures.png import png
        from lacet.services.render.figures.result_plots import waterfall_figure

        return png(waterfall_figure({name: one.overall for name, one in steps.items()}))

    return drawn(f"error ÷ noise floor: {' → '.join(steps)}", draw)
