"""The one error for captures that cannot be read, and what sentences for people are made of."""

import re
from pathlib import Path
from typing import Any

_NAMED = 6


class CaptureError(ValueError):
    """Input that cannot be used. `str()` is one sentence with file, field and the way out."""

    def __init__(self, file: Path | str, field: str, problem: str, remedy: str = "export it again"):
        self.file, self.field, self.problem, self.remedy = Path(file), field, problem, remedy
        where = f"{file}" + (f", {field}" if field else "")
        text = f"{where}: {problem}; {remedy}."
        # A file's own names may hold line breaks.
        super().__init__("".join(c if c.isprintable() else "?" for c in text))


def shown(value: Any, limit: int = 60) -> str:
    """A value from a file, fit for a sentence: one line, short, printable on every terminal."""
    try:
        text = value if isinstance(value, str) else repr(value)
    except (RecursionError, ValueError):
        text = f"a {type(value).__name__}"  # nested too deeply, or an integer too long to print
    text = text[: limit + 1]
    if not text.isprintable():
        text = "".join(c if c.isprintable() else "?" for c in text)
    return text if len(text) <= limit else text[: limit - 1] + "…"


def counted(text: str) -> str:
    """A text that begins with a number, with that of "is|are" which goes with it."""
    return re.sub(r"(\w*)\|(\w*)", r"\1" if text.startswith("1 ") else r"\2", text)


def told_of(file: Path, names: list[str], what: str) -> str:
    """What `counted` has of a number of names, with the first, for a sentence about a file."""
    return f"{file.name}: {counted(f'{len(names)} {what}')} (the first: {shown(names[0])})"


def listed(names: list[str]) -> str:
    """The first names and how many more."""
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")
