"""A layout that only listens: what a panel draws, for tests."""

from __future__ import annotations

import types

import bpy


class Layout:
    """Stands in for UILayout: notes what is drawn."""

    def __init__(self, drawn=None):
        self.__dict__["drawn"] = [] if drawn is None else drawn

    def __setattr__(self, name, value):
        self.__dict__[name] = value

    def _child(self, *args, **settings):
        return Layout(self.drawn)

    row = column = box = split = _child

    def separator(self, **settings):
        """Nothing to note."""

    def label(self, text="", icon="NONE", icon_value=0):
        assert icon in bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items
        self.drawn.append(("label", text))

    def operator(self, idname, text=None, icon="NONE"):
        assert icon in bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items
        module, name = idname.split(".")
        getattr(getattr(bpy.ops, module), name).get_rna_type()
        self.drawn.append(("operator", idname))
        return types.SimpleNamespace()

    def prop(self, data, name, **settings):
        assert name in data.bl_rna.properties
        self.drawn.append(("prop", name))

    def progress(self, factor, text="", type="BAR"):
        self.drawn.append(("progress", text, round(factor, 2)))

    def template_icon(self, icon_value, scale):
        self.drawn.append(("icon", icon_value))
