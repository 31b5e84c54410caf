"""The extension's package and folders."""

from __future__ import annotations

from pathlib import Path

BASE_PACKAGE = __package__.rpartition(".")[0]
REPOSITORY = Path(__file__).resolve().parent.parent
EXTENSION_ID = "neural_microfacet_fields"


def user_folder(name: str) -> Path:
    """A folder of ours that survives upgrades and goes with the extension."""
    import bpy

    if BASE_PACKAGE.startswith("bl_ext."):
        return Path(bpy.utils.extension_path_user(BASE_PACKAGE, path=name, create=True))
    folder = Path(bpy.utils.user_resource("DATAFILES", path=EXTENSION_ID, create=True)) / name
    folder.mkdir(parents=True, exist_ok=True)
    return folder
