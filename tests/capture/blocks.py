"""BlocksExchange XML as tests write it, and Bentley's camera models, number by number.

After Bentley's specification and the exports of ContextCapture that are found in public repositories; an
export of ours would need a licence of the program.
"""

import math

import numpy as np

from tests.capture.programs import HEIGHT, WIDTH, names, poses, save_photos

BROWN = dict(K1=-0.08, K2=0.03, K3=0.01, P1=0.004, P2=-0.003)
POINT = (49.0, 29.75)
"""from the centre of the first pixel"""
FOCAL = "<FocalLengthPixels>80.0</FocalLengthPixels>"


def tags(values):
    return "".join(f"<{name}>{value!r}</{name}>" for name, value in values.items())


def matrix(turn):
    return "".join(
        f"<M_{row}{column}>{float(turn[row, column])!r}</M_{row}{column}>"
        for row in range(3)
        for column in range(3)
    )


def photo(number, pose=None, name=None, turn=None, inside=""):
    """`pose`: camera to world with OpenCV's axes; `turn`: what is written as its rotation."""
    name = f"{names(9)[number]}.png" if name is None else name
    text = ""
    if pose is not None:
        turn = matrix(pose[:3, :3].T) if turn is None else turn
        text = (
            f"<Pose><Rotation>{turn}<Accurate>true</Accurate></Rotation>"
            f"<Center>{tags(dict(zip('xyz', pose[:3, 3].tolist(), strict=True)))}<Accurate>true</Accurate>"
            "</Center><Metadata><SRSId>0</SRSId><Center><x>-83.0</x><y>39.9</y><z>157.9</z></Center>"
            "</Metadata></Pose>"
        )
    return f"<Photo><Id>{number}</Id><ImagePath>{name}</ImagePath>{inside}{text}<NearDepth>1.5</NearDepth></Photo>"


def group(photos, kind="Perspective", focal=FOCAL, axes="XRightYDown", point=POINT, lens=None, inside=""):
    lens = f"<Distortion>{tags(BROWN)}</Distortion>" if lens is None else lens
    place = point if isinstance(point, str) else tags(dict(zip("xy", point, strict=True)))
    return (
        f"<Photogroup><Name>Photogroup 1</Name><ImageDimensions><Width>{WIDTH}</Width><Height>{HEIGHT}"
        f"</Height></ImageDimensions><CameraModelType>{kind}</CameraModelType><CameraModelBand>Visible"
        f"</CameraModelBand>{focal}<CameraOrientation>{axes}</CameraOrientation><PrincipalPoint>{place}"
        f"</PrincipalPoint>{lens}{inside}{''.join(photos)}</Photogroup>"
    )


def document(groups, system=None, points="", base="", more=""):
    systems, identity = "", ""
    if system is not None:
        systems = (
            "<SpatialReferenceSystems><SRS><Id>0</Id><Name>WGS 84</Name><Definition>EPSG:4326</Definition>"
            f"</SRS><SRS><Id>2</Id><Name>{system[0]}</Name><Definition>{system[1]}</Definition></SRS>"
            "</SpatialReferenceSystems>"
        )
        identity = "<SRSId>2</SRSId>"
    return (
        f'<?xml version="1.0" encoding="utf-8"?>\n<BlocksExchange version="3.2">\n{systems}{base}\n'
        f"<Block><Name>Block_1 - AT</Name>{identity}\n<Photogroups>{''.join(groups)}</Photogroups>\n"
        f"<ControlPoints/><TiePoints>{points}</TiePoints></Block>{more}\n</BlocksExchange>\n"
    )


def simple(places=None, **parts):
    whole = {key: parts.pop(key) for key in ("system", "points", "base", "more") if key in parts}
    places = poses() if places is None else places
    return document([group([photo(i, pose) for i, pose in enumerate(places)], **parts)], **whole)


def write(folder, text, name="Block_1 - AT.xml"):
    save_photos(folder / "photos")
    (folder / name).write_text(text, encoding="utf-8")
    return folder


def reference(values, to_camera, point, f=80.0, aspect=1.0, skew=0.0, centre=POINT):
    """The guide's perspective camera model, number by number, from the corner of the first pixel."""
    X, Y, Z = (to_camera @ [*point, 1.0])[:3]
    x, y = X / Z, Y / Z
    r2 = x * x + y * y
    k1, k2, k3, p1, p2 = (values.get(name, 0.0) for name in BROWN)
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    a = x * radial + 2 * p2 * x * y + p1 * (r2 + 2 * x * x)
    b = y * radial + 2 * p1 * x * y + p2 * (r2 + 2 * y * y)
    return f * a + skew * b + centre[0] + 0.5, aspect * f * b + centre[1] + 0.5


def fisheye_reference(p, focal, to_camera, point):
    """The guide's fisheye camera model: a quarter turn from the axis is 1."""
    X, Y, Z = (to_camera @ [*point, 1.0])[:3]
    r = math.hypot(X, Y)
    angle = 2 / math.pi * math.atan2(r, Z)
    radius = sum(value * angle**power for power, value in enumerate(p))
    u, v = np.array(focal) @ (radius * X / r, radius * Y / r)
    return u + POINT[0] + 0.5, v + POINT[1] + 0.5
