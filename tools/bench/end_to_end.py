"""Errors from recorded motion via simulated cameras, and from its true markers.

Chai and Hodgins 2005 compare so: boxing with 2.54 degrees per joint angle from video, 2.31 from true markers.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.body.calibration_poses import CALIBRATION
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.database.file_selection import subject_of
from perfanim.core.database.store import Database
from perfanim.core.geometry.arrays import Mask
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.markers.subject import Subject
from perfanim.core.session.session import Session
from perfanim.core.session.solve_take import motion_of, solve_take
from perfanim.core.simulate.calibrated_studio import calibrate_studio, studio_on_floor
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.simulate.studio.render import Renderer
from perfanim.core.simulate.studio.simulated_source import SimulatedSource, simulated_source
from perfanim.core.simulate.studio.stage_placement import on_stage, with_poses
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.simulate.studio.studio_settings import StudioSettings
from perfanim.core.subjects.from_recording import subject_from_recording
from perfanim.core.subjects.prototype_bodies import load_bodies
from perfanim.core.system.progress import Progress
from perfanim.core.vision.pipeline import MarkerPipeline

from .data import BOXING, CMU, WALKING, read_take, whole_database, without_tests
from .methods import WITHOUT_PRIOR
from .report import write_figures

Seen = Mask

MARKER_SET, ONE_CAMERA_SET = "boxing", "one-camera"
PAPER = {"true markers": 2.31, "video": 2.54}  # boxing, degrees per joint angle
_HELD_S = 1.5  # each calibration pose
EMPTY_FRAMES = 60
EXPOSURE_S = 0.004
_UNITS = ("deg_per_joint", "deg_per_angle", "mpjpe_mm", "bone_direction_deg", "jitter_ratio", "twist_deg")


def end_to_end(data: Path, out: Path, workers: int, progress: Progress) -> dict[str, Any]:
    """Film, track and solve takes that the database lacks; write the table.

    Six rows a take: true markers with the true subject; true markers, present only when two cameras see them; true
    markers with the subject calibrated from the images of the T pose, and of all poses; the video, without any truth;
    the video of the first camera alone, with more markers and (one camera measures no body) the true subject.

    Returns:
        rows (take, input, errors, difference to the true markers), calibration, paper, outputs.
    """
    whole = whole_database(data, out, (CMU,), workers, progress)
    database = without_tests(whole, out / "databases" / "cmu-without-tests.pfdb")
    rows: list[dict[str, Any]] = []
    takes = (WALKING, BOXING)
    rig = None
    for number, take in enumerate(takes):
        # the walk is longer than two cameras can follow at 640x480
        motion = on_stage(on_treadmill(read_take(data, take)))
        taken, motion = motion.frames, with_poses(motion, CALIBRATION, _HELD_S)
        source = simulated_source(motion, MARKER_SET, Renderer(default_rig(), StudioSettings(exposure_s=EXPOSURE_S)))
        progress(0.2 + 0.8 * number / len(takes), f"{take.title}: filming and tracking")
        rig = rig or studio_on_floor(calibrate_studio(source).rig, source)
        frames, both = _filmed(source, rig)
        progress(0.2 + 0.8 * (number + 0.6) / len(takes), f"{take.title}: solving")
        rows += [
            {"take": take.title} | row
            for row in _solved(source, database, rig, frames, both, taken, subject_of(take.trial))
        ]
    figures = {"rows": rows, "paper_deg_per_angle": PAPER, "marker_set": MARKER_SET}
    return write_figures(out, "end-to-end", figures, {"": rows})


def _filmed(source: SimulatedSource, rig: CameraRig) -> tuple[list[MarkerFrame], Seen]:
    """Return the video's marker frames, and the markers that both cameras show (F, M)."""
    pipeline = MarkerPipeline(rig)
    pipeline.learn_empty(source.background_frames(EMPTY_FRAMES))
    frames, both = [], []
    for images in source:
        frames.append(pipeline.process(images))
        both.append(images.truth.visible.all(axis=0))
    return frames, np.array(both)


def _solved(
    source: SimulatedSource,
    database: Database,
    rig: CameraRig,
    frames: list[MarkerFrame],
    both: Seen,
    taken: int,
    person: str,
) -> list[dict[str, Any]]:
    """Return the errors of every input in the last `taken` frames (after calibration).

    Args:
        person: name of the subject in the database.
    """
    start = source.frames - taken
    true_subject = Subject("true", source.motion.skeleton, source.subject.marker_set)
    worn, bodies = load_marker_set(MARKER_SET), load_bodies()
    # a person's name in the database gives the rest of the hands, not the bones
    of_one = subject_from_recording(frames[:start], source.fps, worn, bodies, person, ("t",)).subject
    found = subject_from_recording(frames[:start], source.fps, worn, bodies, person, CALIBRATION).subject
    take, _ = simulate_markers(source.motion, true_subject)
    solutions = {
        "true markers": _from_take(take, true_subject, database),
        "true markers, hidden where a camera does not see them": _from_take(
            _hidden(take, both), true_subject, database
        ),
        "true markers, subject of the T pose": _from_take(take, of_one, database),
        "true markers, subject of all poses": _from_take(take, found, database),
        "video": _from_video(frames, found, database, rig, source.fps),
        "video of one camera, 14 markers": _from_one_camera(source.motion, database, rig),
    }
    truth = sliced(source.motion, start, len(frames))
    rows: list[dict[str, Any]] = []
    for name, motion in solutions.items():
        errors = evaluate(sliced(motion, start, len(frames)), truth)
        row = {"input": name, "frames": truth.frames} | {unit: round(errors[unit], 4) for unit in _UNITS}
        rows.append(
            row | {"worse_by_deg_per_joint": round(row["deg_per_joint"] - (rows or [row])[0]["deg_per_joint"], 4)}
        )
    return rows


def _hidden(take: MarkerTake, seen: Seen) -> MarkerTake:
    return replace(take, positions_m=np.where(seen[..., None], take.positions_m, np.nan))


def _from_take(take: MarkerTake, subject: Subject, database: Database) -> Motion:
    return solve_take(take, subject, database, WITHOUT_PRIOR, lambda fraction, text: None, causal=True).motion


def _from_one_camera(motion: Motion, database: Database, rig: CameraRig) -> Motion:
    studio = Renderer(CameraRig(default_rig().cameras[:1]), StudioSettings(exposure_s=EXPOSURE_S))
    source, one = simulated_source(motion, ONE_CAMERA_SET, studio), CameraRig(rig.cameras[:1])
    subject = Subject("true", motion.skeleton, source.subject.marker_set)
    return _from_video(_filmed(source, one)[0], subject, database, one, motion.fps)


def _from_video(frames: list[MarkerFrame], subject: Subject, database: Database, rig: CameraRig, fps: float) -> Motion:
    session = Session(subject, database, rig, WITHOUT_PRIOR)
    return motion_of([session.step(frame) for frame in frames], subject, "video", fps)


def on_treadmill(motion: Motion) -> Motion:
    """Return the motion without its mean horizontal speed, as on a treadmill."""
    drift = motion.root_positions_m[-1] - motion.root_positions_m[0]
    drift[1] = 0.0
    passed = np.linspace(0.0, 1.0, motion.frames)[:, None]
    return replace(motion, root_positions_m=motion.root_positions_m - passed * drift)
