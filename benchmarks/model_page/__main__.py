"""Draw the pictures of ``docs/model.md`` anew: ``python -m benchmarks.model_page`` (a second)."""

from __future__ import annotations

from benchmarks.model_page.pictures import PICTURES, pictures
from benchmarks.model_page.style import save

if __name__ == "__main__":
    PICTURES.mkdir(parents=True, exist_ok=True)
    for name, figure in pictures().items():
        save(figure, PICTURES / f"{name}.svg")
        print(f"wrote {PICTURES / name}.svg")
