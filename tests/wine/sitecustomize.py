"""What Wine shows or leaves out, unlike Windows; Python reads this when it starts."""

import builtins
import io
import msvcrt
import os

_LINUX = ("/proc", "/dev/", "/sys/")


def _hide(function):
    """Linux's own folders, which Wine shows where a path begins with a slash."""

    def hidden(path, *arguments, **settings):
        text = os.fspath(path) if isinstance(path, (str, os.PathLike)) else ""
        if isinstance(text, str) and text.replace("\\", "/").startswith(_LINUX):
            raise FileNotFoundError(2, "No such file or directory", text)
        return function(path, *arguments, **settings)

    return hidden


for _name in ("stat", "lstat", "readlink", "listdir", "scandir"):
    setattr(os, _name, _hide(getattr(os, _name)))
io.open = builtins.open = _hide(io.open)
_locking = msvcrt.locking


def _locking_with_number(descriptor, mode, count):
    """Windows says with a number why a lock is refused."""
    try:
        return _locking(descriptor, mode, count)
    except OSError as error:
        raise (error if error.errno else PermissionError(13, "Permission denied")) from error


msvcrt.locking = _locking_with_number
