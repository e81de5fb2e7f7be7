"""The extension in a user folder of its own, as Blender finds it there."""

import os
from pathlib import Path

import addon_utils
import bpy

ROOT = Path(__file__).resolve().parents[2]
MODULE = "bl_ext.user_default.perfanim"


def use_user_folder(user: Path) -> str:
    """Let this Blender find the extension in the folder, switched off; return its name."""
    folder = user / "extensions" / "user_default"
    folder.mkdir(parents=True)
    (folder / "perfanim").symlink_to(ROOT, target_is_directory=True)
    for variable in ("BLENDER_USER_RESOURCES", "BLENDER_USER_EXTENSIONS"):
        os.environ[variable] = str(user if variable.endswith("RESOURCES") else user / "extensions")
    return find_extension(folder)


def find_extension(folder: Path) -> str:
    """Let this Blender look for the extension in a folder; return its name."""
    repos = bpy.context.preferences.extensions.repos
    for repo in list(repos):
        repos.remove(repo)
    repos.new(name="User Default", module="user_default", custom_directory=str(folder))
    addon_utils.extensions_refresh(ensure_wheels=False)
    return MODULE
