"""What differs between the versions of Blender."""

import bpy

# From 4.5 on a path property says that it may be relative to the .blend ("//…").
PATH_OPTIONS = {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (4, 5, 0) else set()
