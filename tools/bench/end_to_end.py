"""Errors of recorded motion solved through simulated cameras, compared with those from its true markers.

Chai and Hodgins 2005 make this comparison for boxing: 2.54 degrees per joint angle from video, 2.31 from true markers.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from perfanim.core.body.calibration_poses import CALIBRATION
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.database.file_selection import subject_of
from perfanim.core.database.store import Database
from perfanim.core.geometry.arrays import Array, Mask
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.markers.source_noise import noise_of
from perfanim.core.markers.subject import Subject
from perfanim.core.session.delayed_poses import calm_performer
from perfanim.core.session.session import Session
from perfanim.core.session.solve_take import solve_take
from perfanim.core.session.steady_motion import motion_of
from perfanim.core.simulate.calibrated_studio import calibrate_studio, studio_on_floor
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.simulate.studio.render import Renderer
from perfanim.core.simulate.studio.simulated_source import SimulatedSource, simulated_source
from perfanim.core.simulate.studio.stage_placement import on_stage, with_poses
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.simulate.studio.studio_settings import StudioSettings
from perfanim.core.subjects.from_recording import subject_from_recording
from perfanim.core.subjects.prototype_bodies import load_bodies
from perfanim.core.system.progress import no_progress
from perfanim.core.vision.pipeline import MarkerPipeline

from .run import Run
from .scenarios import BOXING, CMU, WALKING, WITHOUT_PRIOR
from .scenes import on_treadmill
from .solving import MARKER_SET

PAPER = {"true markers": 2.31, "video": 2.54}  # boxing, degrees per joint angle
EXPOSURE_S = 0.004
_HELD_S = 1.5  # duration of each calibration pose
_UNITS = ("deg_per_joint", "deg_per_angle", "mpjpe_mm", "bone_direction_deg", "jitter_ratio", "twist_deg")


class Filmed(NamedTuple):
    """Marker frames that cameras see, and their truth."""

    frames: list[MarkerFrame]
    truth: Motion
    markers_m: Array  # (F, M, 3)
    both: Mask  # (F, M) markers that all cameras show


def staged(
    motion: Motion, poses: tuple[str, ...], held_s: float, marker_set: str = MARKER_SET, cameras: int = 2
) -> tuple[SimulatedSource, int]:
    """Return a source for a motion after calibration poses, and the frame at which the motion begins.

    The motion is kept in place, because walks are longer than two cameras can follow at 640x480.
    """
    shown = on_stage(on_treadmill(motion))
    studio = Renderer(CameraRig(default_rig().cameras[:cameras]), StudioSettings(exposure_s=EXPOSURE_S))
    source = simulated_source(with_poses(shown, poses, held_s), marker_set, studio)
    return source, source.frames - shown.frames


def calibrated(source: SimulatedSource) -> CameraRig:
    """Return the rig obtained by calibrating the source's cameras."""
    return studio_on_floor(calibrate_studio(source).rig, source)


def film(source: SimulatedSource, rig: CameraRig) -> Filmed:
    """Return the marker frames that a rig produces from a source."""
    pipeline = MarkerPipeline(rig)
    pipeline.learn_empty(source.background_frames(60))
    rows = [(pipeline.process(s), s.truth.markers_m, s.truth.visible.all(axis=0)) for s in source]
    frames, markers, both = zip(*rows, strict=True)
    return Filmed(list(frames), sliced(source.motion, 0, len(frames)), np.array(markers), np.array(both))


def end_to_end(run: Run) -> dict[str, Any]:
    """Film, track and solve takes that are not in the database; write the table.

    There are six rows per take: true markers with the true subject; true markers, but only while two cameras see them;
    true markers with the subject calibrated from the images of the T pose, and of all poses; the video, without any
    truth; the first camera's video alone, with more markers and (one camera cannot measure a body) the true subject.

    Returns:
        rows (take, input, errors, difference to the true markers), paper, outputs.
    """
    database = run.without_tests(run.whole(CMU))
    rows: list[dict[str, Any]] = []
    rig = None
    for number, take in enumerate((WALKING, BOXING)):
        run.progress(0.2 + 0.4 * number, f"{take.title}: filming, tracking and solving")
        motion = run.read(take)
        source, start = staged(motion, CALIBRATION, _HELD_S)
        rig = rig or calibrated(source)
        one_camera, _ = staged(motion, CALIBRATION, _HELD_S, "one-camera", cameras=1)
        solved = _solved(source, one_camera, database, rig, start, subject_of(take.trial))
        rows += [{"take": take.title} | row for row in solved]
    figures = {"rows": rows, "paper_deg_per_angle": PAPER, "marker_set": MARKER_SET}
    return run.write("end-to-end", figures, {"": rows})


def _solved(
    source: SimulatedSource, one_camera: SimulatedSource, database: Database, rig: CameraRig, start: int, person: str
) -> list[dict[str, Any]]:
    """Return the errors for every input from frame `start` on, after the calibration.

    Args:
        person: Name of the subject in the database, used for the rest pose of the hands, not for the bones.
    """
    filmed, skeleton = film(source, rig), source.motion.skeleton
    true_subject = Subject("true", skeleton, source.subject.marker_set)
    of_one, of_all = (
        subject_from_recording(
            filmed.frames[:start], source.fps, load_marker_set(MARKER_SET), load_bodies(), person, poses
        ).subject
        for poses in (("t",), CALIBRATION)
    )
    take, _ = simulate_markers(source.motion, true_subject)
    hidden = replace(take, positions_m=np.where(filmed.both[..., None], take.positions_m, np.nan))

    def from_take(markers: MarkerTake, subject: Subject) -> Motion:
        return solve_take(markers, subject, database, WITHOUT_PRIOR, no_progress, causal=True).motion

    def from_video(frames: list[MarkerFrame], subject: Subject, cameras: CameraRig) -> Motion:
        session = Session(subject, database, cameras, WITHOUT_PRIOR)
        poses = calm_performer([session.step(frame) for frame in frames], noise_of(subject.marker_set.points))
        return motion_of(poses, subject, "video", source.fps)

    left = CameraRig(rig.cameras[:1])
    seen_by_one = Subject("true", skeleton, one_camera.subject.marker_set)
    solutions = {
        "true markers": from_take(take, true_subject),
        "true markers, hidden where a camera does not see them": from_take(hidden, true_subject),
        "true markers, subject of the T pose": from_take(take, of_one),
        "true markers, subject of all poses": from_take(take, of_all),
        "video": from_video(filmed.frames, of_all, rig),
        "video of one camera, 14 markers": from_video(film(one_camera, left).frames, seen_by_one, left),
    }
    truth = sliced(source.motion, start, len(filmed.frames))
    rows: list[dict[str, Any]] = []
    for name, motion in solutions.items():
        errors = evaluate(sliced(motion, start, len(filmed.frames)), truth)
        row = {"input": name, "frames": truth.frames} | {unit: round(errors[unit], 4) for unit in _UNITS}
        best = (rows or [row])[0]["deg_per_joint"]
        rows.append(row | {"worse_by_deg_per_joint": round(row["deg_per_joint"] - best, 4)})
    return rows
