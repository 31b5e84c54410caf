"""Why photos could not be placed, in words a photographer can act on."""

from dataclasses import dataclass, field

import numpy as np

from ..capture.errors import listed

FEW_FEATURES, SHARE_OF_MEDIAN = 100, 0.1
FEW_MATCHES = 30
"""matches that agree with one another; COLMAP places a photo from about as many"""


@dataclass(frozen=True)
class Evidence:
    """What the database knows of a photo.

    Attributes:
        features: how many were found in it.
        matches: verified matches with each photo it shares something with.
    """

    name: str
    features: int
    matches: tuple[int, ...] = field(default=())


def unplaced(evidence: list[Evidence], placed: set[str]) -> tuple[str, str]:
    """What is wrong with the photos that were not placed, and what to do: two parts of a sentence.

    Both are empty if all were placed.
    """
    missing = [item for item in evidence if item.name not in placed]
    if not missing:
        return "", ""
    usual = float(np.median([item.features for item in evidence]))
    plain, alone, weak, apart = [], [], [], []
    for item in missing:
        if item.features < max(FEW_FEATURES, SHARE_OF_MEDIAN * usual):
            plain.append(item.name)
        elif not item.matches:
            alone.append(item.name)
        elif max(item.matches) < FEW_MATCHES:
            weak.append(item.name)
        else:
            apart.append(item.name)
    kinds = [
        (plain, "too few features (blurred, or nothing with texture in view)",
         "retake them sharp, with a patterned floor or background in view"),
        (alone, "no overlap with any other photo", "take photos in between"),
        (weak, "too few matches with other photos", "take smaller steps from photo to photo"),
        (apart, "matches, but not enough with the photos that were placed",
         "take photos that link them to the others"),
    ]  # fmt: skip
    kinds = [kind for kind in kinds if kind[0]]
    problem = f"{len(missing)} of {len(evidence)} photos could not be placed: "
    problem += "; ".join(f"{listed(names)} – {why}" for names, why, _ in kinds)
    return problem, ", and ".join(remedy for _, _, remedy in kinds)
