"""Errors of settings; apart, so that the command line can name them without importing torch."""


class SettingsError(ValueError):
    """A setting that does not exist or does not fit; the message names it and the way out."""
