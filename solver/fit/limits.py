"""What values settings may have: at least 0 and finite, unless it says otherwise here."""

import math

from ..capture.photo_settings import COLOUR_SPACES

BACKGROUNDS = ("auto", "white", "black", "random", "environment", "room")
EXPOSURES = ("fixed", "gain", "white_balance")
CHOICES = {
    "fit.background": BACKGROUNDS, "fit.exposure": EXPOSURES, "photos.colour_space": COLOUR_SPACES,
    "render.retrace_choice": ("systematic", "noisy"), "light.turntable": ("auto", "yes", "no"),
}  # fmt: skip

_TINY = 1e-6
LEAST = {
    "field.sizes": 8, "field.density_components": 1, "field.feature_components": 1,
    "field.feature_size": 1, "field.occupancy_cells": 4, "field.hull_cells": 8,
    "field.finest_without_masks": 8, "field.steepening": 1,
    "field.initial_albedo": _TINY, "field.initial_roughness": 0.01, "field.initial_f0": _TINY,
    "light.heights": 2, "light.initial": _TINY,
    "render.step": 0.01, "render.secondary_step": 0.01, "render.pixel_grid": 1,
    "render.secondary_rays": 1, "render.secondary_bounce_rays": 1,
    "fit.steps": 1, "fit.rays": 1, "fit.rays_at_once": 1, "fit.final_learning_rate": _TINY,
    "fit.palette_narrowing": _TINY,
    "asset.cells": 8, "asset.triangles": 4, "asset.texture_size": 16, "asset.march_voxels": _TINY,
    "asset.march_samples": 1,
}  # fmt: skip
MOST = {
    "field.size_starts": 1, "field.initial_albedo": 0.999, "field.initial_roughness": 1,
    "field.initial_f0": 0.999, "field.occupancy_min_alpha": 1, "field.sizes": 2048,
    "field.occupancy_cells": 1024, "field.hull_cells": 1024, "light.heights": 8192,
    "field.steepening": 100, "field.steepening_span": 1,
    "light.step_smoothing_end": 1, "light.smoothness_start": 1,
    "render.pixel_grid": 16, "render.min_weight": 1, "render.min_transmittance": 1,
    "fit.pixel_grid_start": 1, "fit.final_learning_rate": 1, "fit.smoothness_end": 1,
    "fit.palette_end": 1, "fit.palette_narrowing": 1, "fit.f0_start": 1, "fit.neural_start": 1,
    "fit.light_floor": 1, "fit.light_floor_without_room": 1, "fit.neural_fade": 1, "fit.emission_fade": 1,
    "asset.cells": 2048, "asset.smoothing": 1000, "asset.texture_size": 16384, "asset.floater_share": 1,
    "asset.shred_share": 1, "asset.unseen_share": 1,
}  # fmt: skip
RISING = (
    "field.sizes", "field.size_starts", "field.steepening_span", "fit.neural_fade", "fit.emission_fade",
)  # fmt: skip
DECIDED_ELSEWHERE = {
    "render.neural": "fit.neural_start and fit.neural_fade", "render.emission": "fit.emission_fade",
    "render.neighbour_distance": "fit.neighbour_distance", "render.widening_gradient": "fit.unbiased",
}  # fmt: skip
"""settings that a fit overwrites by others"""


def problem_of(key: str, value: object) -> str | None:
    """What is wrong with a setting's value of the right type, as half a sentence; None if nothing is."""
    if key in DECIDED_ELSEWHERE:
        return f"set {DECIDED_ELSEWHERE[key]} instead"
    if key in CHOICES and value not in CHOICES[key]:
        return f"choose one of {', '.join(CHOICES[key])}"
    numbers = [v for v in (value if isinstance(value, tuple) else (value,)) if _is_number(v)]
    if not all(math.isfinite(number) for number in numbers):
        return "it must be finite"
    least, most = LEAST.get(key, 0), MOST.get(key, math.inf)
    if any(number < least for number in numbers):
        return f"it must be {least:g} or more"
    if any(number > most for number in numbers):
        return f"it must be {most:g} or less"
    if key in RISING and numbers != sorted(numbers):
        return "the numbers must increase"
    return None


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
