"""A capture in Blender: the worker's frames through the session onto an armature, and at the end into an Action."""

import contextlib
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.body.scene_pose import ScenePose
from ...core.body.skeleton import Skeleton
from ...core.body.standard_skeleton import default_skeleton
from ...core.errors import PerfanimError
from ...core.geometry import rotations as rot
from .. import take_library
from ..animation.suspended_actions import SuspendedActions
from ..jobs import activity
from ..jobs.job import Job, command
from ..settings.capture_settings import settings
from ..settings.result_settings import start_frame
from ..viewport import camera_preview, overlay
from . import request, sound
from .armature_driver import ArmatureDriver
from .capture_run import CaptureRun, Phase
from .capture_space import CaptureSpace
from .further_targets import Others
from .recording import Cue, Recording
from .write_take import RecordedPart, TakeMotion, add_character, write_take

Array = NDArray[np.float64]


class LiveCapture:
    """A capture from the first click on: the starter database if it is not there yet, then the run.

    Only names are held, nothing of Blender's data: undo and file load replace that.

    Args:
        python: interpreter of the worker, None for Blender's own.
        prepare: command that must be done before, [] for none.
    """

    def __init__(self, python: str | None, prepare: list[str]) -> None:
        self.job = Job("Making the starter database", "capture", command(prepare), python) if prepare else None
        self.run: CaptureRun | None = None
        self.recordings: list[Recording] = []
        self.by_button = False
        self._sounds = False
        self._python = python
        self._driver: ArmatureDriver | None = None
        self._skeleton: Skeleton | None = None
        self._held = SuspendedActions()
        self._others: Others | None = None  # where there are any
        self._take_path = ""
        self._request: dict[str, Any] = {}
        self._drawn: overlay.Scene | None = None
        self._stop_asked = False
        self._kept: str | None = None

    @property
    def line(self) -> str:
        """What is being done, in a few words."""
        if self.run is None:
            return f"{self.job.title}: {self.job.fraction:.0%}" if self.job else "starting"
        recording = self.recording
        if recording is not None and recording.seconds_left:
            return f"recording in {recording.seconds_left} s"
        if recording is None and self.by_button and self.run.poses:
            return "rehearsing, nothing is recorded"
        return self.run.activity

    @property
    def recording(self) -> Recording | None:
        """The recording that goes on, or its countdown."""
        return self.recordings[-1] if self.recordings and not self.recordings[-1].over else None

    @property
    def further(self) -> list[tuple[str, float]]:
        """The further performers' names, and how sure the newest pose of each is."""
        newest = self.run.poses[-1].performers[1:] if self.run is not None and self.run.poses else ()
        roles = self._others.roles if self._others is not None else []
        return [(role.subject.name, pose.confidence) for role, pose in zip(roles, newest, strict=False)]

    def record(self, chosen: Any) -> None:
        """Begin a recording as the settings have it, or end the one that goes on."""
        going = self.recording
        if going is None:
            later = bool(self.recordings) or self.by_button
            self.recordings.append(Recording(chosen.record_countdown_s, chosen.record_length_s, later))
        elif self.run is not None:
            going.end(self.run.poses)
            self._tell(Cue.END)

    @property
    def done(self) -> bool:
        """Whether all is solved and nothing follows."""
        return self.run is not None and self.run.phase is Phase.DONE

    def tick(self, context: bpy.types.Context) -> bool:
        """Take what the worker has sent and pose the armature, whether there is a new pose; never waits.

        Raises:
            PerfanimError: the preparation failed, a file is bad, or the armature is gone.
        """
        if self.run is None:
            self._prepare(context)
            return False
        pose = self.run.tick()
        picture = self.run.take_preview()
        if picture is not None:
            camera_preview.show(picture, self.run.notice)
        self._record(context, self.run)
        if pose is None:
            return False
        first = pose.performers[0]
        self._bind(context).apply(first.rotations, first.root_position_m)
        if self._others is not None:
            self._others.apply(context, self.run.poses)
        self._draw(context, pose)
        self.run.shown()
        return True

    def _draw(self, context: bpy.types.Context, pose: ScenePose) -> None:
        """Draw over the viewports what is chosen."""
        chosen = settings(context)
        parts = frozenset(chosen.overlay)
        if parts and self._drawn is None:
            room = CaptureSpace(chosen.armature, self._bind(context).plan)
            self._drawn = overlay.Scene.of(self._request, lambda places_m: room.brought(rot.identity(), places_m)[1])
        overlay.show(self._drawn, pose, parts)

    def _record(self, context: bpy.types.Context, run: CaptureRun) -> None:
        """Begin and end the recording when it is time."""
        recording = self.recording
        if recording is None:
            return
        had_begun = recording.begun
        cue = recording.advance(run.poses)
        if recording.begun and not had_begun:
            recording.start_frame = start_frame(context)
        if cue is not None:
            self._tell(cue)
        if recording.over and not self.by_button:
            self.stop()

    def _tell(self, cue: Cue) -> None:
        activity.redraw_sidebars()  # they tell the seconds
        if self._sounds:
            sound.beep(cue.value)

    def _prepare(self, context: bpy.types.Context) -> None:
        if self.job is not None:
            self.job.tick()
            if not self.job.ended:
                return
            self.job.close()
        self._begin(context)

    def _begin(self, context: bpy.types.Context) -> None:
        """Check the files and the armature, if one is chosen, and start the worker."""
        chosen = settings(context)
        setup = request.make(chosen)
        self._skeleton = setup.skeleton
        if setup.props or setup.performers:
            self._others = Others(context, setup.props, setup.performers, chosen.body_parts)
        self.by_button = chosen.record_by_button
        if not self.by_button:
            self.record(chosen)
        self._sounds = chosen.record_sound
        if chosen.armature is not None:
            self._bind(context)
        self._request, self._take_path = setup.request, setup.request["take"]
        self.run = setup.start(self._python)
        if self._stop_asked:
            self.run.stop()

    def _bind(self, context: bpy.types.Context) -> ArmatureDriver:
        """Return the driver of the chosen armature; without one, a character is made for the first pose.

        So a camera that does not open leaves the scene as it was.
        """
        if self._driver is None:
            chosen, skeleton = settings(context), self._skeleton or default_skeleton()
            if chosen.armature is None:
                add_character(context, skeleton)
            self._driver = ArmatureDriver(chosen.armature.name, skeleton, chosen.body_parts)
            if self._driver.only is None:
                self._held.take(chosen.armature)
            if self._others is not None:
                self._others.enter(context, chosen.armature, self._driver.plan)
            others = self._others.roles if self._others is not None else []
            if any(map(_plays, (chosen.armature, *(role.character() for role in others)))):
                bpy.app.handlers.frame_change_post.append(_after_frame_change)
        return self._driver

    def pose_again(self) -> None:
        """Put the newest pose back where an animation has overwritten it."""
        if self._driver is not None:
            self._driver.apply_again()
        if self._others is not None:
            self._others.apply_again()

    def tune(self, chosen: Any) -> None:
        """Go on with the smoothing and the foot lock of the settings."""
        if self.run is not None:
            self.run.tune(request.shape(chosen))

    def stop(self) -> None:
        """Ask for a clean end; `tick` goes on until `done`."""
        self._stop_asked = True
        if self.run is not None:
            self.run.stop()

    def close(self) -> None:
        """Take what has arrived, and end the worker processes."""
        with contextlib.suppress(ValueError):  # it is there only where something else animates the character
            bpy.app.handlers.frame_change_post.remove(_after_frame_change)
        if self.job is not None:
            self.job.close()
        if self.run is not None:
            self.run.tick()
            self.run.close()
            take_library.forget()  # this one is there now

    def keep(self, context: bpy.types.Context) -> str:
        """Write each recording as one Action, once; return the line that says so, "" when there is nothing to keep.

        A frame captured t seconds after the first stands at the start frame + t * the scene's frames per second, so a
        60 Hz capture in a 24 fps scene has keys between the scene's frames and plays at its true speed.
        """
        if self._kept is None:
            self._kept = ""  # a second try would fail alike
            self._kept = self._write(context)
        return self._kept

    def _write(self, context: bpy.types.Context) -> str:
        all_poses = self.run.poses if self.run else []
        parts = [(recording, recording.recorded(all_poses)) for recording in self.recordings]
        parts = [(recording, poses) for recording, poses in parts if poses]
        self._held.give_back()  # a strip goes above it
        if self._others is not None:
            self._others.restore()
        if not parts or self._skeleton is None or self._driver is None:
            return ""
        others = self._others
        motion = TakeMotion(self._skeleton, others.props if others else (), others.roles if others else (), all_poses)
        recorded = [RecordedPart(poses, recording.start_frame) for recording, poses in parts]
        _, actions = write_take(context, motion, recorded, "Capture", self._driver.object_name, self._driver.only)
        first, last = parts[0][1][0], parts[-1][1][-1]
        span = None if (first, last) == (all_poses[0], all_poses[-1]) else (first.number, last.number)
        with contextlib.suppress(PerfanimError):  # there may be no take: its disk is full, its worker was killed
            take_library.mark_captured(self._take_path, request.shape(settings(context)), span)
        text = f"{sum(len(poses) for _, poses in parts)} frames recorded in {', '.join(actions)}"
        return f"{text}; {self.run.standing}" if self.run and self.run.standing else text


def _plays(armature: bpy.types.Object | None) -> bool:
    """Return whether something animates the armature, so that a change of frame overwrites its pose."""
    animation = armature.animation_data if armature is not None else None
    return animation is not None and (animation.action is not None or len(animation.nla_tracks) > 0)


def _after_frame_change(*_: object) -> None:
    """Let the live pose stand over what the timeline plays."""
    capture = activity.current()
    if isinstance(capture, LiveCapture):
        with contextlib.suppress(PerfanimError):  # the next tick tells
            capture.pose_again()
