"""Small XML files as elements that know their line, so that a fault can be shown where it stands."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat


@dataclass
class Element:
    """An XML element: its `tag`, `attributes`, `line` in the text (from 1) and the elements inside it."""

    tag: str
    attributes: dict[str, str]
    line: int
    inside: list[Element] = field(default_factory=list["Element"])

    def all(self, tag: str) -> Iterator[Element]:
        """The elements of this tag directly inside."""
        return (one for one in self.inside if one.tag == tag)

    def first(self, tag: str) -> Element | None:
        """The first of them; None where there is none."""
        return next(self.all(tag), None)


class XmlFault(ValueError):
    """A text that is no XML, or has what is not read: the `line`, and what is wrong there."""

    def __init__(self, line: int, says: str):
        super().__init__(f"line {line}: {says}")
        self.line, self.says = line, says


def read_xml(text: str) -> Element:
    """The root element of an XML text. Definitions of entities are refused, as they can make a short file endless.

    Raises XmlFault with the line.
    """
    parser = expat.ParserCreate()
    found: list[Element] = []
    stack: list[Element] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, parser.CurrentLineNumber)
        (stack[-1].inside if stack else found).append(element)
        stack.append(element)

    def refuse(*_: object) -> None:
        raise XmlFault(parser.CurrentLineNumber, "a document type is not read: take the <!DOCTYPE …> out")

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: stack.pop() and None
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise XmlFault(error.lineno, f"this is no XML: {expat.ErrorString(error.code)}") from None
    return found[0]
