"""The extension's package and folders."""

import os
from pathlib import Path

BASE_PACKAGE = __package__.rpartition(".")[0]
REPOSITORY = Path(__file__).resolve().parent.parent
EXTENSION_ID = "neural_microfacet_fields"
JOBS_OF_UNSAVED = "jobs"
"""`user_folder` of jobs that were begun before their .blend was saved"""


def user_folder(name: str, create: bool = True) -> Path:
    """A folder of ours that survives upgrades and goes with the extension."""
    import bpy

    if BASE_PACKAGE.startswith("bl_ext."):
        return Path(bpy.utils.extension_path_user(BASE_PACKAGE, path=name, create=create))
    folder = Path(bpy.utils.user_resource("DATAFILES", path=EXTENSION_ID, create=create)) / name
    if create:
        folder.mkdir(parents=True, exist_ok=True)
    return folder


def short_user_folder() -> Path | None:
    """Windows' folder for large things of a person's programs, a part of it for each version of Blender;
    it has a short path, but stays when the extension goes. None elsewhere."""
    import bpy

    local = os.environ.get("LOCALAPPDATA", "")
    return Path(local) / "nmf" / "{}.{}".format(*bpy.app.version) if local else None
