"""The one error for captures that cannot be read."""

from __future__ import annotations

from pathlib import Path


class CaptureError(ValueError):
    """Input that cannot be used. `str()` is one sentence with file, field and the way out."""

    def __init__(self, file: Path | str, field: str, problem: str, remedy: str):
        self.file, self.field, self.problem, self.remedy = Path(file), field, problem, remedy
        where = f"{file}" + (f", {field}" if field else "")
        super().__init__(f"{where}: {problem}; {remedy}.")
