"""The pages beside this file, from the docstrings of the installed packages: a page a room. Run by `make reference`.

Modules are parsed and not imported, so that a page needs nothing installed and is the same everywhere.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

HERE = Path(__file__).resolve().parent
HOME = HERE.parents[1]
PACKAGES = ("lacet", "daq", "drivers", "identify", "simulate", "services")
"""What is installed; `lacet` holds the others as links, which are not followed."""

NOTE = "<!-- Written by `make reference` from the docstrings: change those. -->\n"
Function = ast.FunctionDef | ast.AsyncFunctionDef


def first_sentence(node: ast.Module | ast.ClassDef | Function) -> str:
    """The first sentence of a docstring in Markdown; empty where there is none."""
    paragraph = " ".join((ast.get_docstring(node) or "").split("\n\n")[0].split())
    # A sentence ends at a full stop before a capital letter; the one of "e.g." is followed by none.
    sentence = re.split(r"(?<=[.!?])\s+(?=[A-ZΣ`(])", paragraph, maxsplit=1)[0]
    return sentence.replace("``", "`").replace("::", ":")


def arguments(function: Function, method: bool = False) -> str:
    """The signature of a function, without `self` and `cls` for a method."""
    args = ast.parse(f"def f({ast.unparse(function.args)}): ...").body[0]
    assert isinstance(args, ast.FunctionDef)
    static = any(ast.unparse(one) == "staticmethod" for one in function.decorator_list)
    if method and not static:
        (args.args.posonlyargs or args.args.args).pop(0)
    returns = f" -> {ast.unparse(function.returns)}" if function.returns is not None else ""
    return f"({ast.unparse(args.args)}){returns}"


def public(body: list[ast.stmt]) -> list[ast.ClassDef | Function]:
    """The classes and functions of a body whose names begin with no underscore; of overloads the last."""
    found = [node for node in body if isinstance(node, ast.ClassDef | Function) and not node.name.startswith("_")]
    return list({node.name: node for node in found}.values())


def fields(node: ast.ClassDef) -> str:
    """The arguments a class is made with: those of its `__init__`, or the fields of a data class or a named tuple."""
    for one in node.body:
        if isinstance(one, ast.FunctionDef) and one.name == "__init__":
            return arguments(one, method=True).partition(" -> ")[0]
    marks = [ast.unparse(one) for one in (*node.decorator_list, *node.bases)]
    if not any("dataclass" in one or one == "NamedTuple" for one in marks):
        return ""
    names = [ast.unparse(one.target) for one in node.body if isinstance(one, ast.AnnAssign)
             and "ClassVar" not in ast.unparse(one.annotation)]  # fmt: skip
    return f"({', '.join(name for name in names if not name.startswith('_'))})"


def entry(node: ast.ClassDef | Function) -> list[str]:
    """The lines of a page about one class, its methods included, or one function."""
    if not isinstance(node, ast.ClassDef):
        return [f"- `{node.name}{arguments(node)}`: {first_sentence(node)}"]
    out = [f"- *class* `{node.name}{fields(node)}`: {first_sentence(node)}"]
    for one in public(node.body):
        sentence = first_sentence(one)
        if isinstance(one, ast.ClassDef) or not sentence:
            continue
        attribute = any("property" in ast.unparse(mark) for mark in one.decorator_list)
        signature = "" if attribute else arguments(one, method=True)
        out.append(f"  - `{one.name}{signature}`: {sentence}")
    return out


def module(path: Path) -> list[str]:
    """The section of a page about one module; empty where it has nothing public."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    entries = [line for node in public(tree.body) for line in entry(node)]
    name = ".".join(("lacet", *(part for part in path.relative_to(HOME).with_suffix("").parts if part != "lacet")))
    name = name.removesuffix(".__init__")
    return [f"\n## `{name}`", f"{first_sentence(tree)}\n", *entries] if entries else []


def door() -> list[str]:
    """The lines of the page about ``import lacet``: each name it offers, where it is defined, and its sentence."""
    tree = ast.parse((HOME / "lacet" / "__init__.py").read_text(encoding="utf-8"))
    (offered,) = (
        ast.literal_eval(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "_NAMES"
    )
    out: dict[str, str] = {}
    for name, those in offered.items():
        file = HOME.joinpath(*name.split(".")[1:]).with_suffix(".py")
        defined = {node.name: node for node in public(ast.parse(file.read_text(encoding="utf-8")).body)}
        page = next(room for room, files in rooms().items() if file in files)
        for one in those:
            sentence = first_sentence(defined[one]) if one in defined else ""
            out[one] = f"- `lacet.{one}` ([`{name}`]({page}.md)): {sentence}"
    return ["", *(out[one] for one in sorted(out))]


def rooms() -> dict[str, list[Path]]:
    """The modules of each room by the page's name, the packages in their order."""
    out: dict[str, list[Path]] = {}
    for package in PACKAGES:
        folder = HOME / package
        files = folder.glob("*.py") if package == "lacet" else folder.rglob("*.py")
        for file in sorted(files, key=lambda file: (file.parent, file.name)):
            parts = file.relative_to(HOME).parts[:-1]
            if not file.name.endswith("_pb2.py"):
                # The families of effects and the kinds of transports are on the page of their room.
                out.setdefault("-".join(parts[:2]), []).append(file)
    return out


def pages() -> dict[str, str]:
    """Every page by its file name, the list of them as ``index.md``."""
    out: dict[str, str] = {}
    listed: list[str] = []
    for room, files in rooms().items():
        package = HOME.joinpath(*room.split("-"), "__init__.py")
        about = first_sentence(ast.parse(package.read_text(encoding="utf-8"))) if package.is_file() else ""
        sections = door() if room == "lacet" else [line for file in files for line in module(file)]
        if sections:
            title = "lacet" if room == "lacet" else f"lacet.{room.replace('-', '.')}"
            out[f"{room}.md"] = "\n".join([f"{NOTE}\n# {title}", about, *sections]) + "\n"
            listed.append(f"- [{title}]({room}.md): {about}")
    head = (
        f"{NOTE}\n# Reference\nEvery public class and function, by room: its signature and the first sentence about it."
    )
    out["index.md"] = "\n".join([f"{head} Terms: [glossary](../glossary.md).\n", *listed]) + "\n"
    return out


def write() -> None:
    """Write every page, and remove those of rooms that are gone."""
    new = pages()
    for old in HERE.glob("*.md"):
        if old.name not in new:
            old.unlink()
    for name, text in new.items():
        (HERE / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write()
