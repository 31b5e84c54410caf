"""All settings of a reconstruction as data, a documented field each.

`--set section.field=value` changes one; a section is one of the dataclasses below.
"""

import dataclasses
import typing
from dataclasses import dataclass

from ..asset.settings import AssetSettings
from ..capture.photo_settings import PhotoSettings
from ..render.scene import RenderSettings
from .errors import SettingsError
from .limits import problem_of


@dataclass(frozen=True)
class FieldSettings:
    """The field's size and start."""

    sizes: tuple[int, ...] = (96, 128, 160)
    """grid nodes per axis, coarse to fine"""
    size_starts: tuple[float, ...] = (0.0, 0.08, 0.3)
    """fractions of the fit at which each size begins"""
    finest_without_masks: int = 160
    """grid nodes per axis, at most, where photos have no masks: `sizes` are made smaller together for it"""
    density_components: int = 16
    """VM components of the density per plane–line pair"""
    feature_components: int = 24
    """VM components of the features per pair"""
    feature_size: int = 24
    """length of a feature vector"""
    smoothed_normals: bool = True
    """normals from the Gaussian-smoothed finite difference; else the analytical derivative"""
    smoothing: tuple[float, float] = (0.0, 0.0)
    """standard deviation of the normals' smoothing at the start and at the end, as shares of the box's
    edge; never narrower than the paper's kernel (0: that one). Wide is better in short fits"""
    step_smoothing: tuple[float, float] = (0.006, 0.006)
    """standard deviation of the smoothing of the density's every step, at the start and at the end, as
    shares of the box's edge (0: none): surfaces are smooth unless the photos insist"""
    steepening: float = 4.0
    """how many times as steep the density becomes over a fit (1: not at all): a soft surface is seen at
    many depths at once, which blurs what it mirrors (docs/decisions/0051)"""
    steepening_span: tuple[float, float] = (0.1, 0.6)
    """fractions of the fit between which it does; a fit that starts as a fog stays soft"""
    initial_albedo: float = 0.5
    """albedo of every point at the start"""
    initial_roughness: float = 0.4
    """roughness r = √α of every point at the start"""
    initial_f0: float = 0.05
    """reflectance at normal incidence of every point at the start"""
    box_margin: float = 0.08
    """empty margin around the object's hull, as a share of the box"""
    turn_box: bool = True
    """turn the box, and so the grids, along the axes that make the hull's shape simplest; without a hull to
    start from, or before a room, it has the capture's"""
    occupancy_cells: int = 128
    """cells per axis of the occupancy grid"""
    occupancy_min_alpha: float = 0.005
    """opacity of a step from which a cell counts as occupied"""
    hull_start: bool = True
    """start as the masks' visual hull, where photos have masks; else as a thin fog"""
    points_density: float = 6.0
    """raw density that such a fog has at sparse points, those of the capture or else found in its photos
    (0: the same everywhere)"""
    hull_cells: int = 128
    """cells per axis of the visual hull"""
    carve_hollows: bool = True
    """take the lids off hollows, which the hull has where no silhouette shows them"""
    hull_slope: float = 100.0
    """raw density gained per world unit of depth at the hull, times the box's half size"""


@dataclass(frozen=True)
class LightSettings:
    """The environment map."""

    heights: tuple[int, ...] = (64, 128, 256)
    """rows of the map, coarse to fine, at the fractions of `field.size_starts`; where there are fewer than
    sizes, the last one stays, and where there are more, the others are never reached"""
    initial: float = 0.5
    """radiance of every texel at the start"""
    from_room: bool = True
    """before a room, the light begins as what has been found of the room by the time points begin to
    reflect; else as `initial`"""
    turntable: str = "auto"
    """'yes': the object was turned before a still camera, so the light goes round with the cameras; 'no';
    or 'auto': yes if the cameras stand on circles and what is beside the object never moves"""
    colour_tolerance: float = 0.0015
    """share by which the error of photos may grow at the end, where colours of the light are made coarser,
    those of up to 16 × 16 texels one (0: they stay): what photos do not tell of them is noise"""
    step_smoothing: float = 3.0
    """texels by which each step of the light is blurred at the start, and ever less until
    `step_smoothing_end` of the fit; 0: not at all"""
    step_smoothing_end: float = 0.2
    smoothness: float = 1.0
    """how far each texel is drawn to those around it, as a share of a step of the optimiser, where surfaces
    are too rough to tell what is finer (0: nowhere)"""
    smoothness_width: float = 3.0
    """how far around, texels"""
    colour_smoothness: float = 1.0
    """the same of colours, which are drawn to those of the energy around (0: nowhere)"""
    colour_smoothness_width: float = 12.0
    smoothness_start: float = 0.6
    """fraction of the fit from which on: while their gloss is open, surfaces become mirrors of a smooth
    light"""
    floor: bool = True
    """what the object stands on, where photos say what that is, lights it from close by; else all is far"""


@dataclass(frozen=True)
class FitSettings:
    """The optimisation."""

    steps: int = 2800
    """optimiser steps"""
    rays: int = 1024
    """pixels a step, at least; a primary ray each, or `render.pixel_grid` squared"""
    rays_at_once: int = 8192
    """primary rays worked on at once, at most, where `samples` does not say; for memory"""
    pixel_grid_start: float = 0.8
    """fraction of the fit from which on pixels have as many rays as `render.pixel_grid` says; one before"""
    unbiased: bool = True
    """from then on the noise of a pixel's rays is no error, and the gradient of roughness knows that rays
    of wider lobes stand for more of the light (docs/decisions/0039)"""
    most_rays: int = 0
    """pixels a step, at most, where `samples` leaves room (0: always `rays`)"""
    samples: int = 0
    """density samples of the primary rays of a chunk, about; a step with more is cut in chunks whose
    gradients are summed, on a card several at once (0: `rays_at_once` says)"""
    secondary_samples: int = 0
    """density samples of retraced rays a chunk, about; R follows (0: R is `render.retraced_rays`)"""
    learning_rate_grid: float = 0.04
    """of planes and lines"""
    learning_rate_network: float = 3e-3
    """of the feature basis, the heads and g"""
    learning_rate_light: float = 0.08
    """of the environment map's logarithm"""
    light_floor: float = 0.3
    """before a room, share of the light's mean gradient below which its texels take smaller steps: what
    hardly any ray tells of stays as it was, instead of becoming noise (0: Adam's, all of one size)"""
    light_floor_without_room: float = 0.03
    """the same where no room is before the light"""
    final_learning_rate: float = 0.05
    """all rates at the end, as a share of their start"""
    restart_schedule: bool = False
    """decay starts anew after each upsampling, as in the public code"""
    warm_up: int = 50
    """steps over which the rates rise from a tenth, at the start and after each upsampling"""
    background: str = "auto"
    """what stands behind the object: 'white', 'black', 'random' (a colour a ray, photos with alpha
    only), 'environment' (the fitted light itself), 'room' (a radiance field around the box, before the
    fitted light), or 'auto': white for photos with alpha, white or black for photos before plain white or
    black, else room"""
    room_light_weight: float = 0.05
    """of the squared difference between the logarithms of the light and of the room as seen from the box's
    centre, or of what is far away"""
    exposure: str = "fixed"
    """'gain' finds each photo's exposure, 'white_balance' a gain per channel, for photos that were shot
    on automatic; 'fixed' takes them as they are"""
    refine_cameras: bool = True
    """cameras that photos show to be off are adjusted to them, where sparse points are sought"""
    use_masks: bool = True
    """photos' alpha tells where the object is; else it is only used to lay them over a background"""
    cut_out: bool = True
    """photos without alpha before plain white or black get one, if what stands out fits together"""
    cut_out_before_far: bool = True
    """and those before surroundings so far away that all photos show the same in one direction, which then
    are the first light, and the light is held to them with `room_light_weight`"""
    cut_out_standing: bool = True
    """and those of something that stands on a table, a floor, a lawn where sparse points are"""
    doubt_outlines: bool = True
    """pixels along the outlines of photos' own masks do not count where these do not fit together and the
    shape says otherwise (docs/decisions/0054)"""
    mask_weight: float = 0.5
    """of (opacity − alpha)², where photos have alpha"""
    orientation_weight: float = 0.1
    """of Σ w·max(0, n·d)²: visible normals face the camera"""
    opacity_weight: float = 6e-4
    """of the opacity itself: discourages floaters"""
    bend_weight: float = 0.064
    """of e^(−r/0.15) times how unevenly the normals close by bend, 0 to 1 (`render.smoothness.bending`),
    at the start; fades as `smoothness_end`"""
    unevenness_weight: float = 0.002
    """of the difference to the materials close by, likewise"""
    smoothness_end: float = 0.4
    """what remains of both smoothness weights at the end"""
    palette_weight: float = 5e-3
    """of how unlike albedos of two points anywhere are, where they may be one colour: an object has few,
    while shadows left over in the albedo have many (docs/decisions/0017)"""
    palette_end: float = 0.1
    """what remains of it at the end, when photos have told textures from shadows"""
    palette_narrowing: float = 0.5
    """what remains at the end of the difference up to which colours may be one: then all that is left over
    in the albedo is small, and what is larger is texture (docs/decisions/0046)"""
    dielectric_weight: float = 1e-3
    """of x²/(x² + 0.02²), x being how far F0 is from 0.04: photos hardly tell a brighter light from a
    higher F0, but what is no metal has an index of refraction near 1.5 (docs/decisions/0015)"""
    grey_f0_weight: float = 1.0
    """of the squared colour of F0 where that is below 0.2, fading to nothing at 0.3: what is no metal has
    none, but seams between colours take from it what their albedo lacks (docs/decisions/0015)"""
    grey_f0_start: float = 0.7
    """fraction of the fit from which on that counts: metals that are late pass through such an F0"""
    metal_weight: float = 0.01
    """of (F0 − 0.9)² where F0 is above 0.3 and neither green nor blue: photos hardly tell a dim metal with
    a diffuse share under a bright light from a bright one (docs/decisions/0015)"""
    metal_albedo_weight: float = 0.02
    """of albedo² where F0 is above 0.6: metals have no diffuse layer"""
    grey_light_weight: float = 0.001
    """of the squared differences between the logarithms of the whole light's channels, where photos don't
    show it: as they hardly tell its colour from the object's, it has none (docs/decisions/0052)"""
    f0_start: float = 0.3
    """fraction of the fit from which on the other three count: metals are away from dielectrics by then"""
    roughness_weight: float = 0.0
    """of α = r² at the start, falling to nothing at the end: a wide lobe under a blurred light fits
    most photos, so roughness that starts wide stays there; 0.002 helps glazes (docs/decisions/0009)"""
    neighbour_distance: float = 1.5
    """how far away "close by" is, voxels"""
    neural_start: float = 0.0
    """share of the neural term g at the start; 0 switches it off"""
    neural_fade: tuple[float, float] = (0.4, 0.65)
    """fractions of the fit between which g is blended out, so that Cycles can show what is baked"""
    emission_fade: tuple[float, float] = (0.3, 0.45)
    """fractions of the fit between which points stop to shine by themselves, where it starts as a fog:
    without masks, a shape is found first by colours alone, then by what it reflects"""
    decoder: str = ""
    """a finished job whose decoder (feature basis, heads, g) is taken over and kept as it is"""
    snapshots: tuple[int, ...] = ()
    """steps at which pictures of render, weights and light are kept (paper's Fig. 'snapshots')"""
    preview_every: float = 20.0
    """seconds between pictures of the current state, at least; they take a twentieth of the time at most"""
    checkpoint_every: float = 30.0
    """seconds between checkpoints"""


@dataclass(frozen=True)
class Settings:
    """All settings of a reconstruction."""

    photos: PhotoSettings = dataclasses.field(default_factory=PhotoSettings)
    field: FieldSettings = dataclasses.field(default_factory=FieldSettings)
    light: LightSettings = dataclasses.field(default_factory=LightSettings)
    render: RenderSettings = dataclasses.field(default_factory=RenderSettings)
    fit: FitSettings = dataclasses.field(default_factory=FitSettings)
    asset: AssetSettings = dataclasses.field(default_factory=AssetSettings)


def overridden(settings: Settings, key: str, value: object) -> Settings:
    """Settings with one of them changed; texts are converted.

    Args:
        key: `section.field`.

    Raises:
        SettingsError: unknown section or field, or a value of the wrong type or out of its range.
    """
    section_name, _, name = key.partition(".")
    sections = {f.name for f in dataclasses.fields(settings)}
    if section_name not in sections:
        raise SettingsError(
            f"Setting '{key}': there is no section '{section_name}'; sections are "
            f"{', '.join(sorted(sections))}."
        )
    section = getattr(settings, section_name)
    types = typing.get_type_hints(type(section))
    names = [f.name for f in dataclasses.fields(section)]
    if name not in names:
        raise SettingsError(
            f"Setting '{key}': section '{section_name}' has no '{name}'; it has {', '.join(names)}."
        )
    try:
        converted = _convert(value, types[name])
    except (TypeError, ValueError):
        raise SettingsError(
            f"Setting '{key}': '{value}' is not valid; expected {_type_name(types[name])}."
        ) from None
    problem = problem_of(key, converted)
    if problem is not None:
        raise SettingsError(f"Setting '{key}': '{value}' is not allowed; {problem}.")
    section = dataclasses.replace(section, **{name: converted})
    return dataclasses.replace(settings, **{section_name: section})


def checked(settings: Settings) -> Settings:
    """The same settings, if those that belong together fit each other.

    Raises:
        SettingsError: they don't.
    """
    sizes, starts = settings.field.sizes, settings.field.size_starts
    if not sizes or len(sizes) != len(starts):
        raise SettingsError(
            f"Settings 'field.sizes' and 'field.size_starts': there are {len(sizes)} sizes and "
            f"{len(starts)} starts; give as many of one as of the other."
        )
    if starts[0] != 0:
        raise SettingsError("Setting 'field.size_starts': the first must be 0.")
    smooth = settings.field.step_smoothing
    if min(smooth) == 0 and max(smooth) > 0:
        raise SettingsError(
            "Setting 'field.step_smoothing': one end is 0; give two zeros, or two widths above 0."
        )
    return settings


def _convert(value: object, wanted: object) -> object:
    if typing.get_origin(wanted) is tuple:
        item, *others = typing.get_args(wanted)
        parts = value.split(",") if isinstance(value, str) else list(value)
        if others != [...] and len(parts) != 1 + len(others):
            raise ValueError(value)
        return tuple(_convert(part, item) for part in parts)
    if wanted is bool:
        text = str(value).lower()
        if text in ("1", "true", "yes", "on"):
            return True
        if text in ("0", "false", "no", "off"):
            return False
        raise ValueError(value)
    return wanted(value)


def _type_name(wanted: object) -> str:
    if typing.get_origin(wanted) is tuple:
        item, *others = typing.get_args(wanted)
        some = "a list of" if others == [...] else f"{1 + len(others)}"
        return f"{some} {_type_name(item).removeprefix('a ')}s"
    return {int: "a whole number", float: "a number", bool: "yes or no", str: "text"}.get(
        wanted, str(wanted)
    )
