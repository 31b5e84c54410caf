"""The surface as game engines and exchange formats have it: base colour and metalness.

Few of them know F0 as a colour (glTF's KHR_materials_specular, Blender's specular tint); to the others a
metal without metalness is black plastic. So metals, which have no diffuse layer to speak of, are given as
metals. Those that know F0 still get it beside that: it is what the part reflects that is no metal.
"""

from __future__ import annotations

import numpy as np

from ..brdf.microfacet import SURE_DIELECTRIC_F0

SURE_METAL_F0 = 0.4
"""of the brightest channel; half way there from what is surely no metal, a surface is half a one"""


def metallic_workflow(albedo: np.ndarray, f0: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Base colour [..., 3] and metalness [..., 1] of what has an albedo and an F0 [..., 3], all linear.

    A diffuse share is left as such: metalness m reflects F0 as a metal and leaves (1 − m) · base colour
    diffuse, which is the albedo if m = 1 − albedo/F0. Where that is 1, the base colour is F0, where it
    is 0 the albedo, so what is no metal stays as it was.
    """
    brightest = f0.max(-1, keepdims=True)
    share = (brightest - SURE_DIELECTRIC_F0) / (SURE_METAL_F0 - SURE_DIELECTRIC_F0)
    diffuse = albedo.mean(-1, keepdims=True) / np.maximum(f0.mean(-1, keepdims=True), 1e-6)
    metalness = np.clip(share, 0, 1) * (1 - np.minimum(diffuse, 1))
    # A metal reflects by its base colour alone, so a little of the albedo must not dim it.
    of_f0 = 1 - (1 - metalness) ** 2
    base = (1 - of_f0) * portable_albedo(albedo, f0) + of_f0 * f0
    return base, metalness


def portable_albedo(albedo: np.ndarray, f0: np.ndarray) -> np.ndarray:
    """Albedo [..., 3] that makes up for attenuation by the largest channel of F0, as in glTF; at most 1."""
    largest = f0.max(-1, keepdims=True)
    return np.minimum(albedo * (1 - f0) / np.maximum(1 - largest, 1e-3), 1.0)
