"""What a run makes before it works, which goes again where its input turns out to be of no use."""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from .folder import holds_nothing


@dataclass(frozen=True)
class Begun:
    """What a run makes to begin, in its folder.

    Attributes:
        request: the file that says what was asked.
        folders: those that were not there, from the run's own on outwards; one that a person made stays.
    """

    request: Path
    folders: tuple[Path, ...]

    @classmethod
    def before(cls, request: Path) -> "Begun | None":
        """What is about to be made around a request's file; None if that is there: then a run goes on."""
        if request.exists():
            return None
        return cls(request, tuple(path for path in request.parents if not path.exists()))

    def take_back(self, others: Iterable[Path]) -> None:
        """Remove what was made, unless there is more in the folder: that is work to go on with.

        Args:
            others: files beside the request's that are written before any work.
        """
        files = (self.request, *others)
        with suppress(OSError):  # on Windows a file that somebody looks at stays
            if holds_nothing(self.request.parent, {path.name for path in files}):
                for path in files:
                    path.unlink(missing_ok=True)
                for folder in self.folders:
                    folder.rmdir()
