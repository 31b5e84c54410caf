"""The surface as game engines and exchange formats have it: base colour and metalness.

Few of them know F0 as a colour (glTF's KHR_materials_specular, Blender's specular tint); to the others a
metal without metalness is black plastic. So metals are given as metals, with the little that they have of a
diffuse layer. Those that know F0 still get it beside that: it is what the part reflects that is no metal.
"""

from typing import NamedTuple

import numpy as np

from ..brdf.microfacet import DIELECTRIC_F0, SURE_DIELECTRIC_F0, principled_albedo

SURE_METAL_F0 = 0.4
"""of the brightest channel; half way there from what is surely no metal, a surface is half a one"""


class Metallic(NamedTuple):
    """A surface as glTF has it, linear."""

    base_colour: np.ndarray  # [..., 3]
    metalness: np.ndarray  # [..., 1]
    rest_f0: np.ndarray  # [..., 3] F0 of what is no metal of it


def metallic_workflow(albedo: np.ndarray, f0: np.ndarray) -> Metallic:
    """What looks like a surface that has an albedo and an F0 [..., 3], linear.

    Base colour b and metalness m have a diffuse layer of (1 − m) b and reflect m b + 0.04 (1 − m). To have
    a of the one and F0 of the other, b = a + F0 − 0.04 (1 − m), and so, by their means over channels,
    b² − (a + F0) b + 0.04 a = 0 and m = 1 − a/b. What is surely no metal has no metalness and its own F0:
    to those who do not know it, it is as glossy as most things are.
    """
    metal = (f0.max(-1, keepdims=True) - SURE_DIELECTRIC_F0) / (SURE_METAL_F0 - SURE_DIELECTRIC_F0)
    metal = np.clip(metal, 0, 1)
    diffuse = principled_albedo(albedo, f0)
    left, both = (values.mean(-1, keepdims=True) for values in (diffuse, diffuse + f0))
    root = np.sqrt(np.maximum(both**2 - 4 * DIELECTRIC_F0 * left, 0))
    metalness = np.clip(1 - 2 * left / np.maximum(both + root, 1e-6), 0, 1)
    base = np.clip(diffuse + f0 - DIELECTRIC_F0 * (1 - metalness), 0, 1)
    return Metallic(
        (1 - metal) * portable_albedo(albedo, f0) + metal * base,
        metal * metalness,
        (1 - metal) * f0 + metal * np.minimum(f0, DIELECTRIC_F0),
    )


def portable_albedo(albedo: np.ndarray, f0: np.ndarray) -> np.ndarray:
    """Albedo [..., 3] that makes up for attenuation by the largest channel of F0, as in glTF; at most 1."""
    largest = f0.max(-1, keepdims=True)
    return np.minimum(albedo * (1 - f0) / np.maximum(1 - largest, 1e-3), 1.0)
