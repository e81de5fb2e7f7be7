"""Where the add-on is and where it may write."""

from pathlib import Path

import bpy

# Root package: "bl_ext.<repository>.perfanim" in Blender; preferences are filed under this name.
ADDON = __package__.rpartition(".")[0]


def user_folder(*parts: str) -> Path:
    """Return a folder of the user's for the add-on's data, made if need be; never the add-on's own folder."""
    path = "/".join(parts)
    if ADDON.startswith("bl_ext."):
        return Path(bpy.utils.extension_path_user(ADDON, path=path, create=True))
    folder = Path(bpy.utils.user_resource("DATAFILES", path="perfanim", create=True)) / path
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def absolute(path: str) -> str:
    """Return a path as typed in Blender ("//" = beside the file) as an absolute one, "" for ""."""
    return bpy.path.abspath(path) if path else ""
