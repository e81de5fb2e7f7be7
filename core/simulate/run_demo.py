"""Demo: simulated performer, cameras, calibration, tracking, solving and report.

The ground truth is only used to measure the result.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..body.calibration_poses import CALIBRATION
from ..body.motion import Motion, sliced
from ..body.motion_metrics import evaluate
from ..body.scene_pose import PerformerPose
from ..database.build_database import build_database
from ..database.store import Database, open_database
from ..formats.motion.bvh import write_bvh
from ..geometry.arrays import Array, Image
from ..geometry.camera import CameraRig
from ..geometry.rig_file import save_rig
from ..markers.marker_frame import MarkerFrame
from ..markers.marker_set import load_marker_set
from ..markers.source_noise import noise_of
from ..markers.subject import Subject, save_subject
from ..session.delayed_poses import calm_performer
from ..session.session import Session
from ..session.steady_motion import motion_of
from ..solver.settings import SolveSettings
from ..subjects.from_recording import subject_from_recording
from ..subjects.prototype_bodies import load_bodies
from ..system.assets import MOTION
from ..system.files import atomic_path
from ..system.progress import Progress
from ..vision.pipeline import MarkerPipeline
from .calibrated_studio import calibrate_studio, studio_on_floor
from .preview import (
    TRUTH,
    CharacterPainter,
    brightened,
    draw_caption,
    draw_detections,
    floor_image,
    preview_camera,
    side_by_side,
    write_contact_sheet,
)
from .shipped_performance import DEMO, T_POSE_S
from .shipped_performance import performance as play
from .studio.render import Renderer
from .studio.simulated_source import SimulatedSource, simulated_source
from .studio.stage_placement import with_poses
from .studio.studio_rig import default_rig
from .studio.video import write_video

MARKER_SET = "boxing"
_VIDEO_EVERY = 2  # the video shows every second frame
# calibration poses held before the performance, which itself contains only the T pose
_POSES_BEFORE = ("hanging", "motorcycle")
_FIGURES = (
    "deg_per_joint",
    "deg_per_angle",
    "mpjpe_mm",
    "mpjpe_absolute_mm",
    "bone_direction_deg",
    "twist_deg",
    "jitter_ratio",
    "foot_skate_cm_s",
    "worst_frames",
)


@dataclass(frozen=True)
class Recording:
    """Marker frames of the performance.

    Args:
        pictures: Images of the left camera for the preview, by frame.
        seconds: Time spent on tracking.
    """

    source: SimulatedSource
    rig: CameraRig
    frames: tuple[MarkerFrame, ...]
    pictures: dict[int, Image]
    seconds: float


def run_demo(out: Path, seconds: float, progress: Progress) -> dict[str, Any]:
    """Run the whole demo and write its results to the folder `out`.

    Returns:
        The report: figures, timings and the files written.
    """
    out.mkdir(parents=True, exist_ok=True)
    database = embedded_database(out / "embedded.pfdb", progress)
    performed = play(DEMO, seconds)  # begins in the T pose
    motion = with_poses(performed, _POSES_BEFORE, 1.0)
    before = motion.frames - performed.frames
    source = simulated_source(motion, MARKER_SET, Renderer(default_rig()))
    progress(0.05, "calibrating the cameras")
    calibration = calibrate_studio(source)
    rig = studio_on_floor(calibration.rig, source)
    recording = _record(source, rig, progress)
    progress(0.5, "calibrating the subject")
    subject = subject_from_recording(
        recording.frames[: before + round(T_POSE_S * source.fps)],
        source.fps,
        load_marker_set(MARKER_SET),
        load_bodies(),
        "simulated performer",
        CALIBRATION,
    ).subject
    poses, solve_seconds = _solve(recording, subject, database, progress)
    solved = motion_of(poses, subject, "demo", source.fps)
    truth = sliced(source.motion, 0, len(poses))
    outputs = _write(out, recording, subject, solved, truth, poses, progress)
    measures = evaluate(sliced(solved, before, len(poses)), sliced(truth, before, len(poses)))
    return {key: measures[key] for key in _FIGURES} | {
        "confidence": float(np.mean([pose.confidence for pose in poses[before:]])),
        "solve_ms_median": 1e3 * float(np.median(solve_seconds)),
        "solve_ms_p99": 1e3 * float(np.percentile(solve_seconds, 99)),
        "frames": len(poses),
        "frames_per_s": len(poses) / (recording.seconds + float(np.sum(solve_seconds))),
        "stereo_rms_px": calibration.stereo_rms_px,
        "subject_residual_mm": 1e3 * subject.residual_m,
        "outputs": outputs,
    }


def embedded_database(path: Path, progress: Progress) -> Database:
    """Build the database of the embedded motion, which takes about a second, and return it."""
    progress(0.0, "building the embedded motion database")
    build_database([MOTION], path)
    return open_database(path)


def _record(source: SimulatedSource, rig: CameraRig, progress: Progress) -> Recording:
    """Record and track the performance."""
    pipeline = MarkerPipeline(rig)
    pipeline.learn_empty(list(source.background_frames(60)))
    frames: list[MarkerFrame] = []
    pictures: dict[int, Image] = {}
    spent = 0.0
    for images in source:
        start = time.perf_counter()
        frames.append(pipeline.process(images))
        spent += time.perf_counter() - start
        if images.number % _VIDEO_EVERY == 0:
            pictures[images.number] = images.images[0]
        if images.number % 30 == 0:
            progress(0.1 + 0.4 * images.number / source.frames, "recording and tracking the performance")
    return Recording(source, rig, tuple(frames), pictures, spent)


def _solve(
    recording: Recording, subject: Subject, database: Database, progress: Progress
) -> tuple[list[PerformerPose], Array]:
    session = Session(subject, database, recording.rig, SolveSettings())
    poses, seconds = [], []
    for i, frame in enumerate(recording.frames):
        start = time.perf_counter()
        poses.append(session.step(frame))
        seconds.append(time.perf_counter() - start)
        if i % 30 == 0:
            progress(0.5 + 0.2 * i / len(recording.frames), "solving")
    return calm_performer(poses, noise_of(subject.marker_set.points)), np.array(seconds)


def _write(
    out: Path,
    recording: Recording,
    subject: Subject,
    solved: Motion,
    truth: Motion,
    poses: list[PerformerPose],
    progress: Progress,
) -> dict[str, str]:
    """Write motion, calibration and preview to files; return their paths by content."""
    files = {
        "motion": out / "demo.bvh",
        "truth": out / "truth.bvh",
        "cameras": out / "cameras.toml",
        "subject": out / "subject.toml",
        "video": out / "preview.mp4",
        "picture": out / "preview.png",
    }
    write_bvh(solved, files["motion"])
    write_bvh(truth, files["truth"])
    save_rig(recording.rig, files["cameras"])
    save_subject(subject, files["subject"])
    numbers = sorted(recording.pictures)
    shown = set(numbers[:: max(1, len(numbers) // 12)][:12])
    sheet: list[Image] = []

    def drawn() -> Iterator[Image]:
        for i, picture in enumerate(_previews(recording, subject, truth, poses)):
            if i % 30 == 0:
                progress(0.7 + 0.3 * i / len(numbers), "drawing the preview")
            if numbers[i] in shown:
                sheet.append(picture)
            yield picture

    write_video(files["video"], drawn(), recording.source.fps / _VIDEO_EVERY)
    write_contact_sheet(files["picture"], sheet, columns=2)
    return {name: str(path) for name, path in files.items()}


def _previews(recording: Recording, subject: Subject, truth: Motion, poses: list[PerformerPose]) -> Iterator[Image]:
    """Yield the left camera's images with detections, next to the solved pose."""
    camera = preview_camera(np.array([pose.root_position_m for pose in poses]))
    stage = floor_image(camera)
    solved_painter = CharacterPainter(camera, subject.skeleton)
    truth_painter = CharacterPainter(camera, truth.skeleton, TRUTH)
    for number, image in sorted(recording.pictures.items()):
        pose = poses[number]
        film = brightened(image)
        draw_detections(film, recording.frames[number].blobs[0][:, :2])
        draw_caption(film, "left camera", f"frame {number}")
        picture = stage.copy()
        solved_painter.draw(picture, pose.rotations, pose.root_position_m)
        truth_painter.draw(picture, truth.rotations[number], truth.root_positions_m[number])
        draw_caption(picture, "solved, truth in green", f"confidence {pose.confidence:.0%}")
        yield side_by_side(film, picture)


def write_report(path: Path, report: dict[str, Any]) -> None:
    """Write the report of `run_demo` as Markdown."""
    rows = [(key, value) for key, value in report.items() if isinstance(value, int | float)]
    lines = ["# Demo", "", "| figure | value |", "|---|---|"]
    lines += [f"| {key} | {value:.4g} |" for key, value in rows]
    lines += ["", "| file | |", "|---|---|"]
    lines += [f"| {name} | {Path(place).name} |" for name, place in report["outputs"].items()]
    with atomic_path(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
