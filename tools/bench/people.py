"""Processor time from pictures of a person without markers to poses, by stage, with two cameras at 30 Hz."""

import time
from typing import Any

import cv2
import numpy as np
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.database.store import open_database
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.geometry.rig_file import load_rig
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.session.session import Session
from perfanim.core.vision.people.body_network import BlazePose
from perfanim.core.vision.people.network_file import body_network_file
from perfanim.core.vision.people.people_pipeline import PeoplePipeline, PersonLocator
from perfanim.core.vision.sources.source_kinds import open_image_source

from .run import Run

CAMERAS = ("cam01", "cam04")  # 108 degrees apart
_FPS, _WARM = 30.0, 5  # rate that counts; pictures that are not measured
_STAGES = ("person found in both pictures", "points located", "solved")
_LAPTOP_MS = 6.3  # published for the network on an i7-12700K, run by OpenCV


def people(run: Run) -> dict[str, Any]:
    """Follow a person in two films as a live capture does, in one thread.

    Returns:
        rows (stage, median and 99 % of its processor time), and of this machine and of a laptop that is quicker in the
        network alone: cores (how many two cameras at 30 Hz keep busy) and latency_ms (from the pictures to the pose, if
        the pictures are looked at beside each other).
    """
    cv2.setNumThreads(1)
    whole = load_rig(run.data / "Calib.qca.txt")
    rig = CameraRig(tuple(camera for camera in whole.cameras if camera.name in CAMERAS), whole.metadata)
    pipeline = PeoplePipeline(rig, [BlazePose(body_network_file())] * len(rig))
    locator = PersonLocator(rig, load_marker_set(BlazePose.marker_set))
    subject = Subject("Performer", default_skeleton(), pipeline.points)
    session = Session(subject, open_database(run.embedded().path), rig)
    spent_s = []
    for images in open_image_source(*(str(run.data / f"{name}.mp4") for name in CAMERAS)):
        moments_s = [time.process_time()]
        frame = pipeline.detect(images)
        moments_s.append(time.process_time())
        frame = locator.locate(frame)
        moments_s.append(time.process_time())
        session.step(frame)
        spent_s.append(np.diff([*moments_s, time.process_time()]))
    milliseconds = 1e3 * np.array(spent_s[_WARM:])
    medians, most = np.median(milliseconds, axis=0), np.percentile(milliseconds, 99, axis=0)
    rows = [
        {"stage": stage, "median_ms": round(median, 1), "p99_ms": round(high, 1)}
        for stage, median, high in zip(_STAGES, medians.tolist(), most.tolist(), strict=True)
    ]
    found_ms, located_ms, solved_ms = medians.tolist()
    figures = {
        "cores": _FPS * (found_ms + located_ms + solved_ms) / 1e3,
        "latency_ms": found_ms / len(CAMERAS) + located_ms + solved_ms,
        "laptop_cores": _FPS * (len(CAMERAS) * _LAPTOP_MS + located_ms + solved_ms) / 1e3,
        "laptop_latency_ms": _LAPTOP_MS + located_ms + solved_ms,
    }
    found = {"rows": rows} | {name: round(value, 2) for name, value in figures.items()}
    return run.write("people", found, {"": rows})
