"""BOP's `scene_camera.json`, as BlenderProc writes it, too: beside `rgb` or `gray`, a photo by its number.

`cam_K` is a lens's matrix, where whole numbers are pixels' centres as in BlenderProc's, `cam_R_w2c` and
`cam_t_w2c` lead from the world, in millimetres, to OpenCV's camera axes, in `scene_gt.json` `cam_R_m2c` and
`cam_t_m2c` from an object's own. Of one that is alone, as for onboarding, these are read where the others
are missing, and `mask_visib/000000_000000.png` is its mask. Names may end in a sensor's (`rgb_aria`).
https://github.com/thodan/bop_toolkit (docs/bop_datasets_format.md), https://github.com/DLR-RM/BlenderProc
(BopWriterUtility.py, CameraUtility.py)
"""

from pathlib import Path

import numpy as np

from ..camera_folder import photo_folder
from ..fields import Entry, pose_of_world
from ..files import json_holds
from ..intake import Capture, Found, PhotoFinder, assemble
from ..pinhole import lens_on, pinhole_of

NAME = "BOP scene_camera.json"
PATTERNS = ("scene_camera*.json",)


def recognises(file: Path) -> bool:
    return json_holds(file, "cam_K", count=1 << 16)


def read(path: Path, photos: PhotoFinder) -> Capture:
    cameras, sensor = Entry.of_file(path), path.stem.removeprefix("scene_camera")
    file = path.with_name(f"scene_gt{sensor}.json")
    objects = Entry.of_file(file) if file.is_file() else Entry(file, "", {})
    seen = {key: list(objects.objects(key)) for key in cameras}
    names = {str(item.get("obj_id")) for items in seen.values() for item in items}
    alone = len(names) == 1 and all(len(items) == 1 for items in seen.values())
    folder = photo_folder(path.parent, (f"rgb{sensor}", f"gray{sensor}"))
    found = []
    for key, items in seen.items():
        camera, name = cameras.inner(key), key.zfill(6)
        posed, to = (camera, "w2c") if "cam_R_w2c" in camera or not alone else (items[0], "m2c")
        where = posed.field(f"cam_R_{to}")
        if f"cam_R_{to}" not in posed:
            raise posed.error(f"cam_R_{to}", "there is no pose", "solve the cameras from the photos")
        rotation = posed.numbers(f"cam_R_{to}", 9).reshape(3, 3)
        from_world = np.column_stack([rotation, posed.numbers(f"cam_t_{to}", 3)])
        pose = pose_of_world(posed.path, where, from_world)
        k = camera.numbers("cam_K", 9).reshape(3, 3)
        fx, fy, cx, cy = pinhole_of(path, camera.field("cam_K"), k)
        photo = photos.find_in(folder, name)
        lens = lens_on(photo, fx, fy, cx + 0.5, cy + 0.5)
        masks = folder.with_name(f"mask_visib{sensor}")
        mask = photos.find_in(masks, f"{name}_000000") if alone else None
        found.append(Found(where, f"{folder.name}/{name}", photo, pose, lens, mask))
    return assemble(path, NAME, found, photos)
