"""Findings about photos: blur, exposure, duplicates, masks, size."""

import numpy as np

from ..capture.capture import Capture
from ..capture.errors import counted, listed
from ..fit.visual_hull import not_all_masked
from .findings import Finding, note, warning
from .looks import Look

BLUR = 1.8
"""how far below the capture's median `Look.sharpness` is blurred: 3.5 times less fine detail"""
STOPS = 0.7
CLIPPED, WHITE_BORDER = 0.1, 0.8
EXPOSE_LESS = "expose less, since clipped highlights say nothing about the light"
EMPTY, FULL, CUT = 0.001, 0.995, 0.02
INVERTED = 0.9
"""share of a photo's border from which on a mask shows what is around the object"""
SAME_MEAN, SAME_MOST = 1.5, 16
"""levels of 255 by which thumbnails of one picture differ, on average and at most"""
SAME_POSE_DEGREES = 3.0
NEAREST, SAME_WAY = 6, 40.0
"""photos that one is compared with, and degrees by which they may look another way: light has sides"""
FEWEST_ACROSS = 100
HALF_SHOWN = 0.6
"""share of what masks show, shown in part, from which on it is no soft edge"""
MANY = 5
"""photos with one problem, from which they are told together"""


def blur(looks: list[Look]) -> list[Finding]:
    """Photos much softer than the others are."""
    values = np.array([look.sharpness for look in looks])
    known = values[np.isfinite(values)]
    if len(known) < 3:
        return []
    middle = np.median(known)
    spread = 1.4826 * np.median(np.abs(known - middle))
    limit = middle - max(BLUR, 3.5 * spread)
    return [
        warning("the photo is blurred compared with the others; leave it out or retake it", look.name)
        for look in looks
        if look.sharpness < limit
    ]


def exposure(looks: list[Look], fixed: bool = True) -> list[Finding]:
    """Over-exposed photos, and those brighter or darker than others, where that is to be `fixed`."""
    found = []
    on_white = float(np.median([look.white_border for look in looks])) > WHITE_BORDER
    masked = all(look.coverage is not None for look in looks)
    usual = float(np.median([look.clipped for look in looks]))
    if masked or not on_white:
        # A white backdrop is clipped, and is meant to be.
        if usual > CLIPPED:
            what = f"{usual:.0%} of the object's pixels are over-exposed in most photos"
            found.append(warning(f"{what}; {EXPOSE_LESS}"))
    bright = [look for look in looks if look.clipped > max(usual, 0.02) + CLIPPED]
    if len(bright) > MANY:
        most = max(look.clipped for look in bright)
        found.append(
            warning(f"{len(bright)} photos are over-exposed, by up to {most:.0%} of their pixels "
                    f"({listed([look.name for look in bright])}); {EXPOSE_LESS}")
        )  # fmt: skip
    else:
        found += [
            warning(f"{look.clipped:.0%} of the pixels are over-exposed; leave the photo out, or "
                    "retake it with less exposure", look.name)
            for look in bright
        ]  # fmt: skip
    if not fixed:
        return found
    values = np.array([look.exposure for look in looks])
    stops = values - np.median(values)
    near = np.array([values[i] - np.median(values[_near(looks, i)]) for i in range(len(looks))])
    apart = np.flatnonzero((np.abs(stops) > STOPS) & (np.abs(near) > STOPS) & (stops * near > 0))
    remedy = "set Exposure to Even Out (fit.exposure=gain), and lock it next time"
    if len(apart) > MANY:
        names = listed([looks[index].name for index in apart])
        found.append(
            warning(f"{len(apart)} photos are brighter or darker than those nearby, by up to "
                    f"{np.abs(near[apart]).max():.1f} stops ({names}); {remedy}")
        )  # fmt: skip
    else:
        found += [
            warning(f"the object is {abs(near[index]):.1f} stops "
                    f"{'brighter' if stops[index] > 0 else 'darker'} than in the photos nearby; {remedy}",
                    looks[index].name)
            for index in apart
        ]  # fmt: skip
    return found


def duplicates(looks: list[Look]) -> list[Finding]:
    """Photos that show the same from the same place."""
    found = []
    thumbnails = np.stack([look.thumbnail for look in looks]).reshape(len(looks), -1)
    flat = thumbnails.std(axis=1) < 2.0
    for index, look in enumerate(looks):
        difference = np.abs(thumbnails[:index] - thumbnails[index])
        same = (difference.mean(axis=1) < SAME_MEAN) & (difference.max(axis=1, initial=0) < SAME_MOST)
        for other in np.flatnonzero(same & ~flat[:index])[:1]:
            degrees = _turn(looks[other], look)
            if degrees < SAME_POSE_DEGREES:
                text = f"it is nearly the same as {looks[other].name}; leave one of them out"
            else:
                text = (f"it looks the same as {looks[other].name}, but its camera is turned by "
                        f"{degrees:.0f}°, so one of the cameras is wrong; solve them again")  # fmt: skip
            found.append(warning(text, look.name))
    return found


def masks(looks: list[Look], stands: bool = False) -> list[Finding]:
    """Photos without masks, and masks that cannot be right.

    Args:
        stands: there is something on which the object may stand; then masks may be made of that.
    """
    without = [look.name for look in looks if look.coverage is None]
    if len(without) == len(looks):
        if stands:
            return [note("no photo has a mask or alpha: masks are made of what stands on the table or "
                         "floor; if that is more than the object, fit the region box to it")]  # fmt: skip
        return [note("no photo has a mask or alpha; the object is found without them, which is slower "
                     "and less sure, so add masks if the background is busy")]  # fmt: skip
    backdrop = looks[0].backdrop
    if backdrop is not None and not without:
        behind = {"plain": "a plain backdrop", "far": "scenery that is far away"}.get(
            backdrop, f"plain {backdrop}"
        )
        found = [note(f"behind the object is {behind}; what stands out from it is taken as the mask")]
    else:
        count = f"{len(looks) - len(without)} of {len(looks)}"
        found = [note(counted(f"{count} photos has|have a mask or alpha"))]
    if without:
        found.append(warning(not_all_masked(without, len(looks))))
    masked = [look for look in looks if look.coverage is not None]
    usual = float(np.median([look.coverage for look in masked]))
    empty = [look.name for look in masked if look.coverage < EMPTY]
    whole = [look.name for look in masked if look.coverage > FULL]
    found += _of_each(empty, "the mask is empty; replace it or leave the photo out", "are empty")
    if usual < 0.9:
        shows_all = "the mask shows the whole photo; replace it or leave the photo out"
        found += _of_each(whole, shows_all, "show the whole photo")
    if np.median([look.half_shown for look in looks]) > HALF_SHOWN:
        found.append(
            warning("most masks show most of the object only in part, as if it were transparent; the "
                    "object must be white in them, and all else black")
        )  # fmt: skip
    masked = [look for look in masked if look.coverage <= FULL]
    inverted = [look.name for look in masked if look.cut > INVERTED]
    cut = [look.name for look in masked if look.cut > CUT]
    if len(inverted) > 0.5 * len(masked):
        found.append(
            warning(f"masks seem to show all but the object ({listed(inverted)}); invert them, so that the "
                    "object is white, or move them away if they only hide something")
        )  # fmt: skip
    elif cut:
        found.append(
            warning(f"the frame cuts off the object in {len(cut)} of {len(looks)} photos ({listed(cut)}); "
                    "step back, so that all of it is seen")
        )  # fmt: skip
    return found


def _of_each(names: list[str], each: str, all_of_them: str) -> list[Finding]:
    """A warning of `each` mask by its photo's name, or one of many."""
    if len(names) <= MANY:
        return [warning(each, name) for name in names]
    return [warning(f"{len(names)} masks {all_of_them} ({listed(names)}); replace them")]


def size(looks: list[Look], capture: Capture, most_pixels: int) -> list[Finding]:
    """How large the object is in the photos as they are fitted.

    Args:
        most_pixels: to which larger photos are made smaller (see `PhotoSettings`).
    """
    scale = float(np.median([c.no_larger(most_pixels).width / c.width for c in capture.cameras]))
    across = scale * pixels_across(looks, capture)
    smaller = ""
    if scale < 1:
        smaller = f" once the preset has scaled photos down to {scale:.0%} of their size"
    if across < FEWEST_ACROSS:
        what = f"the object is only about {across:.0f} pixels across{smaller}; go closer"
        larger = "keep photos whole (--set photos.most_pixels=0)" if smaller else "use larger photos"
        return [warning(f"{what}, or {larger}")]
    return [note(f"the object is about {across:.0f} pixels across{smaller}")]


def pixels_across(looks: list[Look], capture: Capture) -> float:
    """Median size of the object in the photos, pixels; of the region, where there are no masks."""
    measured = [look.across for look in looks if look.across]
    if measured:
        return float(np.median(measured))
    centre, edge = capture.region.mean(0), float((capture.region[1] - capture.region[0]).max())
    distance = [max(float(np.linalg.norm(c.position - centre)), 1e-9) for c in capture.cameras]
    seen = [
        min(edge / d * c.fx, max(c.width, c.height)) for d, c in zip(distance, capture.cameras, strict=True)
    ]
    return float(np.median(seen))


def _near(looks: list[Look], index: int) -> list[int]:
    """The photos nearest to one, of those that look the same way; itself where there are none."""
    positions = np.stack([look.camera.position for look in looks])
    distance = np.linalg.norm(positions - positions[index], axis=1)
    nearest = np.argsort(distance, kind="stable")[: NEAREST + 1]
    return [i for i in nearest if i != index and _turn(looks[index], looks[i]) < SAME_WAY] or [index]


def _turn(a: Look, b: Look) -> float:
    """Degrees between the directions of two cameras' views."""
    cosine = float(a.camera.view_direction @ b.camera.view_direction)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
