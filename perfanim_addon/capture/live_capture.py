"""Live capture: shows the worker's poses on the characters, and writes actions at the end."""

import contextlib
from typing import Any

import bpy

from ...core.body.scene_pose import ScenePose
from ...core.errors import CharacterError, PerfanimError
from ...core.markers.source_noise import noise_of
from ...core.session.delayed_poses import calm_poses
from ...core.session.gestures import GESTURES, GestureWatch
from ...core.session.walk_test import judge_walk, walk_figures
from ...core.simulate.studio.simulated_performer import SimulatedPerformer
from ...core.system.files import exists
from .. import take_library
from ..jobs import activity
from ..jobs.job import Job
from ..settings import readiness
from ..settings.capture_settings import chosen_gesture, settings
from ..settings.result_settings import start_frame
from ..viewport import ghost, overlay, picture_overlay
from . import capture_request, sound
from .capture_recording import Cue, Recording
from .capture_run import CaptureRun, Phase
from .hand_cues import HandCues
from .live_refinement import LiveRefinement
from .scene_driver import SceneDriver
from .tuning import TUNING
from .write_take import RecordedPart, TakeMotion, doubts, write_take


class LiveCapture:
    """One capture; it holds only names, because undo and loading a file replace Blender's data.

    Args:
        python: Interpreter of the worker; None for Blender's own.
        first: Job that builds the starter database; None if it already exists.
    """

    def __init__(self, python: str | None, first: Job | None = None) -> None:
        self.job = first
        self.run: CaptureRun | None = None
        self.recordings: list[Recording] = []
        self.by_button = False
        self._sounds = False
        self._python = python
        self._driver: SceneDriver | None = None
        self._is_shown = False
        self.take_path = ""
        self.setup: capture_request.Setup | None = None
        self._drawn: overlay.Scene | None = None
        self._refinement: LiveRefinement | None = None
        self._stop_asked = False
        self._hands = HandCues()
        self._gestures: GestureWatch | None = None
        self._kept: str | None = None
        self.actions: tuple[str, ...] = ()  # names of the recorded actions

    @property
    def line(self) -> str:
        """Current activity in a few words."""
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
        """Current recording or countdown."""
        return self.recordings[-1] if self.recordings and not self.recordings[-1].over else None

    def record(self, chosen: Any) -> None:
        """Start a recording, or end the current one."""
        going = self.recording
        if going is None:
            later = bool(self.recordings) or self.by_button
            self.recordings.append(Recording(chosen.record_countdown_s, chosen.record_length_s, later))
        elif self.run is not None:
            going.end(self.run.poses)
            self._tell(Cue.END)

    def signal(self, chosen: Any, cut_s: float = 0.0) -> None:
        """Start or stop by a key or a gesture: a recording with Record by Button, otherwise the capture ends.

        Args:
            cut_s: Time before now that is left out at the end of the recording: the performer's gesture.
        """
        going = self.recording
        if self.run is not None and self.by_button and going is None:
            self.record(chosen)
            return
        if self.run is not None and going is not None:
            going.end(self.run.poses, cut_s)
            self._tell(Cue.END)
        if not self.by_button:
            self.stop()

    @property
    def done(self) -> bool:
        """Whether the run has ended."""
        return self.run is not None and self.run.phase is Phase.DONE

    def tick(self, context: bpy.types.Context) -> bool:
        """Poll the worker, show a new pose, and return whether there was one; PerfanimError if it cannot continue."""
        if self.run is None:
            self._prepare(context)
            return False
        pose = self.run.tick()
        picture = self.run.take_preview()
        if picture is not None:
            picture_overlay.show(picture, self.run.notice)
        self._record(context, self.run)
        if pose is None or self._driver is None:
            return False
        self._apply(context, self._driver, self.run)
        if self._gestures is not None and not self._stop_asked and self._gestures.step(pose.performers[0]):
            self.signal(settings(context), GESTURES.lasts_s)
        self._draw(context, self._driver, pose)
        self.run.shown()
        if self._refinement is not None and self._refinement.tick(pose.time_s - self.run.poses[0].time_s):
            activity.redraw_sidebars()
        return True

    def _draw(self, context: bpy.types.Context, driver: SceneDriver, pose: ScenePose) -> None:
        parts = frozenset(settings(context).overlay)
        if parts and self._drawn is None and self.setup is not None:
            cameras, space = self.setup.request.cameras, driver.start(context)
            simulated = isinstance(cameras.source, SimulatedPerformer)
            placed = space.points_to_scene
            self._drawn = overlay.Scene.of(self.setup.performers, cameras.rig, placed, simulated, ghost.last())
        elapsed_s = self.recording.seconds(self.run.poses) if self.recording and self.run else 0.0
        overlay.show(self._drawn, pose, parts, elapsed_s)

    def _record(self, context: bpy.types.Context, run: CaptureRun) -> None:
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
        activity.redraw_sidebars()  # the sidebars show the countdown
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
        """Check the files and the chosen characters, and start the worker."""
        chosen = settings(context)
        setup = capture_request.make(chosen)
        self._driver = SceneDriver(context, setup.performers, setup.props, chosen.body_parts)
        self.by_button = chosen.record_by_button
        if not self.by_button:
            self.record(chosen)
        self._sounds = chosen.record_sound
        if (gesture := chosen_gesture(chosen)) is not None:
            self._gestures = GestureWatch(setup.performers[0].skeleton, gesture)
        self.setup, self.take_path = setup, setup.request.take
        self.run = setup.start(self._python)
        if not readiness.is_known(chosen):  # a simulated performer's body needs no refinement
            self._refinement = LiveRefinement(self.take_path, setup.request.database, self._python)
        if self._stop_asked:
            self.run.stop()

    def _apply(self, context: bpy.types.Context, driver: SceneDriver, run: CaptureRun) -> None:
        """Show the newest pose; new characters are added with the first, so that a failed start adds none."""
        driver.apply(context, run.poses)
        if not self._is_shown:
            self._is_shown = True
            played = [character.animation_data for target in driver.targets if (character := target.character())]
            if any(animation and (animation.action or len(animation.nla_tracks)) for animation in played):
                bpy.app.handlers.frame_change_post.append(_after_frame_change)

    def reapply_pose(self) -> None:
        """Apply the newest pose again after an animation has overwritten it."""
        if self._driver is not None:
            self._driver.reapply_pose()

    def pose_hands(self, name: str, sides: str) -> None:
        """Let the first performer's hands ("l", "r", "lr") hold a pose from now on, on all of their characters.

        CharacterError if the first character cannot.
        """
        driver = self._driver
        if driver is None or self.run is None or not self.run.poses or driver.space is None:
            return
        driver.pose_hands(name, sides)
        self._hands.add(self.run.poses[-1].time_s, name, sides)

    def tune(self, chosen: Any) -> None:
        """Use the smoothing and foot lock settings from now on."""
        if self.run is not None:
            self.run.tune(capture_request.shape(chosen))

    def stop(self) -> None:
        """Request a clean end; call `tick` until `done`."""
        self._stop_asked = True
        if self.run is not None:
            self.run.stop()

    def close(self) -> None:
        """Receive the last messages, and end the worker processes."""
        with contextlib.suppress(ValueError):  # only an animated character has the handler
            bpy.app.handlers.frame_change_post.remove(_after_frame_change)
        if self.job is not None:
            self.job.close()
        if self._refinement is not None:
            self._refinement.close()
        if self.run is not None:
            self.run.tick()
            self.run.close()
            take_library.forget()  # the folder now contains this take

    def keep(self, context: bpy.types.Context) -> str:
        """Write each recording as one action, once; return a report, or "" if there is no recording.

        Keys are laid out by the poses' times at a steady rate, even between the scene's frames, so that the motion has
        its true speed.
        """
        if self._kept is None:
            self._kept = ""  # if writing fails, a second attempt would fail, too
            self._kept = self._write(context)
        return self._kept

    def _write(self, context: bpy.types.Context) -> str:
        driver, all_poses = self._driver, self.run.poses if self.run else []
        if driver is not None and settings(context).immediate:
            # shown as solved, but recorded with the zero-lag filter, as in the take
            all_poses = calm_poses(all_poses, noise_of(driver.targets[0].subject.marker_set.points))
        parts = [RecordedPart(recording.recorded(all_poses), recording.start_frame) for recording in self.recordings]
        parts = [part for part in parts if part.poses]
        if driver is not None:
            driver.held.give_back()  # the recording's strip goes above these actions
        if not parts or driver is None or driver.space is None:
            return ""
        motion = TakeMotion(driver.targets, driver.props, all_poses, driver.copies)
        character, actions = write_take(context, motion, parts, "Capture")
        self._hands.key(bpy.data.objects[character], parts)
        for copied in filter(None, (target.character() for target in driver.copies)):
            with contextlib.suppress(CharacterError):  # a further character without fingers
                self._hands.key(copied, parts)
        self.actions = tuple(actions)
        ghost.remember(ghost.Ghost.of([target.subject.skeleton for target in driver.targets], parts[-1].poses))
        recorded = parts[0].poses[0].number, parts[-1].poses[-1].number
        span = None if recorded == (all_poses[0].number, all_poses[-1].number) else recorded
        with contextlib.suppress(PerfanimError):  # there may be no take, because of a full disk or a killed worker
            take_library.mark_captured(self.take_path, capture_request.shape(settings(context)), span)
        spans = [f"{part.frames(part.clock)[0]:.0f} to {part.frames(part.clock)[-1]:.0f}" for part in parts]
        seconds = sum(part.poses[-1].time_s - part.poses[0].time_s for part in parts)
        text = f"{sum(len(part.poses) for part in parts)} frames recorded in {', '.join(actions)}"
        text += f": {seconds:.1f} s, scene frames {', '.join(spans)}{doubts(motion, parts)}"
        return f"{text}; {self.run.persistent_warning}" if self.run and self.run.persistent_warning else text


def running_capture() -> LiveCapture | None:
    """Return the running capture, or None."""
    running = activity.current()
    return running if isinstance(running, LiveCapture) else None


def further_performers(capture: LiveCapture) -> list[tuple[str, float]]:
    """Return name and latest confidence of each performer after the first."""
    newest = capture.run.poses[-1].performers[1:] if capture.run is not None and capture.run.poses else ()
    performers = capture.setup.performers[1:] if capture.setup is not None else ()
    return [(subject.name, pose.confidence) for subject, pose in zip(performers, newest, strict=False)]


def refining_take(capture: LiveCapture, chosen: Any) -> str:
    """Return the file of the take if it is long enough for refining the first performer, else ""."""
    poses = capture.run.poses if capture.run is not None else ()
    if len(poses) < 2 or readiness.is_known(chosen):
        return ""
    is_long = poses[-1].time_s - poses[0].time_s >= TUNING.refined_at_s[0]
    return capture.take_path if is_long and exists(capture.take_path) else ""


def judge_capture(capture: LiveCapture) -> str:
    """Return a sentence on how well the first performer was tracked, or "" for a short capture."""
    run, setup = capture.run, capture.setup
    if run is None or setup is None:
        return ""
    poses = [pose.performers[0] for pose in run.poses[-TUNING.judged_poses :]]
    figures = walk_figures(poses, round(run.statistics.lost * len(poses) / max(len(run.poses), 1)))
    return judge_walk(figures, setup.performers[0].marker_set.texts) if figures else ""


def _after_frame_change(*_: object) -> None:
    """Keep the live pose while the timeline plays."""
    capture = running_capture()
    if capture is not None:
        with contextlib.suppress(PerfanimError):  # the next tick reports the error
            capture.reapply_pose()
