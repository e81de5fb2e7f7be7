"""Operator that exports a take to a file for other programs."""

from pathlib import Path

import bpy
from bpy_extras.io_utils import ExportHelper

from ...core.body.moved_feet import floor_height_m
from ...core.body.standing_on_floor import on_floor
from ...core.errors import PerfanimError, TakeError
from ...core.formats.motion.write_motion import ANGLES, VRMA, write_motion
from ...core.formats.take_file.take_reader import read_take_file, summarise
from ...core.retarget.displayed_joint_names import OWN
from .. import take_library
from ..capture.performer_targets import add_character
from ..export.export_animation import ENDINGS, Form, export_poses
from ..panels.takes_panel import KEY as PANEL
from ..preferences.paths import absolute
from ..preferences.property_kinds import choice, draw_rate, number, property_column, switch, whole_number
from ..settings.batch_settings import NAMINGS
from .operator_bases import PanelOperator, last_folders, report_error
from .put_on_character import TakeOperator, recorded_poses, take_motion

_MOTIONS = {"VRMA": VRMA, "ANGLES": ANGLES}  # written without Blender and without a character
_ENDINGS = {**ENDINGS, **_MOTIONS}


class PERFANIM_OT_export_take(TakeOperator, PanelOperator, bpy.types.Operator, ExportHelper):
    """Export the take's motion on the chosen character to a file for other programs"""

    bl_label = "Export Take"
    filename_ext = ""
    check_extension = None
    kind: choice(
        "Format",
        "File format",
        (
            ("BVH", "BVH", "Bones and motion, Y up"),
            ("FBX", "FBX", "Character and motion"),
            ("GLTF", "glTF", "Character and motion in one file (.glb)"),
            ("VRMA", "VRM Animation", "Motion on the performer's own body, for any VRM avatar (.vrma)"),
            ("ANGLES", "Joint Angles", "The performer's joint angles as a table (.angles.csv)"),
        ),
        options={"SKIP_SAVE"},
    )
    naming: choice(
        "Naming",
        "Bone naming convention",
        (("OWN", "Unchanged", "The character's own bone names"), *NAMINGS),
    )
    rate: number("Rate (Hz)", "Frames per second of the file; 0 for the recorded rate", 0, 0, 1000)
    scale: number("Scale", "BVH units per scene unit: 100 for centimetres if the scene is in metres", 1, 0.001, 1000)
    meshes: switch("Meshes", "Include the meshes deformed by the armature", default=True)
    performer: whole_number(
        "Performer", "Which performer of the take to export, on their own character", 1, 1, options={"SKIP_SAVE"}
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        try:
            name = bpy.path.clean_name(summarise(self.path).notes.name) + _ENDINGS[self.kind]
        except PerfanimError as error:
            return report_error(self, PANEL, error)
        self.filepath = str(Path(last_folders.get(type(self).__name__, "")) / name)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def draw(self, context: bpy.types.Context) -> None:
        column = property_column(self.layout)
        column.prop(self, "kind")
        names = next((t.performers for t in take_library.listed() if str(t.path) == self.path), ())
        if len(names) > 1:
            column.prop(self, "performer")
            column.label(text=names[min(self.performer, len(names)) - 1], icon="USER")
        draw_rate(column, self, "rate")
        if self.kind != "VRMA":
            column.prop(self, "naming")
        if self.kind == "BVH":
            column.prop(self, "scale")
        if self.kind in ("FBX", "GLTF"):
            column.prop(self, "meshes")

    def check(self, context: bpy.types.Context) -> bool:
        wanted = self._with_ending()
        changed, self.filepath = wanted != self.filepath, wanted
        return changed

    def _with_ending(self) -> str:
        path = self.filepath
        known = next((ending for ending in _ENDINGS.values() if path.lower().endswith(ending)), "")
        return path[: len(path) - len(known)] + _ENDINGS[self.kind]

    def run(self, context: bpy.types.Context) -> str:
        target = Path(absolute(self._with_ending()))
        last_folders[type(self).__name__] = str(target.parent)
        take = read_take_file(self.path)
        motion = take_motion(context, take)
        poses, count, index = recorded_poses(take, motion), len(motion.performers), self.performer - 1
        if index >= count:
            what = f"has no performer {self.performer}, only {count}"
            raise TakeError(what, where=take.notes.name, advice=f"choose 1 to {count}")
        subject, armature = motion.performers[index].subject, motion.performers[index].armature
        title = f"{take.notes.name} ({subject.name})" if count > 1 else take.notes.name
        naming = "" if self.naming == "OWN" else self.naming
        from ...core.session.steady_motion import pose_clock, steady_motion

        performed = [pose.performers[index] for pose in poses]
        if self.kind in _MOTIONS:
            clock = pose_clock(performed, self.path).at(self.rate or None)
            shown = steady_motion(performed, subject, take.notes.name, clock)
            written = write_motion(shown, target, naming=naming or OWN)
            return f"{written.frames} frames of {title} in {target}"
        if not armature and index > 0:
            advice = "choose one under Additional Targets, or click Put on Character"
            raise TakeError("the performer has no character", where=subject.name, advice=advice)
        armature = armature or add_character(context, subject.skeleton)
        clock = pose_clock(performed, self.path, stated_fps=1.0)  # also for a single pose
        clock = clock.at(max(1.0, round(self.rate or clock.fps)))  # Blender's exporters need a whole rate
        shown = steady_motion(performed, subject, take.notes.name, clock)
        if context.scene.perfanim_result.on_floor:  # as on the character; the first performer's floor is everybody's
            first = [pose.performers[0] for pose in poses]
            floor = steady_motion(first, motion.performers[0].subject, take.notes.name, clock)
            shown = on_floor(shown, floor_height_m(floor))
        count = export_poses(context, armature, target, self.kind, shown, Form(self.meshes, naming, self.scale))
        return f"{count} frames of {title} on {armature} in {target}"
