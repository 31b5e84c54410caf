"""Axis conventions, all in one place.

World: right-handed, +Z up, as in Blender.

Camera axes: OpenGL's and Blender's, +X right, +Y up, the view along −Z. OpenCV and COLMAP have
+X right, +Y down, the view along +Z: half a turn about X.

Pixels: (column, row), row 0 on top, pixel centres at +0.5. `x`, `y` of an ideal image are OpenCV's:
y down, at unit distance along the optical axis.

Environment: Blender's equirectangular map. Row 0 is +Z, the image's centre is +X, left of the centre
(u = ¼) is +Y, the left and right edges are −X.
"""

import numpy as np

OPENGL_FROM_OPENCV = np.array([1.0, -1.0, -1.0])


def opengl_from_opencv(vectors: np.ndarray) -> np.ndarray:
    """Vectors [..., 3] in OpenCV's camera axes to OpenGL's."""
    return np.asarray(vectors) * OPENGL_FROM_OPENCV


def pose_opengl_from_opencv(camera_to_world: np.ndarray) -> np.ndarray:
    """Camera-to-world matrices [..., 4, 4] of OpenCV cameras as those of OpenGL cameras."""
    return np.asarray(camera_to_world) * np.append(OPENGL_FROM_OPENCV, 1.0)


def opencv_from_opengl(vectors: np.ndarray) -> np.ndarray:
    """Vectors [..., 3] in OpenGL's camera axes to OpenCV's: half a turn about X is its own inverse."""
    return opengl_from_opencv(vectors)


def pose_opencv_from_opengl(camera_to_world: np.ndarray) -> np.ndarray:
    """Camera-to-world matrices [..., 4, 4] of OpenGL cameras as those of OpenCV cameras."""
    return pose_opengl_from_opencv(camera_to_world)


def rigid(rotation: np.ndarray, place: np.ndarray) -> np.ndarray:
    """The matrix [4, 4] of a rotation [3, 3] and a place [3]."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, place
    return matrix


def rotation_about(axis: int, degrees: float) -> np.ndarray:
    """The rotation [3, 3] about x, y or z (0, 1, 2), counterclockwise for one who looks against it."""
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    first, second, rotation = (axis + 1) % 3, (axis + 2) % 3, np.eye(3)
    rotation[first, first] = rotation[second, second] = cosine
    rotation[second, first], rotation[first, second] = sine, -sine
    return rotation


def rotation_from_omega_phi_kappa(degrees: np.ndarray) -> np.ndarray:
    """Rx(ω) Ry(φ) Rz(κ) [3, 3] of photogrammetry's three angles."""
    about_x, about_y, about_z = map(rotation_about, range(3), degrees)
    return about_x @ about_y @ about_z


def invert_pose(pose: np.ndarray) -> np.ndarray:
    """Inverse of rigid motions [..., 4, 4] (camera to world ↔ world to camera)."""
    pose = np.asarray(pose, dtype=np.float64)
    inverse = np.zeros_like(pose)
    rotation = np.swapaxes(pose[..., :3, :3], -1, -2)
    inverse[..., :3, :3] = rotation
    inverse[..., :3, 3] = -np.einsum("...ij,...j->...i", rotation, pose[..., :3, 3])
    inverse[..., 3, 3] = 1
    return inverse


def pose_of_opencv(from_world: np.ndarray) -> np.ndarray:
    """The camera-to-world matrix [4, 4] of an OpenGL camera of what takes the world to an OpenCV camera."""
    return pose_opengl_from_opencv(invert_pose(from_world))


def scale_and_rotation(matrix: np.ndarray) -> tuple[float, np.ndarray]:
    """What a similarity [4, 4] does to lengths, and its rotation [3, 3]."""
    scale = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
    return scale, matrix[:3, :3] / scale


def rotation_from_quaternion(quaternion: np.ndarray) -> np.ndarray:
    """Rotation matrices [..., 3, 3] of quaternions [..., 4] w x y z (Hamilton's), of any length.

    NaN for those of no length.
    """
    q = np.asarray(quaternion, dtype=np.float64)
    with np.errstate(all="ignore"):
        q = q / np.abs(q).max(-1, keepdims=True)  # so that no square overflows
        q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    w, x, y, z = np.moveaxis(q, -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def equirect_from_direction(directions: np.ndarray) -> np.ndarray:
    """(u, v) [..., 2] in [0, 1] of world directions [..., 3] of any length but zero."""
    d = np.asarray(directions, dtype=np.float64)
    u = 0.5 - np.arctan2(d[..., 1], d[..., 0]) / (2 * np.pi)
    # atan2 instead of acos: exact near the poles, and the length does not matter.
    v = np.arctan2(np.hypot(d[..., 0], d[..., 1]), d[..., 2]) / np.pi
    return np.stack([u, v], axis=-1)


def unit(vectors: np.ndarray, least: float = 0.0) -> np.ndarray:
    """Vectors [..., 3] as long as one; shorter where they were shorter than `least`."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), least)


def texel_directions(height: int, width: int) -> np.ndarray:
    """Unit world directions [H, W, 3] of an equirectangular map's texel centres."""
    row, column = np.mgrid[0:height, 0:width] + 0.5
    return direction_from_equirect(np.stack([column / width, row / height], axis=-1))


def direction_from_equirect(uv: np.ndarray) -> np.ndarray:
    """Unit world directions [..., 3] of (u, v) [..., 2]."""
    uv = np.asarray(uv, dtype=np.float64)
    azimuth, polar = (0.5 - uv[..., 0]) * 2 * np.pi, uv[..., 1] * np.pi
    around = np.sin(polar)
    return np.stack([around * np.cos(azimuth), around * np.sin(azimuth), np.cos(polar)], axis=-1)
