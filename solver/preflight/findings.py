"""What a check found, a sentence each."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """Something to know before a reconstruction.

    Attributes:
        level: 'warning' (likely to cost quality) or 'note'.
        photo: the camera's name it is about; None if it is about the capture.
        text: what it is; what to do about it.
    """

    level: str
    photo: str | None
    text: str

    def line(self) -> str:
        """For a terminal."""
        about = f"{self.photo}: " if self.photo else ""
        return f"{self.level}: {about}{self.text}"


def warning(text: str, photo: str | None = None) -> Finding:
    return Finding("warning", photo, text)


def note(text: str, photo: str | None = None) -> Finding:
    return Finding("note", photo, text)
