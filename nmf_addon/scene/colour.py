"""Colour spaces and views by whatever name the person's OpenColorIO configuration has for them."""

import bpy

NON_COLOUR = "Non-Color"
SOLVERS_SPACE = "lin_rec709_scene"
"""linear Rec.709 by its name in the Color Interop Forum's list"""
NAMES = {
    "sRGB": ("sRGB", "sRGB - Texture", "Utility - sRGB - Texture", "sRGB Encoded Rec.709 (sRGB)"),
    "Linear Rec.709": (
        "Linear Rec.709", "Linear Rec.709 (sRGB)", "Utility - Linear - Rec.709",
        "Utility - Linear - sRGB", "Linear",
    ),
}  # fmt: skip
"""of Blender, of ACES 1.3 and 2.0, of ACES 1.2 and before"""
PLAIN_DISPLAYS = ("sRGB", "sRGB - Display", "ACES")
"""of Blender, of ACES 1.3 and 2.0, of ACES 1.2 and before"""
PLAIN_VIEWS = ("Standard", "Un-tone-mapped", "sRGB", "Output - sRGB")


def set_colour_space(image: bpy.types.Image, name: str) -> None:
    """Take an image's values for those of a colour space that Blender's own configuration names so.

    Where the configuration has none of that kind, the image keeps what Blender gives to pictures of its
    depth, which is sRGB for 8 bits and linear for floating point in every usual one.
    """
    settings = image.colorspace_settings
    if name == NON_COLOUR:
        settings.is_data = True
        return
    _set_first(settings, "name", NAMES.get(name, (name,)))


def set_plain_view(scene: bpy.types.Scene) -> bool:
    """Show the scene's light as sRGB, without tone mapping; False if there is no such view."""
    # First, for each display has views of its own.
    _set_first(scene.display_settings, "display_device", PLAIN_DISPLAYS)
    return _set_first(scene.view_settings, "view_transform", PLAIN_VIEWS)


def foreign_working_space(data: bpy.types.BlendData) -> str:
    """Name of the space that a file's light is added up and reflected in, if that is another than the
    solver's linear Rec.709; empty where it is not, or cannot be asked, as before Blender 5.0."""
    space = getattr(data, "colorspace", None)
    if getattr(space, "working_space_interop_id", "") in ("", SOLVERS_SPACE):
        return ""
    return space.working_space


def _set_first(settings: bpy.types.bpy_struct, field: str, names: tuple[str, ...]) -> bool:
    """Set a field to the first of some names that the configuration knows; False if it knows none."""
    for name in names:
        try:
            setattr(settings, field, name)
        except TypeError:
            continue
        return True
    return False
