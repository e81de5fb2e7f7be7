"""Paths of the add-on and of the user's data."""

import os
from collections.abc import Sequence
from pathlib import Path

import bpy

from ...core.system.files import clean_folder

# Root package, in Blender "bl_ext.<repository>.perfanim": there it is also the key of the add-on's preferences.
ADDON = __package__.partition(".perfanim_addon")[0]

# Folders in the preferences: first part of `user_folder` -> name of the preference.
CHOSEN_FOLDERS = {"takes": "takes_folder", "databases": "databases_folder", "profiles": "profiles_folder"}
_PROFILES = ("subjects", "calibrations", "bone_maps")  # subfolders of the profiles' folder
_KINDS = ("takes", "databases", *_PROFILES, "props", "collections")


def user_folder(*parts: str) -> Path:
    """Return a folder for the user's data, created if needed; its first part names the kind of data.

    If the folder chosen in the preferences cannot be used, the add-on's own is returned; `folder_problem` says why.
    """
    base, rest = _chosen(parts)
    if base:
        folder = Path(absolute(base), *rest)
        if not _make(folder):
            return folder
    folder = _own_folder("/".join(parts))
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def clean_up() -> None:
    """Remove temporary files of killed processes from the user's folders."""
    for kind in _KINDS:
        clean_folder(_own_folder(kind))
        base, rest = _chosen((kind,))
        if base:
            clean_folder(Path(absolute(base), *rest))


def _own_folder(path: str) -> Path:
    """Return the add-on's own folder for some data; it may not exist."""
    if ADDON.startswith("bl_ext."):
        return Path(bpy.utils.extension_path_user(ADDON, path=path))
    return Path(bpy.utils.user_resource("DATAFILES", path="perfanim")) / path


def default_folder(kind: str) -> Path:
    """Return the add-on's own folder for a kind of data, or the one that holds those for all profiles."""
    return _own_folder(_PROFILES[0]).parent if kind == "profiles" else _own_folder(kind)


def folder_problem(kind: str) -> str:
    """Return the reason why a chosen folder cannot be used, or ""."""
    base, _ = _chosen((kind,))
    reason = _make(Path(absolute(base))) if base else ""
    return f"{base} cannot be used ({reason}); the add-on's own folder is used instead" if reason else ""


def _chosen(parts: Sequence[str]) -> tuple[str, Sequence[str]]:
    """Return the chosen folder for a kind of data, or "", and the remaining parts."""
    kind, rest = ("profiles", parts) if parts[0] in _PROFILES else (parts[0], parts[1:])
    addon = bpy.context.preferences.addons.get(ADDON)
    return (getattr(addon.preferences, CHOSEN_FOLDERS[kind]) if addon and kind in CHOSEN_FOLDERS else ""), rest


def _make(folder: Path) -> str:
    """Create a folder; return the reason why it cannot be used, or ""."""
    if not folder.is_absolute():
        return "it is not an absolute path"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        return str(error.strerror)
    return "" if os.access(folder, os.W_OK) else "it cannot be written to"


def absolute(path: str) -> str:
    """Return the absolute path for a Blender path, in which "//" is the file's folder; "" for ""."""
    return bpy.path.abspath(path) if path else ""
