"""Errors of the asset."""


class EmptySurfaceError(RuntimeError):
    """The field holds nothing dense enough to be a surface; one sentence with the way out."""

    def __init__(self):
        super().__init__(
            "The fit found no opaque surface; check the masks, the region box and the cameras, and start "
            "anew with a longer time limit if it was short."
        )
