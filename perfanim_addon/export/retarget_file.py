"""Retargeting a motion file without a window, for `perfanim retarget`.

    python -m perfanim.perfanim_addon.export.retarget_file MOTION OUT [--to CHARACTER] [--map NAME_OR_FILE] [...]

Run it in a separate process, because it opens another scene. The last line on stdout is a JSON object.
"""

import argparse
import json
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...core.body.motion import Motion
from ...core.errors import CharacterError, FormatError, PerfanimError
from ...core.formats.motion.read_motion import read_motion
from ...core.geometry.arrays import Array
from ...core.retarget.bone_map import BoneMap, MatchState, checked_map
from ...core.retarget.bone_map_files import load_bone_map
from ...core.retarget.retargeter import RetargetPlan, RootMotion
from ...core.system.file_content import check_kind
from ...core.system.files import atomic_path, is_file, read_bytes
from ..animation.actions import scene_frames, write_with_plan
from ..character.armature_reading import read_armature_rest
from ..character.create_character import create_character, find_armature
from ..character.rest_pose import release_pose
from ..character.retarget_plans import find_map, map_of, plan_for, plan_with_map
from .export_animation import ENDINGS, Form, write_played
from .stage import add_stage, floor_below, render, set_up_rendering, write_scene

_GLTF = (".glb", ".gltf", ".vrm")
_KINDS = dict.fromkeys(_GLTF, "glTF file") | {".blend": "Blender file", ".fbx": "FBX file"}


@dataclass(frozen=True)
class Picture:
    """Picture (.png) of one frame, counted from 1; None for the middle one."""

    path: Path | None
    frame: int | None = None


def retarget_file(
    motion: Motion,
    character: Path | None,
    target: Path,
    *,
    preset: str | None = None,
    root_motion: RootMotion = RootMotion.HIPS,
    picture: Picture | None = None,
    form: Form | None = None,
) -> dict[str, Any]:
    """Retarget a motion to a character, and save it; return a report.

    A .blend keeps its scene and rate; other and new characters get a scene with floor, light and camera at the motion's
    rate.

    Args:
        motion: Motion of the standard skeleton's joints.
        character: File (.blend, .glb, .gltf, .vrm, .fbx); None for a new character with the motion's proportions.
        target: File to write (.blend, .fbx, .glb, .bvh).
        preset: Name of a shipped bone map, or a file; None to find the map automatically.
        root_motion: Bone or object that receives the root motion.
        form: Options for files of other programs.

    Raises:
        CharacterError: The file contains no humanoid, or it cannot be driven.
        FormatError: A file cannot be read or written.
    """
    shown = _shown_frame(motion, picture)
    is_own_scene = character is not None and character.suffix.lower() == ".blend"
    open_file(character)
    scene = bpy.context.scene
    if not is_own_scene:
        scene.render.fps = max(1, round(motion.fps))
        scene.render.fps_base = scene.render.fps / motion.fps
    if character is None:
        set_up_rendering(scene)
        armature_object = find_armature(create_character(bpy.context, motion.skeleton))
        bone_map = map_of(armature_object)
    else:
        armature_object, bone_map = _humanoid(character, preset)
    plan, frames = _performed(armature_object, bone_map, motion, root_motion, is_new=character is None)
    floor = float(armature_object.matrix_world.translation.z) if character is not None else floor_below(motion)
    kind = next((kind for kind, ending in ENDINGS.items() if target.name.lower().endswith(ending)), None)
    if kind is not None:
        write_played(bpy.context, armature_object, target, kind, bone_map.bones, form or Form())
    with atomic_path(target) if kind is None else nullcontext() as temporary:
        if not is_own_scene:
            _add_stage(scene, armature_object, bone_map, floor)
        scene.frame_set(1)
        if temporary is not None:
            write_scene(temporary)
        if picture is not None and picture.path is not None:
            if is_own_scene and scene.camera is None:
                _add_stage(scene, armature_object, bone_map, floor)
            set_up_rendering(scene)
            scene.frame_set(int(frames[shown - 1]))
            render(scene, picture.path)
    return _map_facts(bone_map) | {
        "armature": armature_object.name,
        "root_motion": plan.root_motion.value,
        "scale": plan.alignment.units_per_metre,
        "frames": motion.frames,
        "out": str(target),
    }


def _shown_frame(motion: Motion, picture: Picture | None) -> int:
    """Return the frame to show in the picture, counted from 1."""
    if picture is None or picture.frame is None:
        return (motion.frames + 1) // 2
    if not 1 <= picture.frame <= motion.frames:
        raise CharacterError(
            f"has no frame {picture.frame}", where=motion.name, advice=f"choose a frame from 1 to {motion.frames}"
        )
    return picture.frame


def _performed(
    armature_object: bpy.types.Object, bone_map: BoneMap, motion: Motion, root_motion: RootMotion, *, is_new: bool
) -> tuple[RetargetPlan, Array]:
    """Write a motion to a character; return the plan and the scene frames (F,)."""
    scene = bpy.context.scene
    release_pose(armature_object)
    bpy.context.view_layer.update()  # updates world matrices of imported children
    if is_new and root_motion is RootMotion.HIPS:
        plan = plan_for(armature_object, motion.skeleton)  # joint by joint: it has the performer's proportions
    else:
        plan = plan_with_map(armature_object, motion.skeleton, bone_map, root_motion)
    frames = scene_frames(np.arange(motion.frames) / motion.fps, scene)
    write_with_plan(armature_object, frames, motion.rotations, motion.root_positions_m, plan, name=motion.name)
    scene.frame_start, scene.frame_end = 1, int(np.ceil(frames[-1]))
    return plan, frames


def _map_facts(bone_map: BoneMap) -> dict[str, Any]:
    unmapped, doubtful = (
        {joint: bone_map.matches[joint].reason for joint in bone_map.of_state(state)}
        for state in (MatchState.MISSING, MatchState.SUSPECT)
    )
    return {
        "mapped": bone_map.bones,
        "unmapped": unmapped,
        "doubtful": doubtful,
        "complete": bone_map.complete,
        "found_by": bone_map.origin,
    }


def open_file(character: Path | None) -> None:
    """Open a .blend, or import a character, without running scripts."""
    if character is None:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        return
    if not is_file(character):
        raise FormatError("cannot be read (no such file)", where=str(character), advice="check the path")
    kind = character.suffix.lower()
    if kind == ".blend":
        _run(character, lambda: bpy.ops.wm.open_mainfile(filepath=str(character), load_ui=False, use_scripts=False))
        return
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if kind in _GLTF:
        with tempfile.TemporaryDirectory() as folder:
            copy = character
            if kind == ".vrm":  # it is a binary glTF, but the importer goes by the extension
                copy = Path(folder) / f"{character.stem}.glb"
                shutil.copyfile(character, copy)
            _run(character, lambda: bpy.ops.import_scene.gltf(filepath=str(copy), disable_bone_shape=True))
    elif kind == ".fbx":
        _run(character, lambda: bpy.ops.import_scene.fbx(filepath=str(character), use_anim=False))
    else:
        raise FormatError(
            "is not a character file", where=str(character), advice="give a .blend, .glb, .gltf, .vrm or .fbx file"
        )


def _run(character: Path, read: Callable[[], object]) -> None:
    try:
        read()
    except Exception as error:  # importers may raise any exception for damaged files
        check_kind(read_bytes(character), str(character), _KINDS[character.suffix.lower()])
        line = (str(error).strip().splitlines() or ["unknown error"])[-1]
        raise FormatError(f"cannot be read ({line})", where=str(character), advice="export it again") from error


def _humanoid(character: Path, preset: str | None) -> tuple[bpy.types.Object, BoneMap]:
    """Return the humanoid armature with the most meshes, and its bone map."""
    armatures = [obj for obj in bpy.context.scene.objects if obj.type == "ARMATURE"]
    if not armatures:
        raise CharacterError("contains no armature", where=str(character), advice="give a rigged character")

    def weight(armature_object: bpy.types.Object) -> tuple[int, int]:
        moved = [obj for obj in bpy.context.scene.objects if obj.find_armature() == armature_object]
        return len(moved), len(armature_object.data.bones)

    first: PerfanimError | None = None
    for armature_object in sorted(armatures, key=weight, reverse=True):
        try:
            if preset is None:
                return armature_object, find_map(armature_object)
            rest = read_armature_rest(armature_object)
            return armature_object, checked_map(rest, load_bone_map(preset), Path(preset).stem)
        except CharacterError as error:
            first = first or CharacterError(error.what, where=str(character), advice=error.advice)
    assert first is not None  # noqa: S101 - there is an armature, and it was rejected
    raise first


def _add_stage(scene: bpy.types.Scene, armature_object: bpy.types.Object, bone_map: BoneMap, floor: float) -> None:
    """Add floor, light and a camera that shows 24 samples of the performance."""
    points = []
    for at in np.unique(np.linspace(scene.frame_start, scene.frame_end, 24).astype(int)):
        scene.frame_set(int(at))
        posed = armature_object.pose.bones
        points += [armature_object.matrix_world @ posed[name].head for name in bone_map.bones.values()]
    add_stage(scene, np.array(points, dtype=np.float64), floor)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return 0, or 1 with one line on stderr if the input was bad."""
    parser = argparse.ArgumentParser(prog="retarget_file", description="Put a motion on a character.")
    parser.add_argument("motion", type=Path, help="motion file (.bvh, .amc)")
    parser.add_argument("out", type=Path, help="file to write (.blend, .fbx, .glb, .bvh)")
    parser.add_argument("--to", type=Path, help="character (.blend, .glb, .gltf, .vrm, .fbx; default: a new one)")
    parser.add_argument("--skeleton", type=Path, help="skeleton (.asf) of an .amc motion")
    parser.add_argument("--map", help="bone map: name of a shipped one, or a file (default: found automatically)")
    parser.add_argument("--root-motion", choices=[kind.name.lower() for kind in RootMotion], default="hips")
    parser.add_argument("--render", type=Path, metavar="OUT.png", help="also render one frame to this picture")
    parser.add_argument("--frame", type=int, help="frame of the picture, counted from 1 (default: the middle one)")
    parser.add_argument("--naming", default="", help="naming of the bones in a file for other programs")
    given = parser.parse_args(arguments)
    try:
        motion = read_motion(given.motion, given.skeleton)
        done = retarget_file(
            motion,
            given.to,
            given.out,
            preset=given.map,
            root_motion=RootMotion[given.root_motion.upper()],
            picture=Picture(given.render, given.frame),
            form=Form(naming=given.naming),
        )
    except PerfanimError as error:
        sys.stderr.write(f"retarget_file: {' '.join(str(error).split())}\n")
        return 1
    done |= {"warnings": list(motion.notes)} if motion.notes else {}
    sys.stdout.write("\n" + json.dumps(done) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
