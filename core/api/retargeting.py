"""Retargeting motion to characters in a separate Blender process."""

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from ..body.motion import Motion
from ..formats.markers.marker_files import check_ending
from ..formats.motion.bvh import write_bvh
from ..retarget.displayed_joint_names import NAMINGS
from ..retarget.retargeter import RootMotion
from ..system.blender_process import check_blender, run_in_blender
from ..system.schema import About, check_ranges

EXPORTED = (".fbx", ".glb", ".bvh")


@dataclass(frozen=True)
class RetargetRequest:
    """Character, and how it receives the motion."""

    character: Annotated[
        str | None, About("file with a humanoid: .blend, .glb, .gltf, .vrm or .fbx (default: a new character)")
    ] = None
    bone_map: Annotated[str | None, About("bone map: name of a shipped one, or a file (default: detected)")] = None
    root_motion: Annotated[RootMotion, About("bone or object that receives the root motion")] = RootMotion.HIPS
    skeleton: Annotated[str | None, About("skeleton (.asf) of an .amc motion")] = None
    naming: Annotated[
        str | None,
        About("bone names in a file for other programs (default: the character's own)", choices=tuple(NAMINGS)),
    ] = None
    picture: Annotated[str | None, About("picture (.png) to render as well")] = None
    frame: Annotated[int | None, About("frame of the picture, from 1 (default: the middle one)")] = None
    blender: Annotated[str | None, About("Blender executable (default: the Python module bpy)")] = None

    def __post_init__(self) -> None:
        check_ranges(self)


def retarget(motion: Motion | Path | str, out: Path | str, request: RetargetRequest) -> dict[str, Any]:
    """Retarget a motion to a character and write the result; return a report with the bones that were found.

    Args:
        motion: Motion, or its file (`.bvh`, `.amc`).
        out: Scene to write (`.blend`), or the character for other programs (`.fbx`, `.glb`, `.bvh`).
        request: The character, and how it receives the motion.

    Raises:
        CharacterError: Blender was not found, or the file has no humanoid or one with too few bones.
        FormatError: A file cannot be read or written.
    """
    check_ending(out, (".blend", *EXPORTED))
    check_blender(request.blender)
    if isinstance(motion, Motion):
        with tempfile.TemporaryDirectory() as folder:
            written = Path(folder) / "motion.bvh"
            write_bvh(motion, written)
            return retarget(written, out, request)
    options = {
        "to": request.character,
        "skeleton": request.skeleton,
        "map": request.bone_map,
        "render": request.picture,
        "frame": request.frame,
        "naming": request.naming,
        "root-motion": request.root_motion.name.lower(),
    }
    given = [text for name, value in options.items() if value is not None for text in (f"--{name}", str(value))]
    return run_in_blender(
        "perfanim.perfanim_addon.export.retarget_file:main", [str(motion), str(out), *given], request.blender
    )
