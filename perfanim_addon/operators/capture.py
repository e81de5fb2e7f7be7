"""Live capture: the modal operator and its Stop."""

import time
import traceback

import bpy
import numpy as np

from ...core.errors import CaptureError, CharacterError, PerfanimError
from ...core.pose_frame import PoseFrame
from .. import capture_setup, preferences, running, states
from ..actions import scene_frames, write_action
from ..armature_driver import ArmatureDriver
from ..capture_state import CaptureRun, Phase
from ..properties import settings
from . import common
from .character import add_character
from .database import starter_arguments
from .jobs import Job

PANEL = "capture"
TICK_S = 1 / 60
SIDEBAR_S = 0.25  # the figures are redrawn this often, the viewport only when bones move


class Capture:
    """A capture from the first click: the starter database if it is not there yet, then the run.

    Holds names only, nothing of Blender's data.
    """

    def __init__(self, python: str | None, prepare: list[str]) -> None:
        self._python = python
        self.job = Job("Making the starter database", PANEL, prepare, python) if prepare else None
        self.run: CaptureRun | None = None
        self.driver: ArmatureDriver | None = None
        self.start_frame = 1.0
        self.held_action = ""
        self.stop_asked = False
        self.redrawn = 0.0

    def begin_run(self, context: bpy.types.Context) -> None:
        """Open the database, make a character if none is chosen, and start the worker."""
        chosen = settings(context)
        setup = capture_setup.make(chosen)
        if chosen.armature is None:
            add_character(context, setup.subject.skeleton)
        self.driver = ArmatureDriver(chosen.armature.name, setup.subject.skeleton)
        self.held_action = _release_action(chosen.armature)
        self.skeleton = setup.subject.skeleton
        self.start_frame = float(context.scene.frame_current)
        self.run = setup.start(self._python)
        if self.stop_asked:
            self.run.stop()

    def stop(self) -> None:
        """Ask for a clean end."""
        self.stop_asked = True
        if self.run is not None:
            self.run.stop()

    def close(self) -> None:
        """End the worker processes."""
        if self.job is not None:
            self.job.close()
        if self.run is not None:
            self.run.close()

    @property
    def line(self) -> str:
        """What is being done, for the status bar and the panel."""
        if self.run is None:
            return f"{self.job.title}: {self.job.fraction:.0%}" if self.job else "starting"
        return self.run.activity


def _release_action(armature: bpy.types.Object) -> str:
    """Take the armature's action off, so that a change of frame does not overwrite the live pose; return its name."""
    animation = armature.animation_data
    if animation is None or animation.action is None:
        return ""
    name = str(animation.action.name)
    animation.action.use_fake_user = True
    animation.action = None
    return name


def _restore_action(object_name: str, action_name: str) -> None:
    armature, action = bpy.data.objects.get(object_name), bpy.data.actions.get(action_name)
    if armature is not None and action is not None and armature.animation_data is not None:
        armature.animation_data.action = action


class PERFANIM_OT_start_capture(bpy.types.Operator):
    """Let the character follow the performer until Stop Capture or Esc; the recording becomes one Action"""

    bl_idname = "perfanim.start_capture"
    bl_label = "Start Capture"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only if every step is ready."""
        if not (common.in_scene(cls, context) and common.idle(cls)):
            return False
        problem = states.first_problem(settings(context))
        if problem:
            cls.poll_message_set(problem)
        return not problem

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start; the timer goes on with it."""
        running.set_message(PANEL, "")
        chosen = settings(context)
        prepare = []
        try:
            if not chosen.database and not states.starter_database_path().exists():
                prepare = starter_arguments()
            capture = Capture(preferences.worker_python(context), prepare)
        except PerfanimError as error:
            return common.failed(self, PANEL, error)
        self._capture = capture
        running.begin(context, capture, TICK_S)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Advance at each tick; everything else passes through."""
        if running.current() is not self._capture:
            return self._finish(context)
        if event.type == "ESC" and event.value == "PRESS":
            self._capture.stop()
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            self._tick(context)
        except PerfanimError as error:
            return self._finish(context, error)
        except Exception as error:
            # A defect must not leave timer and worker behind, nor lose what is recorded.
            traceback.print_exc()
            text = f"{type(error).__name__}: {error}"
            return self._finish(context, CaptureError(text, advice="see the console, and report this"))
        run = self._capture.run
        if run is not None and run.phase is Phase.DONE:
            return self._finish(context, run.error)
        return {"PASS_THROUGH"}

    def _tick(self, context: bpy.types.Context) -> None:
        capture = self._capture
        if capture.run is None:
            self._prepare(context)
        else:
            pose = capture.run.tick()
            if pose is not None and capture.driver is not None:
                capture.driver.apply(pose.rotations, pose.root_position_m)
                capture.run.shown()
        now = time.perf_counter()
        if now - capture.redrawn > SIDEBAR_S:
            capture.redrawn = now
            running.redraw_sidebars()
            context.workspace.status_text_set(f"Perfanim: {capture.line}.  Esc or Stop Capture: end and keep")

    def _prepare(self, context: bpy.types.Context) -> None:
        capture = self._capture
        if capture.job is not None:
            capture.job.tick()
            if not capture.job.ended:
                return
            capture.job.close()
        capture.begin_run(context)

    def _finish(self, context: bpy.types.Context, error: PerfanimError | None = None) -> set[str]:
        """End everything, keep what was captured as one Action."""
        capture = self._capture
        running.end()
        context.workspace.status_text_set(None)
        poses = capture.run.poses if capture.run else []
        text = ""
        if poses:
            try:
                text = self._write(context, poses)
            except PerfanimError as second:
                error = error or second
        elif capture.driver is not None:
            _restore_action(capture.driver.object_name, capture.held_action)
        running.redraw_sidebars()
        if error is not None:
            common.failed(self, PANEL, error)
        elif not text:
            text = "stopped before the first frame"
        if text:
            running.set_message(PANEL, str(error) if error else text)
            self.report({"INFO"}, text)
        return {"FINISHED"} if capture.run is not None else {"CANCELLED"}

    def _write(self, context: bpy.types.Context, poses: list[PoseFrame]) -> str:
        capture = self._capture
        name = capture.driver.object_name if capture.driver else ""
        if name not in bpy.data.objects:  # deleted while capturing: the recording is kept all the same
            name = add_character(context, capture.skeleton)
        times = increasing(np.array([pose.time_s for pose in poses]))
        frames = scene_frames(times, context.scene, capture.start_frame)
        rotations = np.stack([pose.rotations for pose in poses])
        positions = np.stack([pose.root_position_m for pose in poses])
        action = write_action(name, frames, rotations, positions, capture.skeleton)
        if settings(context).extend_scene:
            context.scene.frame_end = max(context.scene.frame_end, int(np.ceil(frames[-1])))
        return f"{len(poses)} frames recorded in {action}"

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender takes the operator down (the window is closed, the add-on switched off)."""
        if running.current() is self._capture:
            running.end()


def increasing(times_s: np.ndarray) -> np.ndarray:
    """Return times (F,) with those that do not come after their predecessor moved 0.1 ms behind it."""
    step = 1e-4
    ramp = step * np.arange(len(times_s))
    return np.maximum.accumulate(times_s - ramp) + ramp


class PERFANIM_OT_stop_capture(bpy.types.Operator):
    """End the capture; every captured frame is kept in one Action"""

    bl_idname = "perfanim.stop_capture"
    bl_label = "Stop Capture"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only while capturing."""
        if not isinstance(running.current(), Capture):
            cls.poll_message_set("Nothing is being captured")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Ask for the end; the capture's own timer finishes it."""
        capture = running.current()
        if not isinstance(capture, Capture):
            return common.failed(self, PANEL, CharacterError("nothing is being captured"))
        capture.stop()
        return {"FINISHED"}


_CLASSES = (PERFANIM_OT_start_capture, PERFANIM_OT_stop_capture)


def register() -> None:
    """Register the operators."""
    for cls in _CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Undo `register`."""
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
