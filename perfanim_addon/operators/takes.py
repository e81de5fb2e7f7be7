"""Recorded takes: recover, play, solve again, import, export."""

from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy_extras.io_utils import ExportHelper, ImportHelper

from ...core.body.scene_pose import ScenePose
from ...core.errors import PerfanimError, SettingsError, TakeError
from ...core.formats.markers.marker_files import READABLE
from ...core.formats.motion.write_motion import ANGLES, VRMA, write_motion
from ...core.formats.take_file.reading import TakeFile, read_take_file, summarise, take_name, unused_path
from ...core.labelling.take_import import UPS
from ...core.markers.frame_rate import frame_rate
from ...core.retarget.joint_naming import OWN
from ...core.session.pose_filters import FilterSettings
from ...core.solver.settings import METHODS
from .. import take_library
from ..capture import request as capture_setup
from ..capture.performer_driver import roles_of
from ..capture.write_take import (
    RecordedPart,
    TakeMotion,
    add_character,
    filter_take,
    increasing,
    pose_arrays,
    write_take,
)
from ..export.export_animation import ENDINGS, Form, export_poses
from ..jobs import activity
from ..jobs.job import Job, command
from ..panels import takes
from ..preferences.paths import absolute
from ..settings import readiness
from ..settings.capture_settings import settings
from ..settings.result_settings import start_frame
from . import common
from .database import starter_arguments
from .jobs import JobOperator

PANEL = takes.KEY
_MOTIONS = {"VRMA": VRMA, "ANGLES": ANGLES}  # written without Blender, and without a character
_ENDINGS = {**ENDINGS, **_MOTIONS}

_METHODS = [(name, name, f"The method {name!r}") for name in METHODS]
_UP_TEXTS = {
    "auto": ("From the Performer", "The axis of the file that the performer stands along"),
    "feet": (
        "Floor from the Feet",
        "The floor on which the feet stand becomes the scene's; for cameras that were tilted",
    ),
    "y": ("Y", "The file's Y axis"),
    "z": ("Z", "The file's Z axis"),
}


class _OfTake:
    """What operators on one take share."""

    bl_options = {"REGISTER", "UNDO"}
    path: bpy.props.StringProperty(name="Take", description="File of the take", options={"HIDDEN", "SKIP_SAVE"})


class _TakeJob(JobOperator):
    """What takes are made by: work in the worker, after the starter database where that is needed and missing."""

    panel = PANEL

    def begin(self, context: bpy.types.Context, python: str | None) -> Job:
        """Start the work."""
        chosen, first = settings(context), None
        request = self.request(context)
        if not chosen.database and not readiness.starter_database_path().exists():
            first = Job("Making the starter database", PANEL, command(starter_arguments()), python)
        return Job(self.title, PANEL, request, python, first=first)


def _motion(context: bpy.types.Context, take: TakeFile) -> TakeMotion:
    """Return the filtered motion of a take, and the characters that follow its performers."""
    chosen = FilterSettings.of_table(capture_setup.shape(settings(context)))
    poses = filter_take(take, chosen, use_stored=context.scene.perfanim_result.filters == "RECORDED")
    first, *further = take.setup.subjects()
    return TakeMotion(first.skeleton, take.setup.carried_props(), roles_of(context, further), poses)


def _recorded(take: TakeFile, motion: TakeMotion) -> list[ScenePose]:
    """Return the poses of the recorded part of a take; TakeError when there are none."""
    poses = [pose for pose in motion.poses if take.is_recorded(pose.number)]
    if not poses:
        raise TakeError("has no pose that was solved live", where=take.notes.name, advice="solve it again")
    return poses


def _chosen(context: bpy.types.Context) -> str:
    """Return the name of the chosen armature, "" where there is none."""
    armature = settings(context).armature
    return armature.name if armature else ""


def _play(context: bpy.types.Context, path: Path) -> str:
    """Put a take as it was solved onto the chosen armature, or a new character; return the line that says so.

    Props and further performers go onto their targets' objects and characters, or new ones.
    """
    take = read_take_file(path)
    motion = _motion(context, take)
    poses = _recorded(take, motion)
    part = RecordedPart(poses, start_frame(context))
    name, actions = write_take(context, motion, [part], take.notes.name, _chosen(context))
    take_library.mark_played(path, name)
    text, unsolved = f"{len(poses)} frames in {', '.join(actions)} on {name}", take.frame_count - len(take.poses)
    return f"{text}; {unsolved} more were not solved live: solve it again for them" if unsolved > 0 else text


class PERFANIM_OT_recover_take(_OfTake, JobOperator, bpy.types.Operator):
    """Write all that is intact of a take that was cut off as a whole take, and put its motion onto the character"""

    bl_idname = "perfanim.recover_take"
    bl_label = "Recover Take"
    title = "Recovering the take"
    panel = PANEL

    def arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the command."""
        path = Path(self.path)
        self._target = unused_path(path.parent, f"{take_name(path)} recovered")
        return ["take", "recover", str(path), "--out", str(self._target)]

    def done(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """Set the cut file aside and play what was recovered."""
        path = Path(self.path)
        path.rename(path.with_name(path.name + take_library.SET_ASIDE))
        take_library.forget()
        text = f"{summary['frames']} frames recovered, {summary['duration_s']:.1f} s"
        return f"{text}; {_play(context, self._target)}" if summary["poses"] else f"{text}: solve them again"


class PERFANIM_OT_play_take(_OfTake, bpy.types.Operator):
    """Put a take onto the character as it was solved, as Action, strip or layer"""

    bl_idname = "perfanim.play_take"
    bl_label = "Put on Character"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only while nothing runs."""
        return common.in_scene(cls, context) and common.idle(cls)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Write the keyframes."""
        try:
            text = _play(context, Path(self.path))
        except PerfanimError as error:
            return common.failed(self, PANEL, error)
        activity.set_message(PANEL, text)
        self.report({"INFO"}, text)
        return {"FINISHED"}


def _recorded_or_chosen(name: str, what: str, panel: str, default: str) -> Any:
    items = (
        ("RECORDED", "As Recorded", f"The {what} that the take was recorded with"),
        ("CHOSEN", "As Chosen", f"The {what} that is chosen under {panel}"),
    )
    return bpy.props.EnumProperty(name=name, description=f"Which {what} is used", items=items, default=default)


class PERFANIM_OT_solve_take(_OfTake, _TakeJob, bpy.types.Operator):
    """Solve a take again from what was recorded, with other settings; the result is a take of its own beside it"""

    bl_idname = "perfanim.solve_take"
    bl_label = "Solve Again"
    title = "Solving the take"
    method: bpy.props.EnumProperty(name="Method", description="How poses are found", items=_METHODS, default="best")
    database: _recorded_or_chosen("Database", "motion database", "Motion Database", "CHOSEN")
    performer: _recorded_or_chosen("Performer", "performer", "Subject", "RECORDED")
    cameras: _recorded_or_chosen("Cameras", "calibration of the cameras", "Cameras", "RECORDED")
    put_on: bpy.props.BoolProperty(
        name="Put on Character", description="Put the result onto the character at once", default=True
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the settings."""
        return context.window_manager.invoke_props_dialog(self)

    def arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the command."""
        chosen, given = settings(context), ["--method", self.method]
        if self.database == "CHOSEN":
            given += ["--database", str(readiness.database_path(chosen))]
        for source, name, option, panel in (
            (self.performer, "subject", "--subject", "Subject"),
            (self.cameras, "calibration", "--cameras", "Cameras"),
        ):
            if source == "CHOSEN":
                path = absolute(getattr(chosen, name))
                if not path:
                    raise SettingsError(
                        f"no {name} is chosen", advice=f"choose one under {panel}, or take the recorded"
                    )
                given += [option, path]
        name = summarise(self.path).notes.name
        self._target = unused_path(take_library.folder(), f"{name} ({self.method})")
        return ["solve", self.path, *given, "--out", str(self._target)]

    def done(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """List the new take and put it onto the character."""
        takes.choose(self._target)
        name = summarise(self._target).notes.name
        text = _play(context, self._target) if self.put_on else f"{summary['frames']} frames solved as {name}"
        return "; ".join((text, *summary["warnings"]))


class PERFANIM_OT_import_takes(_TakeJob, bpy.types.Operator, ImportHelper):
    """Solve marker takes of other systems, by the chosen performer, markers and motion database, and list them"""

    bl_idname = "perfanim.import_takes"
    bl_label = "Import Marker Takes"
    title = "Importing takes"
    filename_ext = ""
    filter_glob: bpy.props.StringProperty(
        default=";".join(f"*{ending}".replace(".take.npz", ".npz") for ending in READABLE), options={"HIDDEN"}
    )
    files: bpy.props.CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    up: bpy.props.EnumProperty(
        name="Up",
        description="Which way is up in the files",
        items=[(up, *_UP_TEXTS[up]) for up in UPS],
        default="auto",
    )
    method: bpy.props.EnumProperty(name="Method", description="How poses are found", items=_METHODS, default="best")

    def draw(self, context: bpy.types.Context) -> None:
        """Draw what can be chosen, and by whom and which markers the takes will be solved."""
        layout, chosen = self.layout, settings(context)
        layout.use_property_split = True
        layout.prop(self, "up")
        layout.prop(self, "method")
        who = readiness.performer_text(absolute(chosen.subject)) if chosen.subject else "average body"
        height = "" if chosen.subject else f", {chosen.subject_height:.2f} m"
        layout.label(text=f"Performer: {who}{height}", icon="USER")
        layout.label(text=f"Markers: {Path(readiness.marker_set_source(chosen)).stem}", icon="DOT")

    def arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the command."""
        chosen = settings(context)
        files = [str(Path(self.directory) / item.name) for item in self.files if item.name] or [self.filepath]
        for file in files:
            if not Path(file).is_file():
                raise TakeError("not found", where=file or "import", advice="choose marker takes")
        performer = (
            ["--subject", absolute(chosen.subject)] if chosen.subject else ["--height", str(chosen.subject_height)]
        )
        markers = ["--marker-set", readiness.marker_set_source(chosen)]
        solver = ["--database", str(readiness.database_path(chosen)), "--method", self.method]
        return [
            "take",
            "import",
            *files,
            *performer,
            *markers,
            *solver,
            "--up",
            self.up,
            "--out",
            str(take_library.folder()),
        ]

    def done(self, context: bpy.types.Context, summary: dict[str, Any]) -> str:
        """List them."""
        kept, failed = summary["takes"], summary["failed"]
        takes.choose(Path(kept[0]["out"]))
        count = (
            f"{len(kept)} of {len(kept) + len(failed)} takes" if failed else f"{len(kept)} take" + "s" * (len(kept) > 1)
        )
        return "; ".join((f"{count} imported", *failed, *(warning for take in kept for warning in take["warnings"])))


class PERFANIM_OT_export_take(_OfTake, bpy.types.Operator, ExportHelper):
    """Write a take, as it was solved, on the chosen character to a file for other programs"""

    bl_idname = "perfanim.export_take"
    bl_label = "Export Take"
    filename_ext = ""
    check_extension = None
    kind: bpy.props.EnumProperty(
        name="Format",
        description="Kind of file",
        items=(
            ("BVH", "BVH", "Bones and motion, Y up"),
            ("FBX", "FBX", "Character and motion"),
            ("GLTF", "glTF", "Character and motion in one file (.glb)"),
            ("VRMA", "VRM Animation", "Motion for any VRM avatar, of the performer's own body (.vrma)"),
            ("ANGLES", "Joint Angles", "The performer's joint angles as a table (.angles.csv)"),
        ),
        options={"SKIP_SAVE"},
    )
    naming: bpy.props.EnumProperty(
        name="Names",
        description="Whose names the bones have that stand for joints",
        items=(
            ("OWN", "As They Are", "The character's own"),
            ("unreal", "Unreal", "The mannequin of Unreal Engine 5"),
            ("vrm", "VRM", "Humanoid bones of VRM 1.0"),
            ("mixamo", "Mixamo", "Mixamo's"),
            ("cmu", "CMU", "The CMU Motion Capture Database's, which a new character has"),
        ),
    )
    rate: bpy.props.FloatProperty(
        name="Rate (Hz)", description="Frames per second of the file; 0: as recorded", default=0, min=0, max=1000
    )
    scale: bpy.props.FloatProperty(
        name="Scale",
        description="BVH: its units in one of the scene's; 100 for centimetres where the scene has metres",
        default=1,
        min=0.001,
        max=1000,
    )
    meshes: bpy.props.BoolProperty(name="Meshes", description="Also the meshes that the armature deforms", default=True)
    performer: bpy.props.IntProperty(
        name="Performer",
        description="Which of the take's performers, on their own character; 1: the first",
        default=1,
        min=1,
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only while nothing runs."""
        return common.in_scene(cls, context) and common.idle(cls)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the file."""
        try:
            self.filepath = bpy.path.clean_name(summarise(self.path).notes.name) + _ENDINGS[self.kind]
        except PerfanimError as error:
            return common.failed(self, PANEL, error)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw what counts for this kind of file."""
        column = self.layout.column()
        column.use_property_split = True
        column.use_property_decorate = False
        column.prop(self, "kind")
        names = next((t.performers for t in take_library.listed() if str(t.path) == self.path), ())
        if len(names) > 1:
            column.prop(self, "performer")
            column.label(text=names[min(self.performer, len(names)) - 1], icon="USER")
        column.prop(self, "rate")
        if self.kind != "VRMA":
            column.prop(self, "naming")
        if self.kind == "BVH":
            column.prop(self, "scale")
        if self.kind in ("FBX", "GLTF"):
            column.prop(self, "meshes")

    def check(self, context: bpy.types.Context) -> bool:
        """Let the name end as the format does."""
        wanted = self._with_ending()
        changed, self.filepath = wanted != self.filepath, wanted
        return changed

    def _with_ending(self) -> str:
        path = self.filepath
        known = next((ending for ending in _ENDINGS.values() if path.lower().endswith(ending)), "")
        return path[: len(path) - len(known)] + _ENDINGS[self.kind]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Write the file."""
        try:
            text = self._export(context, Path(absolute(self._with_ending())))
        except PerfanimError as error:
            return common.failed(self, PANEL, error)
        activity.set_message(PANEL, text)
        self.report({"INFO"}, text)
        return {"FINISHED"}

    def _export(self, context: bpy.types.Context, target: Path) -> str:
        take = read_take_file(self.path)
        motion, subjects, name = _motion(context, take), take.setup.subjects(), _chosen(context)
        poses, index = _recorded(take, motion), self.performer - 1
        if index >= len(subjects):
            raise TakeError(f"has {len(subjects)} performers", where=take.notes.name, advice="choose one of them")
        if index > 0:
            name = motion.performers[index - 1].armature
        found, subject = [pose.performers[index] for pose in poses], subjects[index]
        times_s, rotations, positions = pose_arrays(poses, index)
        numbers = np.array([pose.number for pose in found])
        fps = self.rate or (frame_rate(times_s, numbers) if len(times_s) > 1 else 1.0)
        what = f"{take.notes.name} ({subject.name})" if len(subjects) > 1 else take.notes.name
        naming = "" if self.naming == "OWN" else self.naming
        if self.kind in _MOTIONS:
            from ...core.session.solve_take import resample_uniform

            motion = resample_uniform(found, subject, take.notes.name, self.path)
            written = write_motion(motion, target, naming=naming or OWN, rate=self.rate or None)
            return f"{written.frames} frames of {what} in {target}"
        if not name and self.performer > 1:
            advice = "choose it under Further Targets, or click Put on Character"
            raise TakeError("the performer has no character", where=subject.name, advice=advice)
        name = name or add_character(context, subject.skeleton)
        poses = (increasing(times_s), rotations, positions, subject.skeleton, fps)
        count = export_poses(context, name, target, self.kind, *poses, Form(self.meshes, naming, self.scale))
        return f"{count} frames of {what} on {name} in {target}"


_CLASSES = (
    PERFANIM_OT_recover_take,
    PERFANIM_OT_play_take,
    PERFANIM_OT_solve_take,
    PERFANIM_OT_import_takes,
    PERFANIM_OT_export_take,
)

register, unregister = bpy.utils.register_classes_factory(_CLASSES)
