"""A person without markers, followed live by two cameras.

Processor time by stage, and the distance of the joints from those by all cameras together.
"""

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from perfanim.core.api.solving import solve
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.database.store import Database, open_database
from perfanim.core.geometry.arrays import Array
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.geometry.rig_file import load_rig
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.session.session import Session
from perfanim.core.vision.people.body_network import BlazePose
from perfanim.core.vision.people.network_file import body_network_file
from perfanim.core.vision.people.people_pipeline import PeoplePipeline, PersonLocator
from perfanim.core.vision.sources.source_kinds import open_image_source
from perfanim.core.vision.tracked_take import labelled_take, relocate

from .run import Run

_PAIRS = ((0, 3), (2, 3))  # cameras 108 and 68 degrees apart
_FPS, _KEPT = 60.0, 2  # rate of the films; every second picture is looked at
_WARM = 5  # moments that are not measured
_LAPTOP_MS = 6.3  # published for the network on an i7-12700K, run by OpenCV
_POINTS = load_marker_set(BlazePose.marker_set)


def people(run: Run) -> dict[str, Any]:
    """Follow a person as a live capture at 30 Hz does, in one thread.

    Returns:
        rows (cameras, joints' distances, median processor time), and of this machine, and of a laptop that is quicker
        in the network alone: cores (how many two cameras keep busy) and latency_ms (from the pictures to the pose, if
        the pictures are looked at beside each other).
    """
    cv2.setNumThreads(1)
    rig, network = load_rig(run.data / "Calib.qca.txt"), BlazePose(body_network_file())
    pipeline, database = PeoplePipeline(rig, [network] * len(rig)), open_database(run.embedded().path)
    frames, spent_s = [], []
    for images in open_image_source(*(str(run.data / f"{camera.name}.mp4") for camera in rig.cameras)):
        before_s = time.process_time()
        frames.append(pipeline.detect(images))
        spent_s.append((time.process_time() - before_s) / len(rig))
    found_ms = 1e3 * float(np.median(spent_s[_WARM:]))
    motion = solve(labelled_take(relocate(rig, frames), _POINTS.names, "person", _FPS, rig), database=database).motion
    joints_m = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)[0][::_KEPT]
    rows = [_live(rig, frames[::_KEPT], pair, database, joints_m) for pair in _PAIRS]
    rest_ms = float(np.mean([row["located_ms"] + row["solved_ms"] for row in rows]))
    rate = _FPS / _KEPT / 1e3
    figures = {
        "found_in_a_picture_ms": found_ms,
        "cores": rate * (2 * found_ms + rest_ms),
        "latency_ms": found_ms + rest_ms,
        "laptop_cores": rate * (2 * _LAPTOP_MS + rest_ms),
        "laptop_latency_ms": _LAPTOP_MS + rest_ms,
    }
    found = {"rows": rows} | {name: round(value, 2) for name, value in figures.items()}
    return run.write("people", found, {"": rows})


def _live(
    rig: CameraRig, frames: Sequence[MarkerFrame], pair: tuple[int, int], database: Database, joints_m: Array
) -> dict[str, Any]:
    """Return the row of two cameras, with a body of average size; each frame is solved from earlier ones only."""
    some = CameraRig(tuple(rig.cameras[camera] for camera in pair), rig.metadata)
    locator = PersonLocator(some, _POINTS)
    subject = Subject("Performer", default_skeleton(), _POINTS)
    session, poses, moments_s = Session(subject, database, some), [], []
    for frame in frames:
        blobs = tuple(frame.blobs[camera] for camera in pair)
        seen = replace(frame, blobs=blobs, detected=blobs, camera_times_s=frame.camera_times_s[list(pair)])
        seen = replace(seen, point_blobs=np.empty((0, 0), dtype=np.int64))
        begun_s = time.process_time()
        located = locator.locate(seen)
        located_s = time.process_time()
        poses.append(session.step(located))
        moments_s.append((begun_s, located_s, time.process_time()))
    located_ms, solved_ms = np.median(1e3 * np.diff(moments_s[_WARM:], axis=1), axis=0).tolist()
    rotations, roots_m = (
        np.array([pose.rotations for pose in poses]),
        np.array([pose.root_position_m for pose in poses]),
    )
    away_mm = 1e3 * np.linalg.norm(forward_kinematics(subject.skeleton, rotations, roots_m)[0] - joints_m, axis=-1)
    return {
        "cameras": " ".join(camera.name for camera in some.cameras),
        "joints_median_mm": round(float(np.median(away_mm)), 1),
        "joints_p90_mm": round(float(np.percentile(away_mm, 90.0)), 1),
        "located_ms": round(located_ms, 1),
        "solved_ms": round(solved_ms, 1),
    }
