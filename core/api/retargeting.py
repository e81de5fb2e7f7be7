"""Motion onto characters, by Blender in a process of its own."""

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..body.motion import Motion
from ..formats.markers.marker_files import check_ending
from ..formats.motion.bvh import write_bvh
from ..retarget.retargeter import RootMotion
from ..system.blender_process import check_blender, run_in_blender

EXPORTED = (".fbx", ".glb", ".bvh")


@dataclass(frozen=True)
class RetargetRequest:
    """Character, and how it receives a motion.

    Args:
        character: File with a humanoid: `.blend`, `.glb`, `.gltf`, `.vrm` or `.fbx`; None for a new character.
        bone_map: Name of a shipped bone map, or its file; None to detect the bones.
        root_motion: Bone or object that receives the root motion.
        skeleton: ASF file of an AMC motion.
        naming: Names of the bones in files for other programs, one of `NAMINGS`; None for the character's own.
        picture: PNG file of a picture to render; None for no picture.
        frame: Frame of the picture, from 1; None for the middle one.
        blender: Blender's program; None for Blender's Python module (bpy).
    """

    character: Path | str | None = None
    bone_map: Path | str | None = None
    root_motion: RootMotion = RootMotion.HIPS
    skeleton: Path | str | None = None
    naming: str | None = None
    picture: Path | str | None = None
    frame: int | None = None
    blender: str | None = None


def retarget(motion: Motion | Path | str, out: Path | str, request: RetargetRequest) -> dict[str, Any]:
    """Put a motion onto a character and write it; return the report, with the bones that were found.

    Args:
        motion: Motion, or its file (`.bvh`, `.amc`).
        out: Scene to write (`.blend`), or the character for other programs (`.fbx`, `.glb`, `.bvh`).
        request: The character, and how it receives the motion.

    Raises:
        CharacterError: There is no Blender, no humanoid in the file, or it has too few of the bones.
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
