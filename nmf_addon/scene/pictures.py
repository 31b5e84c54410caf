"""Pictures of a result under file names that are theirs alone.

In every result the albedo is called albedo.png. Blender copies pictures by their names into one folder when
it unpacks them or exports USD, OBJ or FBX, and of two objects both would show one's.
"""

import hashlib
import os
import shutil
from itertools import count
from pathlib import Path

import bpy

from ...solver.job.folder import JobFolder
from ...solver.replacing import read_json, write_json_atomic
from .cameras import photo_path
from .edited import is_painted
from .images import load_picture
from .result import textures_of


def named_pictures(job: JobFolder, manifest: dict, kept: set[str]) -> dict[str, Path]:
    """The textures' and the environment's files by what they are, in JOB/textures under names of their own.

    They are copies, so that who paints on them and saves does not change the result; the result's own
    files where nothing can be written. Copies that are `kept`, by their names, stay as they are.

    Raises:
        RuntimeError: Blender cannot read one that is to take a copy's place; all stay.
    """
    entries = {key: manifest["textures"][key] for key in textures_of(manifest)}
    entries["environment"] = manifest["environment"]
    files = {key: job.result_dir / entry["file"] for key, entry in entries.items()}
    folder, record = job.root / "textures", job.root / "textures.json"
    try:
        made, now = read_json(record), {file.name: _digest(file) for file in files.values()}
        made = {name: digest for name, digest in made.items() if name not in kept}
        stem = _free_stem(job.root.name, now, folder, made)
        folder.mkdir(exist_ok=True)
        named = {key: folder / f"{stem}_{file.name}" for key, file in files.items()}
        for key, file in files.items():
            if named[key].exists():  # one that is damaged takes no other's place
                bpy.data.images.remove(load_picture(file))
        for key, file in files.items():
            # It was a link to the result's once, which is not to be written to.
            named[key].unlink(missing_ok=True)
            shutil.copyfile(file, named[key])
            made[named[key].name] = now[file.name]
        write_json_atomic(record, made)
        return named
    except OSError:
        return files


def _digest(file: Path) -> str:
    return hashlib.sha1(file.read_bytes()).hexdigest()


def _free_stem(name: str, now: dict[str, str], folder: Path, made: dict[str, str]) -> str:
    """A job's name, with a number where the open file has another job's pictures of it, or a person has
    painted on its own anywhere: these are not as `made`, nor as the result is `now`."""
    taken = {
        copy.name
        for file, digest in now.items()
        for copy in folder.glob(f"*_{file}")
        if _digest(copy) not in (made.get(copy.name), digest)
    }
    for image in bpy.data.images:
        path = photo_path(image)
        if os.path.realpath(path.parent) != os.path.realpath(folder) or is_painted(image):
            taken.add(path.name)
    stems = (name if number == 1 else f"{name}_{number}" for number in count(1))
    return next(stem for stem in stems if taken.isdisjoint(f"{stem}_{file}" for file in now))
