"""The words of lacet: terms of the field in names, docstrings, messages and pages; each public name is explained."""

from __future__ import annotations

import ast
import io
import itertools
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.places import HOME

PACKAGES = ("lacet", "daq", "drivers", "identify", "services", "simulate")
"""What is installed; the folders in `lacet` are links to the others."""

PYTHON = sorted(
    file
    for package in PACKAGES
    for file in ((HOME / package).glob("*.py") if package == "lacet" else (HOME / package).rglob("*.py"))
    if not file.name.endswith("_pb2.py")
)
SCRIPTS = sorted(file for file in (HOME / "services").rglob("*.js") if "vendor" not in file.parts)
PAGES = sorted(
    [file for file in (HOME / "docs").rglob("*.md") if "benchmarks" not in file.parts]
    + list((HOME / "services").rglob("*.html"))
)
"""Pages in docs/benchmarks are written by measurements that take hours, in the words of the version measured."""

TEXT: dict[str, str] = {
    r"\b(tak(e|es|en|ing)|took) (it |them |this )?out\b": "removed; nuisance parameters removed",
    r"\bpartial+(led|ling|s out)\b": "nuisance parameters removed; partial regression",
    r"\bexcus(e|es|ed|ing)\b": "within the sensor tolerances",
    r"\b(tak(e|es|en|ing)|took) (it |them |so much |this )?up\b": "within the sensor tolerances",
    r"\bfreed\b": "tested without its own tolerance",
    r"\bstrain(s|ed|ing)?\b": "tolerance test failed",
    r"(?<!parameter )\bconstancy\b": "parameter constancy (Chow test)",
    r"\b(a|an|one|first|second|next|last|closer|this|that|the|each|every) look\b": "screening; re-linearised screening",
    r"\b(closer|first|further) looks\b": "re-linearised screening",
    r"\bpull(s|ed|ing)?\b": "a term of the field: the prior's right side, a force",
    r"\btemper(s|ed|ing)?\b": "a term of the field: scaled prior",
    r"\b(tells?|telling|told)\b": "shows, says, determines, distinguishes, reports",
    r"\bnews\b": "events, messages, progress",
    r"\bleft (over|by|after|to explain|to find|in the residual)\b": "residual, unexplained, remaining",
    r"\b(is|are|was|were|be|nothing|what|much|any|none) left\b(?! (and|out|side|alone|free|open|empty|aside)|, right)":
        "residual, unexplained, remaining",
    r"\blargest drop over all candidates\b": "max-score statistic",
    r"\bnoise (does )?through the law\b": "errors-in-variables correction of the score",
}  # fmt: skip
"""Words that lacet once had for itself, and the field's."""

ALLOWED: dict[str, str] = {
    r"\b(tells?|telling|told) (?:\S+ ){0,5}?(apart|from)\b": "plain English for: to distinguish",
    r"\bstrain gauges?\b": "the instrument",
    r"\b(nothing (is )?)?left to (explain|find)\b": "a sentence of machine-readable results and of `lacet where`",
    r"mostly pulls at the road": "a force, in a message of the checks on loading",
    r"too short to tell": "a value of `colour` in machine-readable results (docs/json.md)",
}
"""Phrases in which such a word means something else, with the reason."""

NAMES = {
    *("tell", "tells", "told", "telling", "excuse", "excuses", "excused", "freed", "strain", "strained", "strains"),
    *("partialled", "partialling", "pull", "pulls", "temper", "tempered", "look", "looks", "looking"),
    *("news", "constancy"),
}
"""The same as words of an identifier; `left` and what follows a `taken` are judged by what stands beside them."""

ALLOWED_NAMES: dict[str, str] = {
    "looks_like": "an attribute of users' own effect files, part of the public interface",
}
SIDES = r"(?i:right|forward|rear)|\"lr?\""
"""In code about a side of the car, of an equation or of a picture one of these stands beside `left`."""

ALLOWED_IN: dict[tuple[str, str], str] = {
    (
        "services/workbench/static/js/views/user_effect.js",
        "tells",
    ): "a key of the server's answer (docs/workbench-api.md)",
}


def words_of(name: str) -> list[str]:
    """The words of an identifier in snake or camel case, in small letters."""
    return [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)]


def bad_name(name: str, around: str) -> bool:
    """Whether an identifier is of the old vocabulary; `around` is the code it stands in."""
    if name in ALLOWED_NAMES:
        return False
    words = words_of(name)
    pairs = set(itertools.pairwise([*words, ""]))
    if ("parameter", "constancy") in pairs:  # the field's term (Chow test)
        words.remove("constancy")
    if NAMES & set(words) or pairs & {("taken", "out"), ("taken", "up")}:
        return True
    beside = {second for first, second in pairs if first == "left"}
    if not beside or beside <= {"out", "open", "hand", "side"}:
        return False
    return bool(beside & {"by", "after", "over"}) or re.search(SIDES, around) is None


def bad_words(text: str) -> list[str]:
    """What of the old vocabulary stands in a sentence."""
    flat = re.sub(r"`[^`\s]+`", "…", " ".join(text.split()))  # names are judged where they are made
    for phrase in ALLOWED:
        flat = re.sub(phrase, "…", flat, flags=re.IGNORECASE)
    return [found[0] for pattern in TEXT for found in re.finditer(pattern, flat, re.IGNORECASE)]


def identifiers(node: ast.AST) -> Iterator[str]:
    """Names that a node introduces or uses."""
    for field in ("name", "id", "attr", "arg", "asname"):
        value = getattr(node, field, None)
        if isinstance(value, str):
            yield value


def comments(source: str) -> Iterator[tuple[int, str]]:
    """Comments of a module with the line of each; whole lines that follow each other are one text."""
    found: list[tuple[int, str]] = []
    last = -1
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type != tokenize.COMMENT:
            continue
        line, whole = token.start[0], token.line.lstrip().startswith("#")
        if whole and line == last + 1:
            first, text = found.pop()
            found.append((first, f"{text} {token.string.lstrip('# ')}"))
        else:
            found.append((line, token.string))
        last = line if whole else -1
    yield from found


def faults_in_python(source: str) -> list[str]:
    """Old words in the identifiers, docstrings, messages and comments of a module, with their lines."""
    out = [f"{line}: “{found}”" for line, text in comments(source) for found in bad_words(text)]
    lines = source.splitlines()

    def walk(node: ast.AST, around: str, within: str) -> None:
        """`around` : the source of the innermost function or class, `within` : of the innermost class."""
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            around = "\n".join(lines[node.lineno - 1 : node.end_lineno])
            within = around if isinstance(node, ast.ClassDef) else within
        beside = within if isinstance(node, ast.Attribute) else around
        out.extend(f"{getattr(node, 'lineno', 0)}: {name}" for name in identifiers(node) if bad_name(name, beside))
        # A word alone is a key or an option and not a message.
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value.strip():
            out.extend(f"{node.lineno}: “{found}”" for found in bad_words(node.value))
        for child in ast.iter_child_nodes(node):
            walk(child, around, within)

    walk(ast.parse(source), source, source)
    return sorted(set(out))


def faults_in_script(source: str) -> list[str]:
    """Old words in the names, comments and messages of a JavaScript module, with their lines."""
    out: list[str] = []
    text = re.compile(r"""/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*'|`(?:\\.|[^`\\])*`""", re.DOTALL)

    def put(place: int, found: str) -> None:
        out.append(f"{source.count(chr(10), 0, place) + 1}: {found}")

    for match in text.finditer(source):
        for found in bad_words(match[0]):
            put(match.start(), f"“{found}”")
    for match in re.finditer(r"[A-Za-z_$]\w*", text.sub(lambda m: re.sub(r"[^\n]", " ", m[0]), source)):
        if bad_name(match[0], source) and match[0] not in ("left", "LEFT"):  # a side of boxes, in style sheets' words
            put(match.start(), match[0])
    return sorted(set(out))


def faults(files: list[Path]) -> dict[str, list[str]]:
    """By file, from the top of the checkout: the old words in it."""
    found: dict[str, list[str]] = {}
    for file in files:
        name, source = str(file.relative_to(HOME)), file.read_text(encoding="utf-8")
        judge = {".py": faults_in_python, ".js": faults_in_script}.get(file.suffix, bad_words)
        found[name] = [
            fault for fault in judge(source) if (name, fault.rpartition(" ")[2].strip("“”")) not in ALLOWED_IN
        ]
    return {name: those for name, those in found.items() if those}


def test_python_speaks_the_field_s_terms():
    assert len(PYTHON) > 200
    assert faults(PYTHON) == {}


def test_scripts_speak_the_field_s_terms():
    assert faults(SCRIPTS) == {}


def test_pages_speak_the_field_s_terms():
    assert faults(PAGES) == {}


@pytest.mark.parametrize(
    "source",
    [
        'def f():\n    """Columns with the model taken out."""',
        "def f(told): ...",
        "class Left: ...",
        "def f(x):\n    left = x - 1\n    return left",
        "class Look: ...",
        "left_by = 1",
        "raise ValueError('the sheet excuses it, nothing more')",
        "def f():\n    '''What is left of the residual.'''",
        "x.taken_up = 1",
        "parts.pull = 0",
        "x = 1  # what the sheet takes up",
        "# so that nothing is\n# left of it\nx = 1",
    ],
)
def test_an_old_word_would_be_found(source):
    assert len({fault.rpartition(" ")[2] for fault in faults_in_python(source)}) == 1


@pytest.mark.parametrize(
    "source",
    [
        "def f(left, right): ...",
        "def f():\n    '''The left side of a row; what is left out and why.'''",
        "left_out = {}",
        "effect.looks_like",
        "x['told'] = 1",
        "temperature = 20.0",
        "print('effects that cannot be told apart on these runs')",
        "x = 1  # all that there is\n# left wheels first\n",
    ],
)
def test_a_word_in_its_plain_meaning_is_none(source):
    assert faults_in_python(source) == []


def test_an_old_word_in_a_script_would_be_found():
    assert faults_in_script('const x = "what is left"; // the news\nlook(x.leftTable);') == [
        "1: “is left”", "1: “news”", "2: leftTable", "2: look",
    ]  # fmt: skip
