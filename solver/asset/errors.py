"""Errors of the asset."""


class EmptySurfaceError(RuntimeError):
    """The field holds nothing dense enough to be a surface."""
