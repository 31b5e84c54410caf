"""What the command line takes: texts to values, all raising ArgumentTypeError with what is wrong; paths."""

import argparse
import math
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from .capture.archives import is_archive, unpacked
from .job.request import JobError
from .streams import say


def add_ignore(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--ignore", type=Path, metavar="PATH", dest="ignored",
        help="folder or archive of pictures, white where photos are to be ignored, or one for all",
    )  # fmt: skip


def add_command(commands: argparse._SubParsersAction, name: str, purpose: str) -> argparse.ArgumentParser:
    """A command that says what it is for among all, and in its own help."""
    description = f"{purpose[0].upper()}{purpose[1:]}."
    return commands.add_parser(name, help=purpose, description=description)


def add_capture(command: argparse.ArgumentParser, kinds: str) -> None:
    """Add the arguments for a capture, of these kinds, and its pictures."""
    command.add_argument("capture", type=Path, help=kinds)
    places = {"photos": "in the capture's folder", "masks": "in a folder 'masks' there"}
    for name, place in places.items():
        purpose = f"folder or archive of the {name}, if not {place}"
        command.add_argument(f"--{name}", type=Path, metavar="DIR", help=purpose)
    add_ignore(command)


def add_events(command: argparse._ActionsContainer) -> None:
    command.add_argument("--events", action="store_true", help="events on stdout, no bar")


def add_seed(command: argparse.ArgumentParser, most: int, default: int | None) -> None:
    command.add_argument(
        "--seed", type=whole_number(0, most), default=default, metavar="N",
        help="number that fixes all random choices (default 0)",
    )  # fmt: skip


def add_settings(command: argparse.ArgumentParser, form: str, purpose: str) -> None:
    command.add_argument("--set", action="append", default=[], metavar=form, dest="sets", help=purpose)


def placement(text: str) -> tuple[float, ...]:
    """x, y, z, scale and degrees, the last two 1 and 0 where they are not given."""
    values = tuple(number(part) for part in text.split(","))
    if not 3 <= len(values) <= 5:
        raise argparse.ArgumentTypeError("write it as X,Y,Z or X,Y,Z,SCALE or X,Y,Z,SCALE,DEGREES")
    if len(values) > 3 and values[3] <= 0:
        raise argparse.ArgumentTypeError("SCALE must be positive")
    return (*values, *(1.0, 0.0)[len(values) - 3 :])


def seconds(text: str) -> float:
    """Seconds, more than none."""
    value = number(text)
    if value <= 0:
        raise argparse.ArgumentTypeError("must be a positive number of seconds")
    return value


def whole_number(least: int, most: int) -> Callable[[str], int]:
    """What reads whole numbers between these two."""

    def whole(text: str) -> int:
        if not text.isdecimal() or not least <= int(text) <= most:
            raise argparse.ArgumentTypeError(f"must be a whole number from {least} to {most}")
        return int(text)

    return whole


def number(text: str) -> float:
    """A finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not a number")
    return value


def check_names(options: argparse.Namespace) -> None:
    """Raises: JobError: a path has bytes that no text has, as Linux allows; not all libraries open it."""
    for value in vars(options).values():
        for path in value if isinstance(value, list) else [value]:
            if isinstance(path, Path) and not _is_text(str(path.absolute())):
                raise JobError(
                    f"{path.absolute()}: the name has bytes that are not UTF-8 (escaped here); rename it."
                )


def unpack_archives(options: argparse.Namespace) -> None:
    """Put the folders of archives in the place of those that are given as captures, cameras or pictures.

    Raises:
        CaptureError: as `unpacked`.
    """
    for name in ("capture", "cameras", "photos", "masks", "ignored"):
        path = getattr(options, name, None)
        if isinstance(path, Path) and is_archive(path):
            folder = _unpacked_with_bar(path)
            say(f"{path} is an archive; it is unpacked to {folder}.")
            setattr(options, name, folder)


def _unpacked_with_bar(path: Path) -> Path:
    from .job.progress import plain_bar

    with ExitStack() as bars:
        opened: list[Callable[[float, str], None]] = []

        def told(fraction: float) -> None:
            if not opened:
                opened.append(bars.enter_context(plain_bar()))
            opened[0](fraction, "unpacking")

        return unpacked(path, told)


def _is_text(name: str) -> bool:
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True
