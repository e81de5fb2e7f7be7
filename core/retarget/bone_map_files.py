"""Bone maps as TOML files that can be shared: a name, and a bone for each joint.

    name = "My rig"

    [joints]
    root = "Hips"
    lfemur = "Thigh_L"

Shipped presets exist only for rigs with misleading names; for all others, `bone_map.find_bone_map` finds the map.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from ..body.standard_skeleton import JOINT_NAMES
from ..errors import CharacterError, FormatError
from ..system.assets import ASSETS
from ..system.files import is_file, read_toml, write_toml
from ..system.schema import About, Schema

BONE_MAPS = ASSETS / "bone_maps"
_ENDING = ".toml"


@dataclass(frozen=True)
class _BoneMap:
    """Bone map in a file."""

    joints: Annotated[Mapping[str, str], About("bone of each joint", least=1)]
    name: Annotated[str, About("name shown to people")] = ""


BONE_MAP = Schema(
    _BoneMap,
    "Bone map",
    "Which bone of a character moves with which joint. Joints: " + ", ".join(f"`{name}`" for name in JOINT_NAMES) + ".",
    FormatError,
    'use a file with a table [joints], with lines such as root = "Hips"',
)


def read_bone_map(path: Path | str) -> dict[str, str]:
    """Return joint -> bone from a file; FormatError if it cannot be read or is not a bone map."""
    joints = BONE_MAP.read(read_toml(path), str(path)).joints
    unknown = [joint for joint in joints if joint not in JOINT_NAMES]
    if unknown:
        raise FormatError(
            "has unknown joints: " + ", ".join(unknown[:6]),
            where=str(path),
            advice="use the names " + ", ".join(JOINT_NAMES),
        )
    return {joint: joints[joint] for joint in JOINT_NAMES if joint in joints}


def write_bone_map(path: Path | str, name: str, bones: dict[str, str]) -> None:
    """Write joint -> bone to a file that `read_bone_map` reads."""
    joints = {joint: bones[joint] for joint in JOINT_NAMES if joint in bones}
    write_toml(path, BONE_MAP.table(_BoneMap(joints, name)))


def preset_paths(user_folder: Path | None = None) -> dict[str, Path]:
    """Return name -> file of the user's and the shipped presets."""
    folders = [folder for folder in (user_folder, BONE_MAPS) if folder is not None and folder.is_dir()]
    found: dict[str, Path] = {}
    for folder in folders:
        for path in sorted(folder.glob("*" + _ENDING)):
            found.setdefault(path.stem, path)
    return found


def read_presets(user_folder: Path | None = None) -> dict[str, dict[str, str]]:
    """Return name -> joint -> bone for all readable presets."""
    found = {}
    for name, path in preset_paths(user_folder).items():
        try:
            found[name] = read_bone_map(path)
        except FormatError:
            continue
    return found


def load_bone_map(name_or_file: str) -> dict[str, str]:
    """Return joint -> bone from a shipped preset or a file; CharacterError if there is neither."""
    paths = preset_paths()
    if name_or_file in paths:
        return read_bone_map(paths[name_or_file])
    if not is_file(name_or_file):
        raise CharacterError(
            f"there is no bone map {name_or_file!r}",
            advice=f"give a file, or one of {', '.join(sorted(paths))}; without one, the map is found automatically",
        )
    return read_bone_map(name_or_file)
