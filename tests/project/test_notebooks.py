"""Notebooks in docs: made from their scripts, small, of code that compiles; executed anew when slow."""

from __future__ import annotations

import ast
import importlib.util
import inspect
import json
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import lacet
from lacet.services.library.pictures import Picture
from tests.support.places import HOME

FOLDER = HOME / "docs" / "notebooks"
SCRIPTS = sorted(file for file in FOLDER.glob("*.py") if file.stem != "build")
every_notebook = pytest.mark.parametrize("script", SCRIPTS, ids=lambda file: file.stem)
RESULTS = (lacet.Runs, lacet.Fit, lacet.Comparison, lacet.Ranking, Picture)


def builder() -> ModuleType:
    """docs/notebooks/build.py."""
    spec = importlib.util.spec_from_file_location("build_notebooks", FOLDER / "build.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def notebook(script: Path) -> dict[str, Any]:
    return json.loads(script.with_suffix(".ipynb").read_text(encoding="utf-8"))


def source(cell: dict[str, Any]) -> str:
    return "".join(cell["source"])


def test_there_is_one() -> None:
    assert SCRIPTS


@every_notebook
def test_its_cells_are_the_script_s(script: Path) -> None:
    """When this fails: `make notebook`."""
    found = [(cell["cell_type"], source(cell)) for cell in notebook(script)["cells"]]
    assert found == [(cell.cell_type, cell.source) for cell in builder().read(script).cells]


@every_notebook
def test_it_is_small_was_executed_from_top_to_bottom_and_has_pictures(script: Path) -> None:
    assert script.with_suffix(".ipynb").stat().st_size < builder().MOST_BYTES
    cells = [cell for cell in notebook(script)["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell["outputs"]]
    assert not [output for output in outputs if output["output_type"] == "error"]
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 5


@every_notebook
def test_its_code_compiles_and_names_what_lacet_has(script: Path) -> None:
    used: set[str] = set()
    for cell in notebook(script)["cells"]:
        if cell["cell_type"] != "code":
            continue
        for node in ast.walk(ast.parse(source(cell))):
            if not isinstance(node, ast.Attribute):
                continue
            if isinstance(node.value, ast.Name) and node.value.id == "lacet":
                assert node.attr in lacet.__all__
                used.add(node.attr)
            elif node.attr in ("plot", "plot_map", "explain", "summary"):
                owners = [one for one in RESULTS if callable(getattr(one, node.attr, None))]
                assert owners, node.attr
    assert {"load_runs", "fit", "compare", "rank", "add", "waterfall"} <= used
    for owner, name in ((lacet.Comparison, "plot"), (lacet.Comparison, "plot_map"), (lacet.Ranking, "plot")):
        assert inspect.getdoc(getattr(owner, name))


@pytest.mark.slow  # a minute and more
@every_notebook
def test_it_runs(script: Path) -> None:
    build = builder()
    done = build.execute(build.read(script))
    text = "".join(output.get("text", "") for cell in done.cells if cell.cell_type == "code" for output in cell.outputs)
    assert "anti_roll_bar.front and anti_roll_bar.rear are missing" in text
