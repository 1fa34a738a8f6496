"""Text that is given as itself or as the path of a file that holds it."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from lacet.daq.errors import UsageError

Source = str | PathLike[str]
"""The path of a file, or the text itself."""


def is_file(path: Path) -> bool:
    """Whether there is a file of that name: not where the name is one that no file can have, as one too long."""
    try:
        return path.is_file()
    except OSError:
        return False


def text_of(source: Source, begins: str, name: str) -> tuple[str, str]:
    """A text, and what it is called in messages: `source` itself where it begins with `begins`, else the file's.

    Raises UsageError when there is no such file.
    """
    if isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith(begins):
        return source.lstrip("\ufeff \t\r\n"), name
    try:
        return Path(source).read_text(encoding="utf-8-sig"), str(source)
    except UnicodeDecodeError:
        raise UsageError(f"{source}: this is no text in UTF-8") from None
    except OSError as error:
        raise UsageError(f"{source}: {error.strerror or error}") from None
