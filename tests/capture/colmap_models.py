"""COLMAP models as COLMAP writes them, for tests."""

import struct

PARAMETERS = {
    "SIMPLE_PINHOLE": (70, 30, 25),
    "PINHOLE": (70, 60, 30, 25),
    "SIMPLE_RADIAL": (70, 30, 25, -0.12),
    "RADIAL": (70, 30, 25, -0.12, 0.03),
    "OPENCV": (70, 60, 30, 25, 0.1, -0.05, 0.004, -0.003),
    "OPENCV_FISHEYE": (70, 60, 30, 25, 0.05, -0.01, 0.002, 0.001),
    "FULL_OPENCV": (70, 60, 30, 25, 0.3, -0.05, 0.002, -0.001, 0.01, 0.2, 0.03, 0.001),
    "FOV": (70, 60, 30, 25, 0.8),
    "SIMPLE_RADIAL_FISHEYE": (70, 30, 25, 0.06),
    "RADIAL_FISHEYE": (70, 30, 25, 0.06, -0.02),
    "THIN_PRISM_FISHEYE": (70, 60, 30, 25, 0.05, -0.01, 0.003, -0.002, 0.002, 1e-3, 0.004, -0.003),
    "RAD_TAN_THIN_PRISM_FISHEYE": (
        *(70, 60, 30, 25, 0.05, -0.01, 0.002, -0.001, 5e-4, 1e-4),
        *(0.003, -0.002, 0.004, -0.003, 0.002, 0.001),
    ),
    "SIMPLE_DIVISION": (70, 30, 25, -0.2),
    "DIVISION": (70, 60, 30, 25, 0.15),
    "SIMPLE_FISHEYE": (70, 30, 25),
    "FISHEYE": (70, 60, 30, 25),
    "EUCM": (70, 60, 30, 25, 0.6, 1.1),
    "EQUIRECTANGULAR": (64, 48),
}
WRITERS = {"bin": "write_binary", "txt": "write_text"}


def write(reconstruction, folder, extension="bin"):
    folder.mkdir(parents=True, exist_ok=True)
    getattr(reconstruction, WRITERS[extension])(folder)
    return folder


def without_poses(file):
    if file.suffix == ".txt":
        lines = file.read_text().splitlines()
        for index, line in enumerate(lines):
            words = line.split(" ")
            if not line.startswith("#") and len(words) > 8:
                lines[index] = " ".join([words[0], *["nan"] * 7, *words[8:]])
        file.write_text("\n".join(lines) + "\n")
        return
    data = bytearray(file.read_bytes())
    at = 8
    for _ in range(struct.unpack_from("<Q", data)[0]):
        data[at + 4 : at + 60] = bytes(56)
        at = data.index(b"\0", at + 64) + 1
        at += 8 + 24 * struct.unpack_from("<Q", data, at)[0]
    file.write_bytes(data)
