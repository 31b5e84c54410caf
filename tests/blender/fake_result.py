"""A small, complete result folder: a cube with four textures and a light. Standard library alone."""

import json
import struct
import zlib
from pathlib import Path

CORNERS = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def write_png(path: Path, colour, size: int = 4) -> None:
    """A PNG of one colour (8-bit RGB)."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = b"".join(b"\0" + bytes(colour) * size for _ in range(size))
    header = struct.pack(">IIBBBBB", size, size, 8, 2, 0, 0, 0)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(rows))
        + chunk(b"IEND", b"")
    )


def write_exr(path: Path, width: int = 8, height: int = 4, value: float = 0.5) -> None:
    """An uncompressed OpenEXR of one grey (float RGB)."""

    def attribute(name: str, kind: str, data: bytes) -> bytes:
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(data)) + data

    channels = b"".join(
        name + b"\0" + struct.pack("<iBBBBii", 2, 0, 0, 0, 0, 1, 1) for name in (b"B", b"G", b"R")
    )
    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    header = b"\x76\x2f\x31\x01" + struct.pack("<i", 2)
    header += attribute("channels", "chlist", channels + b"\0")
    header += attribute("compression", "compression", b"\0")
    header += attribute("dataWindow", "box2i", box) + attribute("displayWindow", "box2i", box)
    header += attribute("lineOrder", "lineOrder", b"\0")
    header += attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
    header += attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0))
    header += attribute("screenWindowWidth", "float", struct.pack("<f", 1)) + b"\0"
    line = struct.pack(f"<{3 * width}f", *([value] * 3 * width))
    first = len(header) + 8 * height
    table = b"".join(struct.pack("<Q", first + y * (8 + len(line))) for y in range(height))
    body = b"".join(struct.pack("<ii", y, len(line)) + line for y in range(height))
    path.write_bytes(header + table + body)


def write_ply(path: Path) -> None:
    """A cube of half size 0.5 with a UV square per face, outward normals."""
    vertices, faces = [], []
    for quad in QUADS:
        points = [CORNERS[i] for i in quad]
        normal = [sum(p[a] for p in points) / 4 for a in range(3)]
        first = len(vertices)
        for point, uv in zip(points, ((0, 0), (1, 0), (1, 1), (0, 1)), strict=True):
            vertices.append([0.5 * c for c in point] + normal + list(uv))
        faces += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
    names = "x y z nx ny nz s t".split()
    header = "ply\nformat binary_little_endian 1.0\n" + f"element vertex {len(vertices)}\n"
    header += "".join(f"property float {name}\n" for name in names)
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    body = b"".join(struct.pack("<8f", *v) for v in vertices)
    body += b"".join(struct.pack("<Biii", 3, *f) for f in faces)
    path.write_bytes(header.encode() + body)


def write_result(root: Path) -> None:
    """Write JOB/job.json (if there is none) and a complete JOB/result."""
    result = root / "result"
    result.mkdir(parents=True, exist_ok=True)
    if not (root / "job.json").exists():
        (root / "job.json").write_text(json.dumps({"schema_version": 1, "capture": "none"}))
    write_ply(result / "mesh.ply")
    for name, colour in {
        "albedo": (188, 100, 60), "f0": (255, 255, 255), "roughness": (128, 128, 128), "normal": (128, 128, 255),
        "base_colour": (188, 100, 60), "metallic": (0, 0, 0),
    }.items():  # fmt: skip
        write_png(result / f"{name}.png", colour)
    write_exr(result / "environment.exr")
    textures = {
        "albedo": {"file": "albedo.png", "colour_space": "sRGB"},
        "f0": {"file": "f0.png", "colour_space": "sRGB", "scale": 0.08},
        "roughness": {"file": "roughness.png", "colour_space": "Non-Color"},
        "normal": {"file": "normal.png", "colour_space": "Non-Color", "space": "tangent"},
        "base_colour": {"file": "base_colour.png", "colour_space": "sRGB"},
        "metallic": {"file": "metallic.png", "colour_space": "Non-Color"},
    }
    manifest = {
        "schema_version": 1, "mesh": "mesh.ply", "textures": textures, "bounces": 2,
        "environment": {"file": "environment.exr", "colour_space": "Linear Rec.709"},
    }  # fmt: skip
    (result / "manifest.json").write_text(json.dumps(manifest))
