"""A person without markers, followed by each two of four cameras, live and offline, and by one, compared with all four.

Errors, limbs on the other side, and the processor time of each stage.
"""

import time
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import cv2
import numpy as np
from perfanim.core.api.solving import SolveRequest, solve
from perfanim.core.body.body_size import girth_scale
from perfanim.core.body.motion import Motion
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import DEFAULT_HEIGHT_M, default_skeleton
from perfanim.core.database.store import Database, open_database
from perfanim.core.geometry.arrays import Array, runs
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.geometry.rig_file import load_rig
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.source_noise import noise_of
from perfanim.core.markers.subject import Subject
from perfanim.core.session.delayed_poses import calm_performer
from perfanim.core.session.session import Session
from perfanim.core.session.solved_take import SolvedTake
from perfanim.core.session.steady_motion import motion_of
from perfanim.core.vision.people.body_network import BlazePose
from perfanim.core.vision.people.network_file import body_network_file
from perfanim.core.vision.people.people_pipeline import PeoplePipeline, PersonLocator
from perfanim.core.vision.sources.source_kinds import open_image_source
from perfanim.core.vision.tracked_take import labelled_take, relocate

from .plots import Picture, check_plots, write_pictures
from .run import Run
from .scenarios import LIVE, OFFLINE
from .simulated_people import crossed_limbs

_FPS, _KEPT = 60.0, 2  # rate of the films; every second picture is looked at in a live capture of 30 Hz
# a foot stands while it moves more slowly than this, between moments so far apart, for so long; swinging feet move with
# 0.7 m/s and more, standing ones seem to with 0.1 to 0.3, by errors of the network
_STANDING_M_S, _APART_S, _STANCE_S = 0.5, 0.1, 0.2
_MOMENTS = (0.1, 0.35, 0.6, 0.85)  # positions in the films that are pictured, as shares
_ENDS = ("wrist", "foot"), ("toes",)  # joints that tremble, and that stand
_UNTIMED = {"located_ms": float("nan"), "solved_ms": float("nan")}
_WARM = 5  # moments that are not measured
_LAPTOP_MS = 6.3  # published for the network on an i7-12700K, run by OpenCV
_POINTS = load_marker_set(BlazePose.marker_set)


def people(run: Run) -> dict[str, Any]:
    """Follow a person with each pair of cameras: live, as a capture at 30 Hz does in one thread, and offline.

    Each single camera follows offline, too, with the height of the body that is fitted to the take of all.

    Returns:
        rows (cameras, angle between them, way; distances from the joints by all four; limbs on the other side;
        trembling: mean second difference of wrists and ankles; standing: RMS distance of standing toes from their mean
        place; median processor time), alone (camera; distances along and across its view, and about the root; mean
        confidence), found_in_a_picture_ms, and of this machine, and of a laptop that is quicker in
        the network alone: cores (how many two cameras keep busy) and latency_ms (from the pictures to the pose, if the
        pictures are looked at beside each other). Four moments of each row are pictured beside all four cameras' pose.
    """
    check_plots()
    cv2.setNumThreads(1)
    rig, network = load_rig(run.data / "Calib.qca.txt"), BlazePose(body_network_file())
    pipeline, database = PeoplePipeline(rig, [network] * len(rig)), open_database(run.embedded().path)
    frames, spent_s = [], []
    for images in open_image_source(*(str(run.data / f"{camera.name}.mp4") for camera in rig.cameras)):
        before_s = time.process_time()
        frames.append(pipeline.detect(images))
        spent_s.append((time.process_time() - before_s) / len(rig))
    found_ms = 1e3 * float(np.median(spent_s[_WARM:]))
    whole, rows, pictures = _offline(rig, frames, database).motion, [], []
    for pair in combinations(range(len(rig)), 2):
        some = CameraRig(tuple(rig.cameras[camera] for camera in pair), rig.metadata)
        seen = [_seen_by(frame, pair) for frame in frames]
        motion, times_ms = _live(some, seen[::_KEPT], database)
        for way, own, every in ((LIVE, motion, _KEPT), (OFFLINE, _offline(some, seen, database).motion, 1)):
            names, truth = " ".join(camera.name for camera in some.cameras), _every(whole, every)
            rows.append(
                {"cameras": names, "way": way} | _compared(own, truth, some) | (times_ms if way == LIVE else _UNTIMED)
            )
            moments = [int(share * own.frames) for share in _MOMENTS]
            pictures += [Picture.of(f"{names} {way}, frame {every * n}", truth, own, n) for n in moments]
    alone = [_alone(rig, camera, frames, database, whole) for camera in range(len(rig))]
    rest_ms = float(np.mean([sum(row[name] for name in _UNTIMED) for row in rows if row["way"] == LIVE]))
    rate = _FPS / _KEPT / 1e3
    figures = {
        "found_in_a_picture_ms": found_ms,
        "cores": rate * (2 * found_ms + rest_ms),
        "latency_ms": found_ms + rest_ms,
        "laptop_cores": rate * (2 * _LAPTOP_MS + rest_ms),
        "laptop_latency_ms": _LAPTOP_MS + rest_ms,
    }
    found = {"rows": rows, "alone": alone} | {name: round(value, 2) for name, value in figures.items()}
    return run.write("people", found, {"": rows, "alone": alone}, write_pictures(run.out / "people-strips", pictures))


def _every(motion: Motion, nth: int) -> Motion:
    """Return every n-th frame of a motion."""
    return replace(
        motion, fps=motion.fps / nth, rotations=motion.rotations[::nth], root_positions_m=motion.root_positions_m[::nth]
    )


def _seen_by(frame: MarkerFrame, some: tuple[int, ...]) -> MarkerFrame:
    """Return what some of the cameras show at a moment."""
    blobs, times_s = tuple(frame.blobs[camera] for camera in some), frame.camera_times_s[list(some)]
    bare = np.empty((0, 0), dtype=np.int64)
    return replace(frame, blobs=blobs, detected=blobs, camera_times_s=times_s, point_blobs=bare)


def _offline(
    rig: CameraRig, frames: Sequence[MarkerFrame], database: Database, height_m: float | None = None
) -> SolvedTake:
    """Return a whole take, solved with the body that is fitted to it."""
    take = labelled_take(relocate(rig, frames), _POINTS.names, "person", _FPS, rig)
    return solve(take, database=database, request=SolveRequest(height_m=height_m))


def _live(rig: CameraRig, frames: Sequence[MarkerFrame], database: Database) -> tuple[Motion, dict[str, float]]:
    """Return the motion of a body of average size as a capture shows it, two frames late, and times by stage."""
    locator, subject = PersonLocator(rig, _POINTS), Subject("Performer", default_skeleton(), _POINTS)
    session, poses, moments_s = Session(subject, database, rig), [], []
    for frame in frames:
        begun_s = time.process_time()
        located = locator.locate(frame)
        located_s = time.process_time()
        poses.append(session.step(located))
        moments_s.append((begun_s, located_s, time.process_time()))
    times_ms = np.median(1e3 * np.diff(moments_s[_WARM:], axis=1), axis=0).tolist()
    motion = motion_of(calm_performer(poses, noise_of(_POINTS.points)), subject, "person", _FPS / _KEPT)
    return motion, dict(zip(_UNTIMED, (round(each, 1) for each in times_ms), strict=True))


def _alone(
    rig: CameraRig, camera: int, frames: Sequence[MarkerFrame], database: Database, whole: Motion
) -> dict[str, Any]:
    """Return how the motion by a single camera differs from that by all of them."""
    some = CameraRig((rig.cameras[camera],), rig.metadata)
    height_m = DEFAULT_HEIGHT_M * girth_scale(whole.skeleton)
    solved = _offline(some, [_seen_by(frame, (camera,)) for frame in frames], database, height_m)
    own_m, whole_m = (
        forward_kinematics(each.skeleton, each.rotations, each.root_positions_m)[0] for each in (solved.motion, whole)
    )
    off_mm, view = 1e3 * (own_m - whole_m), whole_m - some.cameras[0].centre_m
    view /= np.linalg.norm(view, axis=-1, keepdims=True)
    along_mm = np.sum(off_mm * view, axis=-1)
    across_mm = np.linalg.norm(off_mm - along_mm[..., None] * view, axis=-1)
    about_mm = np.linalg.norm(off_mm - off_mm[:, :1], axis=-1)[:, 1:]
    return {
        "camera": some.cameras[0].name,
        "along_mm": round(float(np.median(np.abs(along_mm))), 1),
        "across_mm": round(float(np.median(across_mm)), 1),
        "about_root_mm": round(float(np.median(about_mm)), 1),
        "about_root_p90_mm": round(float(np.percentile(about_mm, 90.0)), 1),
        "crossed": int(crossed_limbs(solved.motion, whole).any(axis=1).sum()),
        "confidence": round(float(np.mean([pose.confidence for pose in solved.poses_of()])), 2),
    }


def _compared(motion: Motion, whole: Motion, rig: CameraRig) -> dict[str, Any]:
    """Return how a motion by two cameras differs from that by all of them."""
    own_m, whole_m = (
        forward_kinematics(each.skeleton, each.rotations, each.root_positions_m)[0] for each in (motion, whole)
    )
    away_mm = 1e3 * np.linalg.norm(own_m - whole_m, axis=-1)
    ends, toes = ([motion.skeleton.index(side + name) for side in "lr" for name in names] for names in _ENDS)
    towards = np.median(whole_m[:, 0], axis=0) - np.array([camera.centre_m for camera in rig.cameras])
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    crossed = crossed_limbs(motion, whole)
    return {
        "angle_deg": round(float(np.degrees(np.arccos(towards[0] @ towards[1])))),
        "joints_median_mm": round(float(np.median(away_mm)), 1),
        "joints_p90_mm": round(float(np.percentile(away_mm, 90.0)), 1),
        "frames": motion.frames,
        "exchanged": int(crossed.any(axis=1).sum()),
        "mirrored": int(crossed.all(axis=1).sum()),
        "trembling_mm": round(1e3 * float(np.linalg.norm(np.diff(own_m[:, ends], 2, axis=0), axis=-1).mean()), 1),
        "standing_mm": round(1e3 * _standing_m(own_m[:, toes], whole_m[:, toes], motion.fps), 1),
    }


def _standing_m(own_m: Array, whole_m: Array, fps: float) -> float:
    """Return the RMS distance of toes (F, 2, 3) from their mean places while those by all cameras stand still."""
    step = round(_APART_S * fps)
    slow = np.linalg.norm(whole_m[step:] - whole_m[:-step], axis=-1) < _STANDING_M_S * step / fps
    stances = [own_m[first:stop, foot] for foot in range(2) for first, stop in runs(slow[:, foot])]
    apart_m = [stance - stance.mean(axis=0) for stance in stances if len(stance) > _STANCE_S * fps]
    return float(np.sqrt(np.mean(np.sum(np.concatenate(apart_m) ** 2, axis=-1)))) if apart_m else float("nan")
