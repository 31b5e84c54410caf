"""Errors that operators report, as Blender tells them to whoever calls them."""

import bpy


def reason_of(error: RuntimeError) -> str:
    """What an operator reported, without the word before it, which is in the interface's language."""
    translations = bpy.app.translations
    text = str(error).strip()
    for word in (translations.pgettext_rpt("Error"), "Error"):
        text = text.removeprefix(f"{word}: ")
    return text
