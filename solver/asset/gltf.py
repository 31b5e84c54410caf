"""asset.glb: the mesh with textures as glTF 2.0; F0 of what is no metal by KHR_materials_specular.

glTF has Y up; the export turns the object by −90° about X.
"""

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..brdf.microfacet import DIELECTRIC_F0
from ..capture.colour import linear_to_srgb
from ..replacing import written_beside
from .files import picture_of
from .metallic import Metallic
from .tangent import vertex_tangents
from .unwrap import UnwrappedMesh

_FLOAT, _UNSIGNED_INT = 5126, 5125
_ARRAY_BUFFER, _ELEMENT_BUFFER = 34962, 34963
_CLAMP_TO_EDGE = 33071


def write_glb(
    path: Path, mesh: UnwrappedMesh, metallic: Metallic, roughness: np.ndarray, normal: np.ndarray,
    name: str, closed: bool,
) -> None:  # fmt: skip
    """Write the mesh with textures [S, S, C] (linear; normals coded).

    Args:
        name: of object, mesh and material; textures are called after it.
        closed: its insides are never seen; else both sides are drawn.
    """
    binary = bytearray()
    views: list[dict[str, Any]] = []

    def add(data: bytes, target: int | None = None) -> int:
        binary.extend(b"\0" * (-len(binary) % 4))
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)})
        if target is not None:
            views[-1]["target"] = target
        binary.extend(data)
        return len(views) - 1

    turn = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], dtype=np.float32)
    positions = (mesh.positions @ turn.T).astype("<f4")
    normals = (mesh.normals @ turn.T).astype("<f4")
    tangents, signs = vertex_tangents(mesh)
    tangents = np.concatenate([tangents @ turn.T, signs[:, None]], axis=1).astype("<f4")
    uvs = mesh.uvs.astype("<f4") * np.float32([1, -1]) + np.float32([0, 1])
    arrays = [
        (positions, "VEC3", {"min": positions.min(0).tolist(), "max": positions.max(0).tolist()}),
        (normals, "VEC3", {}),
        (tangents, "VEC4", {}),
        (uvs, "VEC2", {}),
    ]
    accessors = [
        {"bufferView": add(array.tobytes(), _ARRAY_BUFFER), "componentType": _FLOAT,
         "count": len(array), "type": kind, **extra}
        for array, kind, extra in arrays
    ]  # fmt: skip
    indices = mesh.faces.astype("<u4").ravel()
    accessors.append(
        {"bufferView": add(indices.tobytes(), _ELEMENT_BUFFER), "componentType": _UNSIGNED_INT,
         "count": len(indices), "type": "SCALAR"}
    )  # fmt: skip
    zeros = np.zeros_like(roughness)
    f0_scale = float(max(metallic.rest_f0.max(), 1e-3))
    images = {
        "base_colour": linear_to_srgb(metallic.base_colour),
        "metallic_roughness": np.concatenate([zeros, roughness, metallic.metalness], -1),
        "normal": normal, "f0": linear_to_srgb(metallic.rest_f0 / f0_scale),
    }  # fmt: skip
    image_entries = [
        {"name": f"{name}_{kind}", "bufferView": add(_png(image)), "mimeType": "image/png"}
        for kind, image in images.items()
    ]
    binary.extend(b"\0" * (-len(binary) % 4))
    document = {
        "asset": {"version": "2.0", "generator": f"Neural Microfacet Fields {__version__}"},
        "extensionsUsed": ["KHR_materials_specular"],
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0, "name": name}],
        "meshes": [{"name": name, "primitives": [{
            "attributes": {"POSITION": 0, "NORMAL": 1, "TANGENT": 2, "TEXCOORD_0": 3},
            "indices": 4, "material": 0,
        }]}],
        "materials": [_material(name, f0_scale, closed)],
        "textures": [{"source": i, "sampler": 0} for i in range(len(images))],
        "samplers": [{"wrapS": _CLAMP_TO_EDGE, "wrapT": _CLAMP_TO_EDGE}], "images": image_entries,
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": len(binary)}],
    }  # fmt: skip
    _write_container(path, document, binary)


def _material(name: str, f0_scale: float, closed: bool) -> dict[str, Any]:
    """The material of textures in the order base colour, metalness and roughness, normal, F0."""
    factor = f0_scale / DIELECTRIC_F0
    return {
        "name": name, "doubleSided": not closed,
        "pbrMetallicRoughness": {
            "baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 1},
            "metallicFactor": 1.0, "roughnessFactor": 1.0,
        },
        "normalTexture": {"index": 2},
        "extensions": {
            "KHR_materials_specular": {
                "specularColorFactor": [factor] * 3, "specularColorTexture": {"index": 3},
            }
        },
    }  # fmt: skip


def _write_container(path: Path, document: dict[str, Any], binary: bytes | bytearray) -> None:
    """Write a GLB of a JSON chunk and a binary one, which has a multiple of four bytes."""
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    total = 12 + 8 + len(text) + 8 + len(binary)
    with written_beside(path) as part, part.open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, total))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", len(binary), b"BIN\0") + binary)


def _png(values: np.ndarray) -> bytes:
    stream = io.BytesIO()
    picture_of(values).save(stream, "PNG")
    return stream.getvalue()
