"""The notebooks beside this file, executed, from the scripts of the same names. Run by `make notebook`."""

from __future__ import annotations

import sys
from pathlib import Path

import jupytext
from nbclient import NotebookClient
from nbformat import NotebookNode

HERE = Path(__file__).resolve().parent
HOME = HERE.parents[1]
MOST_BYTES = 1_000_000
"""Largest size of a notebook with its outputs."""


def scripts() -> list[Path]:
    """The scripts: all Python files here but this one."""
    return sorted(file for file in HERE.glob("*.py") if file != Path(__file__).resolve())


def read(script: Path) -> NotebookNode:
    """The notebook of a script, not executed: cells and the same names of them each time."""
    found = jupytext.read(script)
    for number, cell in enumerate(found.cells):
        cell.id = f"cell-{number}"
    found.metadata = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    found.nbformat, found.nbformat_minor = 4, 5
    return found


def execute(notebook: NotebookNode) -> NotebookNode:
    """Execute it in the top folder of the checkout. Raises CellExecutionError with the cell at fault."""
    NotebookClient(notebook, timeout=1800, kernel_name="python3", resources={"metadata": {"path": str(HOME)}}).execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)  # times, which differ each time
    return notebook


def main() -> int:
    """Write every notebook; 1 when one is too large."""
    for script in scripts():
        text = jupytext.writes(execute(read(script)), fmt="ipynb")
        if len(text) > MOST_BYTES:
            print(f"{script.stem}: {len(text)} bytes with its outputs, {MOST_BYTES} at most")
            return 1
        script.with_suffix(".ipynb").write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
