"""The asset's files: mesh.ply, textures, environment.exr; written beside, renamed."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO
from PIL import Image

from ..capture.colour import REC709
from ..replacing import written_beside
from .unwrap import UnwrappedMesh


def remove_parts(folder: Path) -> None:
    """Remove files below a folder that a process which was stopped has not renamed into place."""
    for part in [*folder.rglob("*.part"), *folder.rglob("*.part.*")]:
        with suppress(OSError):  # on Windows somebody may look at it
            part.unlink(missing_ok=True)


def write_ply(path: Path, mesh: UnwrappedMesh) -> None:
    """Binary PLY with positions, normals and UVs (`s`, `t`) per vertex."""
    vertex = np.concatenate([mesh.positions, mesh.normals, mesh.uvs], axis=1).astype("<f4")
    face = np.empty(len(mesh.faces), dtype=[("count", "u1"), ("vertices", "<i4", 3)])
    face["count"], face["vertices"] = 3, mesh.faces
    properties = "".join(f"property float {name}\n" for name in "x y z nx ny nz s t".split())
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertex)}\n{properties}"
        f"element face {len(face)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    with written_beside(path) as part:
        part.write_bytes(header.encode("ascii") + vertex.tobytes() + face.tobytes())


def picture_of(values: np.ndarray) -> Image.Image:
    """An 8-bit picture of values [H, W, C] in [0, 1], C = 1 or 3, as they are."""
    pixels = (np.clip(values, 0, 1) * 255 + 0.5).astype(np.uint8)
    return Image.fromarray(pixels[..., 0] if pixels.shape[2] == 1 else pixels)


def write_png(path: Path, values: np.ndarray) -> None:
    """Write values [H, W, C] in [0, 1], as they are, as an 8-bit PNG, renamed into place."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with written_beside(path) as part:
        picture_of(values).save(part)


def write_fine_png(path: Path, values: np.ndarray) -> None:
    """Write values [S, S, 3] in [0, 1], as they are, as a 16-bit PNG: what Pillow cannot.

    Raises:
        OSError: it cannot be written.
    """
    pixels = (np.clip(values, 0, 1) * 65535 + 0.5).astype(np.uint16)
    picture = OpenImageIO.ImageBuf(pixels)
    with written_beside(path) as part:
        if not picture.write(str(part)):
            raise OSError(f"{path}: {picture.geterror()}")


def write_exr(path: Path, channels: dict[str, np.ndarray]) -> None:
    """Write an OpenEXR file of linear Rec.709 or plain data; channels are named arrays, 32-bit floats."""
    data = {name: np.ascontiguousarray(values, np.float32) for name, values in channels.items()}
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage,
        "chromaticities": REC709,  # so that no reader needs to guess what the numbers mean
    }  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    with written_beside(path) as part:
        OpenEXR.File(header, data).write(str(part))
