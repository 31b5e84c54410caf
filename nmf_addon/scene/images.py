"""Image files into the .blend."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
from bpy.types import ID, Image, Mesh

from .colour import set_colour_space


def load_image(path: Path, check_existing: bool = False) -> Image:
    """An image of a file, by a path relative to a saved .blend if the person's preferences say so.

    So a project's folder can be moved: Blender makes paths relative by itself at a first save alone.

    Args:
        check_existing: take the image that shows this file already, if there is one.

    Raises:
        RuntimeError: Blender cannot load it.
    """
    image = bpy.data.images.load(str(path), check_existing=check_existing)
    if image.source != "FILE":  # a film that begins with this picture
        image = bpy.data.images.load(str(path))
    relative = bpy.data.filepath and bpy.context.preferences.filepaths.use_relative_paths
    if relative and not image.library:
        image.filepath = stored_path(path)
    return image


def load_picture(path: Path, colour_space: str | None = None) -> Image:
    """An image of a file that Blender can decode, which this makes sure of.

    Args:
        colour_space: as Blender's own configuration names it; None: what Blender takes it for.

    Raises:
        RuntimeError: it cannot; no image is left.
    """
    with nothing_left_behind(bpy.data.images):
        image = load_image(path)
        if colour_space is not None:
            set_colour_space(image, colour_space)
        if 0 in image.size:
            raise RuntimeError(
                f"{path}: Blender cannot read this image; replace it if it is damaged, or convert it."
            )
    return image


def images_of(block: ID) -> list[Image]:
    """Pictures that a material or World shows; a mesh shows none."""
    if isinstance(block, Mesh):
        return []
    nodes = block.node_tree.nodes
    return [n.image for n in nodes if n.type in ("TEX_IMAGE", "TEX_ENVIRONMENT") and n.image]


@contextmanager
def nothing_left_behind(*kinds: bpy.types.bpy_prop_collection) -> Iterator[None]:
    """Takes away again what was added meanwhile if something fails.

    Args:
        kinds: where that may be, such as `bpy.data.images`.
    """
    before = [set(kind) for kind in kinds]
    try:
        yield
    except Exception:
        for kind, there in zip(kinds, before, strict=True):
            for block in set(kind) - there:
                kind.remove(block)
        raise


def stored_path(path: Path, blend: str | None = None) -> str:
    """A path as a .blend remembers it: relative to it once it is saved, so that both can be moved.

    Args:
        blend: path of the .blend; None: the open one's.
    """
    blend = bpy.data.filepath if blend is None else blend
    if not blend:
        return str(path)
    try:
        return bpy.path.relpath(str(path), start=str(Path(blend).parent))
    except ValueError:  # another drive on Windows
        return str(path)
