"""Errors in words for a person. No bpy in here."""


def words_of(error: Exception) -> str:
    """What an error says; of one of the system's, the file and the reason, without its number."""
    if not isinstance(error, OSError) or not error.strerror:
        return str(error)
    return f"{error.filename}: {error.strerror}." if error.filename else f"{error.strerror}."
