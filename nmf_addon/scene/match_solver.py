""" "Match solver": render settings under which Cycles shows what the solver optimised."""

import bpy
from bpy.types import Scene

from ...solver.capture.errors import listed
from .cameras import ASPECT, fit_photos, photo_of, size_of
from .colour import foreign_working_space, set_plain_view

BLACKMAN_HARRIS_WIDTH = 1.5  # pixels


def match_solver(scene: Scene, bounces: int = 2) -> str:
    """Cycles without clamping, blurred glossies or a view transform; the solver's bounces.

    Returns: what could not be set, as a sentence for the person; empty if all is.

    Raises:
        RuntimeError: there is no Cycles; nothing is changed.
    """
    check_cycles(scene)
    scene.render.engine, cycles = "CYCLES", scene.cycles
    cycles.max_bounces = max(bounces - 1, 0)
    cycles.diffuse_bounces = cycles.glossy_bounces = cycles.max_bounces
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.blur_glossy = 0.0
    cycles.use_fast_gi = False
    cycles.caustics_reflective = True
    cycles.pixel_filter_type = "BLACKMAN_HARRIS"
    cycles.filter_width = BLACKMAN_HARRIS_WIDTH
    render = scene.render
    render.film_transparent = True
    render.use_simplify = render.use_border = render.use_motion_blur = False
    render.use_compositing = render.use_sequencer = False
    view = scene.view_settings
    view.look = "None"
    view.exposure, view.gamma, cycles.film_exposure = 0.0, 1.0, 1.0
    view.use_curve_mapping = view.use_white_balance = False
    render.dither_intensity = 0.0
    render.image_settings.color_management = "FOLLOW_SCENE"
    return " ".join(filter(None, (_view_left(scene), _working_space_left(), _lamps_left(scene))))


def _view_left(scene: Scene) -> str:
    if set_plain_view(scene):
        return ""
    return (
        f"The view transform stays '{scene.view_settings.view_transform}', since this color configuration "
        "has no equivalent of Blender's 'Standard'; renders will not look like the photos."
    )


def _working_space_left() -> str:
    space = foreign_working_space(bpy.data)
    if not space:
        return ""
    return (
        f"The working space stays '{space}', which reflects saturated colors differently from the solver; "
        "to match the photos, set it to Linear Rec.709 in the render properties, under Color Management."
    )


def _lamps_left(scene: Scene) -> str:
    lights = {i for layer in scene.view_layers for i in layer.objects if i.type == "LIGHT"}
    shown = {*scene.collection.objects} | {
        item for c in scene.collection.children_recursive if not c.hide_render for item in c.objects
    }
    lamps = [item.name for item in lights & shown if not item.hide_render]
    if not lamps:
        return ""
    return f"Photos had no light but the World's: hide {listed(sorted(lamps))} in renders to compare them."


def check_cycles(scene: Scene) -> None:
    """Make sure that there is Cycles.

    Raises:
        RuntimeError: there is none.
    """
    if getattr(scene, "cycles", None) is None:
        raise RuntimeError(
            "Cycles is switched off: enable 'Cycles Render Engine' in Preferences > Add-ons."
        )


def match_photo(scene: Scene) -> None:
    """Render at the size of the photo behind the scene's camera, with its pixels' shape, if it has one."""
    item = scene.camera
    if item is None or item.type != "CAMERA" or photo_of(item) is None:
        return
    size = size_of(item)
    if 0 not in size:  # as it is where the photo has gone
        match_resolution(scene, *size, float(item.data.get(ASPECT, 1.0)))
        fit_photos(scene)


def match_resolution(scene: Scene, width: int, height: int, aspect: float = 1.0) -> None:
    """Render at a photo's size; `aspect` is a pixel's width over its height."""
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.resolution_percentage = 100
    scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = max(1.0, aspect), max(1.0, 1 / aspect)
