"""COLMAP as it is on Windows, where it opens no path with letters that the system's code page has not."""

from pathlib import Path

from solver.capture.photo_matches import quiet_colmap


class Plain:
    """What is callable of COLMAP: it takes no text but in ASCII, which all code pages have."""

    def __init__(self, own):
        self._own = own

    def __getattr__(self, name):
        value = getattr(self._own, name)
        return Plain(value) if callable(value) else value

    def __call__(self, *args, **kwargs):
        for value in (*args, *kwargs.values()):
            if isinstance(value, (str, Path)) and not str(value).isascii():
                raise UnicodeError(f"{value}: the code page has no such letters")
        return self._own(*args, **kwargs)


def plain_colmap():
    """As `quiet_colmap`."""
    return Plain(quiet_colmap())
