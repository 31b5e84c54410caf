"""Small photos with cameras, and pictures of a preview. Standard library and numpy alone."""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path

import numpy as np


def write_pixels(path: Path, pixels: np.ndarray, bits: int = 8) -> None:
    """RGB PNG of 8 or 16 bits of pixels [H, W, 3] in [0, 1]."""
    path.parent.mkdir(parents=True, exist_ok=True)
    data = (np.clip(pixels, 0, 1) * (2**bits - 1) + 0.5).astype(f">u{bits // 8}")
    height, width = data.shape[:2]
    rows = b"".join(b"\0" + row.tobytes() for row in data)

    def chunk(kind: bytes, content: bytes) -> bytes:
        check = struct.pack(">I", zlib.crc32(kind + content))
        return struct.pack(">I", len(content)) + kind + content + check

    header = struct.pack(">IIBBBBB", width, height, bits, 2, 0, 0, 0)
    parts = chunk(b"IHDR", header), chunk(b"IDAT", zlib.compress(rows)), chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts))


def write_preview(path: Path, shade: float, size: int = 120) -> None:
    """`preview/render.png`: photo, render and normals side by side."""
    y, x = np.mgrid[-1 : 1 : 1j * size, -1 : 1 : 1j * size]
    disc = (x**2 + y**2 < 0.6)[..., None]
    z = np.sqrt(np.clip(0.6 - x**2 - y**2, 0, None))
    photo = np.where(disc, np.array([0.8, 0.4, 0.2]) * (0.4 + z[..., None]), 1.0)
    render = photo * shade + (1 - shade)
    normals = np.where(disc, 0.5 + 0.5 * np.stack([x, -y, z], -1) / 0.78, 1.0)
    write_pixels(path, np.concatenate([photo, render, normals], axis=1))


def write_capture(folder: Path, count: int = 3, size: int = 16) -> Path:
    """Photos on a ring around the origin and their transforms_train.json."""
    y, x = np.mgrid[-1 : 1 : 1j * size, -1 : 1 : 1j * size]
    disc = (x**2 + y**2 < 0.5)[..., None]
    names = [f"photos/r_{n}.png" for n in range(count)]
    for name in names:
        write_pixels(folder / name, np.where(disc, [0.7, 0.3, 0.2], 1.0))
    return write_cameras(folder / "transforms_train.json", names)


def write_cameras(path: Path, names: list[str]) -> Path:
    """A transforms file of cameras on a ring around the origin for photos of these names."""
    frames = []
    for n, name in enumerate(names):
        angle = 2 * np.pi * n / len(names)
        position = np.array([4 * np.cos(angle), 4 * np.sin(angle), 1.0])
        back = position / np.linalg.norm(position)
        right = np.cross([0, 0, 1.0], back)
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, :4] = np.stack([right, np.cross(back, right), back, position], axis=1)
        frames.append({"file_path": name, "transform_matrix": pose.tolist()})
    path.write_text(json.dumps({"camera_angle_x": 0.7, "frames": frames}), encoding="utf-8")
    return path
