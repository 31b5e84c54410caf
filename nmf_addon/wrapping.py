"""Texts in as many lines as a region is narrow: Blender cuts off what does not fit into one."""

import textwrap

from bpy.types import Context, UILayout, bpy_struct

UNIT = 20  # pixels of a button's height at a resolution scale of 1
LETTERS = 2.7  # of an average width, in a unit


def units(context: Context) -> float:
    """Width of a region's panels in button heights."""
    scale = context.preferences.system.ui_scale or 1.0  # 0 before a window is there
    return context.region.width / (UNIT * scale) - 1.5


def letters(context: Context, taken: float = 0.5) -> int:
    """How many letters a line of a region's panels holds.

    Args:
        taken: what else is in the line, in button heights.
    """
    return max(int((units(context) - taken) * LETTERS), 16)


def paragraph(layout: UILayout, context: Context, text: str, icon: str = "NONE") -> None:
    """A label in lines."""
    column = layout.column(align=True)
    column.scale_y = 0.85
    fit = letters(context, 1.5 if icon != "NONE" else 0.5)
    for number, line in enumerate(textwrap.wrap(text, fit) or [""]):
        column.label(text=line, icon="BLANK1" if number and icon != "NONE" else icon)


def note(layout: UILayout, context: Context, text: str) -> None:
    """A greyed label in lines."""
    column = layout.column(align=True)
    column.active = False
    paragraph(column, context, text)


def fields(layout: UILayout, data: bpy_struct, *names: str) -> UILayout:
    """A column of settings, each beside its name."""
    column = layout.column()
    column.use_property_split, column.use_property_decorate = True, False
    for name in names:
        column.prop(data, name)
    return column
