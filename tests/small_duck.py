"""The sample as small as tests of whole jobs need it."""

import json
import shutil

import numpy as np
import OpenEXR
from PIL import Image

from tests.cli.command import DUCK

EVERY = 4


def write_small_duck(folder):
    """The duck in photos and truths of 50 × 50 pixels, every fourth of the sample's: a third of its photos,
    all of its held-out views; its lights as they are."""
    for path in sorted(DUCK.rglob("*"), key=lambda path: path.suffix == ".json"):
        if path.parent.name == "train" and int(path.stem.partition("_")[2]) % 3:
            continue
        target = folder / path.relative_to(DUCK)
        target.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".png":
            pixels = np.asarray(Image.open(path))
            Image.fromarray(np.ascontiguousarray(_thinned(pixels))).save(target)
        elif path.suffix == ".exr" and path.parent != DUCK:
            _write_thinned_exr(path, target)
        elif path.suffix == ".json":
            content = json.loads(path.read_text())
            content.update(w=content["w"] // EVERY, h=content["h"] // EVERY)
            content["frames"] = [
                frame for frame in content["frames"] if (folder / f"{frame['file_path']}.png").exists()
            ]
            target.write_text(json.dumps(content))
        elif path.is_file():
            shutil.copy(path, target)
    return folder


def _thinned(pixels):
    return pixels[EVERY // 2 :: EVERY, EVERY // 2 :: EVERY]


def _write_thinned_exr(path, target):
    with OpenEXR.File(str(path)) as file:
        channels = {
            name: np.ascontiguousarray(_thinned(channel.pixels))
            for name, channel in file.channels().items()
        }
        header = {name: file.header()[name] for name in ("compression", "type")}
    OpenEXR.File(header, channels).write(str(target))
