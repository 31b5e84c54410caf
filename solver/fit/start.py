"""The start of a fit: the box, the first density and the first light, from photos and cameras."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from scipy import ndimage

from ..brdf.neural import NeuralTerm
from ..capture.camera import Camera
from ..capture.capture import Capture
from ..capture.errors import CaptureError
from ..capture.panorama import Panorama
from ..capture.photos import Photo
from ..capture.placement import far_origin, seen_from
from ..capture.turntable import Turntable
from ..field.room import EXTENT, Room, expand
from ..job.folder import JobFolder
from ..light.environment import EnvironmentMap
from ..render.scene import Scene
from .box import Box, box_around_hull
from .checkpoint import load_scene
from .chunk import SURROUNDED
from .cut_out import backdrop_behind
from .doubtful_outlines import doubtful_width, without_outlines
from .errors import SettingsError
from .far_light import NOTHING_SEEN, FarLight, SeenLight
from .hollows import carve_hollows
from .mask_outlines import masks_of
from .point_start import start_from_points
from .ray_bank import RayBank
from .seen_space import (
    cell_centres,
    looked_at_most,
    nearest_distance,
    seen_cells,
    seen_points,
    walked_through,
)
from .settings import FieldSettings, Settings
from .trainer import Trainer
from .turned_light import turntable_of
from .visual_hull import BELONG_TOGETHER, NOTHING_IN_COMMON, signed_distance, start_from_hull, whole_hull

SEEN_CELLS = 64
EXTINCTION = 35.0
"""scale of the extinction over half the box: what the public code has, for its scenes, per world unit; so
a capture may be of any size"""
TELLING_POINTS = 1000
"""sparse points that say where things are; a fog with fewer begins where most cameras look"""
HAZE, THIN_FOG = -4.0, -6.0
"""shift of the raw density: the public code's, and one under which a ray passes the box at the start, for
else a surface settles before the cameras"""
OUTSIDE, INSIDE = -12.0, 5.0
"""raw density far from the hull's surface: clear, and opaque within a few voxels but not more, for slots
and hollows, which no mask shows, have yet to be carved (docs/decisions/0001)"""
BOXED = 0.2
"""share of the time of a start after which the box is known"""
HULL_MARGIN = 3  # cells of the hull's grid by which the object may reach beyond the hull
LIKELY_MARGIN = 9  # pixels around the object from which rays are drawn as often as from it


def new_trainer(
    capture: Capture, photos: list[Photo], settings: Settings, seed: int, region: np.ndarray | None,
    device: str, progress: Callable[[float], None], light: SeenLight = NOTHING_SEEN,
) -> Trainer:  # fmt: skip
    """A trainer at its start; its settings are those given, but for the grid's sizes if there are no masks.

    With masks (alpha) the density starts as the photos' visual hull in a box around it, a little wider if
    their outlines do not fit each other; without, as a thin fog where several cameras look, and not right
    before one of them; denser at the capture's sparse points, if it has any.

    Args:
        region: [2, 3] world box given by the person, or None.
        progress: called with the share done; may raise to stop.
        light: what photos show of it.

    Raises:
        CaptureError: the photos' masks have nothing in common.
    """
    torch.manual_seed(seed)
    origin = far_origin(capture)
    near = seen_from(capture, origin)
    cameras = list(near.cameras)
    use_masks = uses_masks(photos, settings)
    use_hull = use_masks and settings.field.hull_start
    turntable = turntable_of(near, settings.light.turntable)
    behind = _behind(photos, settings, turntable)
    region = near.region if region is None else np.asarray(region, dtype=np.float64) - origin
    doubts = use_hull and settings.fit.doubt_outlines
    width = doubtful_width(near, photos, region) if doubts else 0
    sure = without_outlines(photos, width)
    if use_masks:
        turn = use_hull and settings.field.turn_box and behind != "room"
        box = box_around_hull(
            cameras, lambda: masks_of(sure), region, settings.field.box_margin, turn,
            lambda done: progress(BOXED * done),
        )  # fmt: skip
        if box is None:
            raise CaptureError(capture.source, "alpha", NOTHING_IN_COMMON, BELONG_TOGETHER)
    else:
        box = Box.around(region)
        settings = dataclasses.replace(settings, field=_for_no_masks(settings.field))
    progress(BOXED)
    shape = settings.field
    clear_start = shape.hull_start and not use_hull
    field = box.new_field(
        shape.sizes[0], shape.density_components, shape.feature_components, shape.feature_size,
        initial_albedo=shape.initial_albedo, initial_roughness=shape.initial_roughness,
        initial_f0=shape.initial_f0, smoothed_normals=shape.smoothed_normals,
        density_scale=EXTINCTION / box.half_size, density_shift=THIN_FOG if clear_start else HAZE,
    )  # fmt: skip
    if use_hull:
        turned, cells = box.seen_along(cameras), shape.hull_cells
        hull, reached = whole_hull(turned, lambda: masks_of(sure), box.along_axes, cells)
        if shape.carve_hollows:
            progress(0.5)
            hull = carve_hollows(turned, sure, hull, box.along_axes)
        distance = torch.from_numpy(signed_distance(hull)) * (2 * box.half_size / hull.shape[0])
        start_from_hull(field, distance, shape.hull_slope / box.half_size, OUTSIDE, INSIDE)
    room = None
    if behind == "room":
        room = _room(cameras, box, shape.sizes[0], settings.light.initial)
    if near.points is not None and starts_from_points(photos, settings):
        start_from_points(field, room, near.points, shape.points_density)
    environment = EnvironmentMap(settings.light.heights[0], settings.light.initial)
    if light.floor is not None and turntable is None:
        environment.floor = light.floor.counted_from(origin)
    neural = NeuralTerm(shape.feature_size)
    scene = Scene(field, environment, neural, shape.occupancy_cells, room, origin, turntable)
    scene = scene.to(device)
    if use_hull:
        scene.occupancy.allow_only(torch.from_numpy(reached), HULL_MARGIN)
    elif clear_start:
        told = near.points is not None and len(near.points) >= TELLING_POINTS
        allowed = (seen_cells if told else looked_at_most)(
            box.seen_along(cameras), box.along_axes, SEEN_CELLS
        )
        scene.occupancy.allow_only(torch.from_numpy(allowed), 0)
    if settings.fit.decoder:
        take_decoder(scene, Path(settings.fit.decoder), device)
    trainer = trainer_for(scene, capture, photos, settings, seed, light.held)
    trainer.outlines.begin(width)
    if light.first is not None and turntable is None:
        around = FarLight(light.first, scene.device)
        trainer.begin_light(around.begin(environment.height, settings.light.initial))
    elif trainer.far is not None:
        trainer.begin_light(trainer.far.begin(environment.height, settings.light.initial))
        trainer.far.put_into(environment)
    return trainer


def _for_no_masks(shape: FieldSettings) -> FieldSettings:
    """Coarser grids where no masks hold the shape: noise fills what is finer (docs/decisions/0019)."""
    factor = min(1.0, shape.finest_without_masks / shape.sizes[-1])
    return dataclasses.replace(shape, sizes=tuple(round(factor * size) for size in shape.sizes))


def _room(cameras: list[Camera], box: Box, size: int, initial: float) -> Room:
    """A room around the box: a thin fog where any camera looks, but not between them and the box, where
    it would be easier to explain each photo by what hangs before it."""
    cells = cell_centres(np.array([[-EXTENT] * 3, [EXTENT] * 3]), SEEN_CELLS)
    points = box.centre + box.half_size * expand(cells)
    nearest = nearest_distance(cameras, box.centre)
    seen = seen_points(cameras, points, nearest, fewest=1)
    seen &= ~walked_through(cameras, points, box.centre)
    allowed = torch.from_numpy(seen.reshape((SEEN_CELLS,) * 3))
    return Room(torch.tensor(box.centre), box.half_size, size, allowed, nearest, initial=initial)


def take_decoder(scene: Scene, job: Path, device: str) -> None:
    """Copy feature basis, heads and g of a finished job, so that both scenes share a decoder.

    Raises:
        JobError: there is no job. SettingsError: its networks have another shape.
    """
    other, _, _ = load_scene(JobFolder.open(job).checkpoint_dir, device)
    try:
        scene.field.basis.load_state_dict(other.field.basis.state_dict())
        scene.field.heads.load_state_dict(other.field.heads.state_dict())
        scene.neural.load_state_dict(other.neural.state_dict())
    except RuntimeError as error:
        raise SettingsError(
            f"Setting 'fit.decoder': the decoder of {job} has another shape; choose the same "
            "field.feature_size and field.feature_components."
        ) from error


def uses_masks(photos: list[Photo], settings: Settings) -> bool:
    """True if all photos have alpha and the settings let it say where the object is."""
    return settings.fit.use_masks and all(photo.has_alpha for photo in photos)


def starts_from_points(photos: list[Photo], settings: Settings) -> bool:
    """True if a fit starts as a fog that is denser at sparse points: no masks say where the object is."""
    shape = settings.field
    return shape.hull_start and shape.points_density > 0 and not uses_masks(photos, settings)


def trainer_for(
    scene: Scene, capture: Capture, photos: list[Photo], settings: Settings, seed: int,
    held: Panorama | None = None,
) -> Trainer:  # fmt: skip
    """A trainer of a given scene on a capture's photos.

    Args:
        held: what photos show of the light, if they do: it is held to that.
    """
    use_masks = uses_masks(photos, settings)
    cameras = [camera.seen_from(scene.origin) for camera in capture.cameras]
    bank = RayBank(cameras, photos, scene.field.centre.device)
    if use_masks:
        bank.restrict(torch.from_numpy(np.concatenate([telling(photo).ravel() for photo in photos])))
    background = _behind(photos, settings, scene.turntable)
    fog = not (use_masks and settings.field.hull_start)
    opened = None
    if fog and settings.field.hull_start:
        box = Box.of(scene.field)
        seen = seen_cells(box.seen_along(cameras), box.along_axes, SEEN_CELLS)
        opened = torch.from_numpy(seen)
    turns = None
    if scene.turntable is not None:
        turns = torch.stack([scene.turn_for(camera) for camera in cameras])
    far = None
    if held is not None and scene.turntable is None:
        far = FarLight(held, scene.device)
    return Trainer(
        scene, bank, settings, seed, use_masks, background, bool(settings.fit.decoder), fog, opened,
        turns, far,
    )  # fmt: skip


def telling(photo: Photo) -> np.ndarray:
    """[H, W] bool: pixels that show the object, or where it ends."""
    around = ndimage.maximum_filter(photo.cover > 0.01, LIKELY_MARGIN)
    return around if photo.unsure is None else around & ~photo.unsure


def background_of(photos: list[Photo], wanted: str = "auto") -> str:
    """What stands behind the object: as `wanted`, or for 'auto' as the photos look.

    Raises:
        SettingsError: impossible with these photos.
    """
    if wanted == "random" and not all(photo.has_alpha for photo in photos):
        raise SettingsError("Setting 'fit.background': 'random' needs photos with alpha; choose another.")
    if wanted != "auto":
        return wanted
    if all(photo.has_alpha for photo in photos):
        return photos[0].backdrop or "white"
    return backdrop_behind(photos) or "room"


def _behind(photos: list[Photo], settings: Settings, turntable: Turntable | None) -> str:
    """As `background_of`; a room that goes round with the light is a part of it."""
    found = background_of(photos, settings.fit.background)
    automatic = settings.fit.background == "auto"
    return "environment" if turntable and automatic and found == "room" else found


def background_shown(photos: list[Photo], fitted: str) -> str:
    """What to lay pictures over that are compared with photos, of a scene fitted to photos before `fitted`.

    These need not be the photos of the fit: where they have alpha, or where the fit's had a new colour
    a ray, it is white.
    """
    if fitted == "random" or (fitted in SURROUNDED and all(photo.has_alpha for photo in photos)):
        return "white"
    return fitted
