"""The door: what `import lacet` offers is small, lazy, documented, and every example runs."""

from __future__ import annotations

import ast
import doctest
import inspect
import re
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import pytest

import lacet
from lacet.identify.properties.sums_of_places import SumOfPlaces
from tests.support.few_effects import KEYS
from tests.support.places import HOME

MOST = 41
"""Names of the door."""
LONGEST = 2000
"""Characters of any representation."""


def test_the_door_is_small_and_its_stub_says_the_same() -> None:
    assert len(lacet.__all__) <= MOST
    stub = ast.parse((HOME / "lacet" / "__init__.pyi").read_text(encoding="utf-8"))
    imported = {
        alias.name: node.module for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    assert sorted(imported) == lacet.__all__
    assert imported == lacet._MODULE_OF
    (listed,) = (node for node in stub.body if isinstance(node, ast.Assign))
    assert ast.literal_eval(listed.value) == lacet.__all__


def test_nothing_is_loaded_until_it_is_used() -> None:
    asked = "import sys, lacet; dir(lacet); print(sorted({'numpy', 'scipy', 'lacet.identify'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True).stdout.strip() == "[]"


def test_a_name_that_is_not_there_is_refused() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'fitt'"):
        lacet.__getattr__("fitt")


def test_nothing_inside_imports_from_the_door() -> None:
    wrong: list[str] = []
    for file in (HOME / "lacet").glob("*/**/*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module == "lacet":
                wrong += [f"{file}: {alias.name}" for alias in node.names if alias.name in lacet.__all__]
            elif isinstance(node, ast.Import):
                wrong += [f"{file}: import lacet" for alias in node.names if alias.name == "lacet"]
    assert wrong == []


@pytest.mark.parametrize("name", lacet.__all__)
def test_every_name_has_a_docstring_with_an_example_that_runs(
    name: str, checkout: Path, runs: lacet.Runs, fitted: lacet.Fit, ranking: lacet.Ranking,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(checkout)
    text = inspect.getdoc(getattr(lacet, name)) or ""
    assert re.search(r"^Examples\n-+$", text, re.MULTILINE), f"lacet.{name} has no section of examples"
    known = {"lacet": lacet, "Path": Path, "runs": runs, "fitted": fitted, "ranking": ranking}
    test = doctest.DocTestParser().get_doctest(text, known, name, None, 0)
    assert test.examples, f"lacet.{name} has no example"
    told: list[str] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test, out=told.append)
    assert told == []


def test_representations_are_useful_and_short(runs: lacet.Runs, fitted: lacet.Fit, ranking: lacet.Ranking) -> None:
    comparison = lacet.compare(fitted, draws=3)
    for one in (runs, fitted, comparison, ranking, fitted.details, fitted.model, runs.prepared[0], comparison["sine"]):
        assert 20 < len(repr(one)) < LONGEST, (type(one), len(repr(one)))
        assert " object at 0x" not in repr(one), type(one)
    assert "spring.fl.k = " in repr(fitted)
    assert "sine" in repr(runs)
    assert "suspension.fl" in repr(comparison)
    assert "anti_roll_bar.front" in repr(ranking)
    for one in (fitted, comparison, ranking):
        html = one._repr_html_()
        assert html.startswith("<table>")
        assert html.count("<tr>") == html.count("</tr>") > 2


def test_loading_makes_the_checks_of_the_command_line(checkout: Path, tmp_path: Path) -> None:
    """Wheels exchanged at the wires are told, and their loads left out."""
    from tests.services.commands.test_bad_input import exchanged
    from tests.support.tables import piece, written

    car = checkout / "tests" / "data" / "car"
    file = written(exchanged(piece(), "fl", "fr"), tmp_path / "run.parquet")
    with pytest.warns(lacet.LoadingWarning, match="exchanged"):
        found = lacet.load_runs(file, rig=car / "rig.toml", vehicle=car / "vehicle.toml")
    assert "exchanged" in repr(found)


def test_the_readmes_ten_lines_run(checkout: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    """As they stand in the README, on shorter runs and with a shorter catalogue."""
    whole = lacet.catalogue

    def shorter(runs: lacet.Runs) -> dict[str, lacet.Effect]:
        return {key: effect for key, effect in whole(runs).items() if effect.base or key in KEYS}

    monkeypatch.setattr("lacet.services.library.rankings.catalogue", shorter)
    (block,) = re.findall(r"^```python\n(.*?)^```$", (HOME / "README.md").read_text(encoding="utf-8"), re.M | re.S)
    assert len([line for line in block.splitlines() if line.strip()]) <= 12
    monkeypatch.chdir(checkout)
    known: dict[str, object] = {}
    exec(compile(block, "README.md", "exec"), known)  # what a reader would type
    printed = capsys.readouterr().out
    assert "spring.fl.k" in printed
    assert "anti_roll_bar.front and anti_roll_bar.rear are missing" in printed
    before, after = (float(value) for value in re.findall(r"noise floor, ([\d.]+) over all rows", printed))
    assert before > 5.0
    assert after < 2.0  # both bars, where the first alone leaves more


def test_nothing_proposed_is_no_effect_to_add(fitted: lacet.Fit) -> None:
    for nothing in (None, ()):
        with pytest.raises(lacet.UsageError, match="no effect to add"):
            lacet.add(fitted, nothing)


def test_a_sum_of_places_brings_its_effects_once(fitted: lacet.Fit, ranking: lacet.Ranking) -> None:
    front, rear = ranking.missing
    total = SumOfPlaces((front.key, rear.key), "k", "N/m", 34e3, 1e3, 1e3, True)
    both = lacet.add(fitted, [replace(front, total=total), rear])
    assert {one.key for one in both.model.effects} - {one.key for one in fitted.model.effects} == set(total.keys)
    with pytest.raises(lacet.UsageError, match="already"):
        lacet.add(both, ranking.missing)


def test_an_effect_is_added_with_the_options_of_the_fit(runs: lacet.Runs) -> None:
    robust = lacet.fit(lacet.base_model(runs), runs, robust=True)
    assert lacet.add(robust, "anti_roll_bar.front").details.options == robust.details.options


def test_runs_with_loads_at_another_point_are_not_compared(fitted: lacet.Fit, runs: lacet.Runs) -> None:
    prepared = [replace(run.recording, reference="contact") for run in runs]
    loaded = replace(runs.loaded, prepared=tuple(type(runs.prepared[0])(one) for one in prepared))
    with pytest.raises(lacet.UsageError, match="wheel loads"):
        lacet.compare(fitted, replace(runs, loaded=loaded))


def test_runs_in_a_list_are_refused_with_the_remedy() -> None:
    with pytest.raises(lacet.UsageError, match=r"load_runs\(\*paths\)"):
        lacet.load_runs(["one.parquet", "two.parquet"])  # type: ignore[arg-type]
