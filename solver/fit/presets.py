"""The presets, and the paper's ablations as overrides of any of them."""

from ..capture.photo_settings import PhotoSettings
from ..render.scene import RenderSettings
from .errors import SettingsError
from .settings import FieldSettings, FitSettings, LightSettings, Settings, checked, overridden

DRAFT = Settings(
    field=FieldSettings(step_smoothing=(0.006, 0.003)),
    render=RenderSettings(shaded_depths=2, secondary_depths=1, secondary_rays=16, pixel_grid=2),
    fit=FitSettings(steps=2400, pixel_grid_start=0.5),
)

STANDARD = Settings(
    photos=PhotoSettings(most_pixels=1_440_000),
    field=FieldSettings(sizes=(128, 192, 256), size_starts=(0.0, 0.1, 0.35)),
    render=RenderSettings(
        shaded_depths=2, secondary_depths=1, secondary_rays=32, retraced_rays=2048,
        secondary_bounce_rays=4, pixel_grid=2,
    ),
    fit=FitSettings(steps=5000, rays=2048, pixel_grid_start=0.6),
)  # fmt: skip

# The paper's schedule; where its text and its public code differ, as decisions/0006 says.
PAPER = Settings(
    photos=PhotoSettings(most_pixels=0),
    field=FieldSettings(
        sizes=(128, 162, 196, 231, 265, 300),
        size_starts=(0.0, 2000 / 30000, 3000 / 30000, 4000 / 30000, 5500 / 30000, 7000 / 30000),
        finest_without_masks=2048, hull_start=False, turn_box=False,
        initial_albedo=0.91, initial_roughness=0.6, initial_f0=0.5,
        occupancy_min_alpha=0.001, step_smoothing=(0.0, 0.0), steepening=1.0,
    ),
    light=LightSettings(
        heights=(512,), turntable="no", colour_tolerance=0.0, step_smoothing=0.0,
        smoothness=0.0, colour_smoothness=0.0, floor=False,
    ),
    render=RenderSettings(
        secondary_step=0.5, secondary_rays=128, min_weight=0.0, min_transmittance=1e-4,
        retraced_rays=1000, retrace_choice="noisy", secondary_bounce_rays=8, visibility=False,
        light_masking=False, pixel_footprint=False, diffuse_visibility=False,
    ),
    fit=FitSettings(
        steps=30000, rays=4096, most_rays=8000, samples=200_000, secondary_samples=1_000_000,
        learning_rate_network=1e-3, learning_rate_light=0.02, final_learning_rate=1e-3,
        learning_rate_grid=0.02, restart_schedule=True, warm_up=100, background="white",
        refine_cameras=False, use_masks=False, doubt_outlines=False, mask_weight=0.0, unbiased=False,
        # The paper sums over the three channels where `losses` takes their mean.
        orientation_weight=0.1 / 3, opacity_weight=6e-4 / 3, bend_weight=0.0,
        unevenness_weight=0.0, palette_weight=0.0, dielectric_weight=0.0, grey_f0_weight=0.0,
        metal_weight=0.0, metal_albedo_weight=0.0, grey_light_weight=0.0,
        light_floor_without_room=0.0, neighbour_distance=0.0,
        neural_start=1.0, neural_fade=(1.0, 1.0), emission_fade=(0.0, 0.0),
    ),
)  # fmt: skip

PRESETS: dict[str, Settings] = {"draft": DRAFT, "standard": STANDARD, "paper": PAPER}


def settings_for(preset: str, overrides: dict[str, object] | None = None) -> Settings:
    """The preset's settings with `section.field` overrides (texts are converted).

    Raises:
        SettingsError: unknown preset, section or field, a value of the wrong type, or values that don't
            fit each other.
    """
    if preset not in PRESETS:
        raise SettingsError(f"There is no preset '{preset}'; choose one of {', '.join(PRESETS)}.")
    settings = PRESETS[preset]
    for key, value in (overrides or {}).items():
        settings = overridden(settings, key, value)
    return checked(settings)
