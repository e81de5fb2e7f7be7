"""The job that calibrates live cameras by a person who walks about, with replaced networks and played pictures."""

import threading
from dataclasses import replace
from itertools import cycle
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from filmed_people import moments, networks
from perfanim.core.errors import CalibrationError
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.geometry.rig_file import rig_from
from perfanim.core.simulate.shipped_performance import performance
from perfanim.core.vision.sources.source_requests import ImageFiles
from perfanim.core.worker.channel import Stopped
from perfanim.core.worker.jobs import person_pipeline, record_walk
from perfanim.core.worker.requests import RecordWalkRequest, read_request
from walked_rooms import angles_and_distances, height_m, room, walk

FPS, SECONDS = 10.0, 8.0
SIDES = ("left", "right")


@pytest.fixture(scope="module")
def walked():
    """Cameras, and a person's exact points for longer than is recorded."""
    motion = performance("walking", 2.0 + SECONDS + 2.0)
    return room(21), walk(motion, 12.0, fps=FPS)[round(2.0 * FPS) :], height_m(motion)


@pytest.fixture
def asked(walked, tmp_path, monkeypatch):
    """asked(**changes) -> the request, for pictures that the replaced networks know."""
    cameras, points_m, height = walked
    rig = CameraRig(tuple(cameras))
    for images in moments(rig, len(points_m), FPS):
        for side, image in zip(SIDES, images.images, strict=True):
            (tmp_path / side).mkdir(exist_ok=True)
            assert cv2.imwrite(str(tmp_path / side / f"{images.number:03d}.png"), image)
    following = cycle(networks(rig, points_m))
    monkeypatch.setattr(person_pipeline, "BlazePose", lambda _path: next(following))
    source = ImageFiles(tuple(str(tmp_path / side) for side in SIDES), fps=FPS)
    return lambda **changes: RecordWalkRequest(
        **{"source": source, "people": "network", "height_m": height, "seconds": SECONDS} | changes
    )


def run(request, *, is_stopped=False):
    """Return the texts of a job's state, its pictures and its results."""
    sent = SimpleNamespace(said=[], pictures=[], results=[])
    stop = threading.Event()
    if is_stopped:
        stop.set()
    channel = SimpleNamespace(
        stop_requested=stop,
        send_preview=sent.pictures.append,
        send_status=lambda text, *_, **__: sent.said.append(text),
        send_result=sent.results.append,
    )
    record_walk.run(read_request("record walk", request.to_json()), channel)
    return sent


@pytest.mark.long
def test_unknown_lenses_and_poses_are_found_from_the_first_seconds(asked, walked):
    cameras, _, _ = walked
    sent = run(asked())
    (result,) = sent.results
    found = rig_from(result["rig"], "result")
    angles_deg, distances = angles_and_distances(found.cameras, cameras)
    assert [camera.name for camera in found.cameras] == list(SIDES)
    assert angles_deg.max() < 1.0 and np.abs(distances).max() < 0.03
    assert result["floor"] and found.metadata["by"] == "person"
    assert f"the recording shows {SECONDS:.0f} s of motion" in "; ".join(result["advice"])  # not all that was played
    assert sent.said[0] == "opening the cameras" and sent.said[-1] == "calibrating"
    assert "walk about and turn, through the whole space" in sent.said and sent.pictures


def test_known_lenses_are_kept(asked, walked):
    cameras, _, _ = walked
    known = CameraRig(tuple(replace(each, name=side) for each, side in zip(cameras, SIDES, strict=True)))
    (result,) = run(asked(rig=known)).results
    for camera, true in zip(rig_from(result["rig"], "result").cameras, cameras, strict=True):
        np.testing.assert_allclose(camera.matrix, true.matrix)
        np.testing.assert_allclose(camera.distortion, true.distortion)


def test_too_short_a_walk_is_told(asked):
    with pytest.raises(CalibrationError, match=r"saw the person together at only 15 moments, within 1.4 s; walk about"):
        run(asked(seconds=1.5))


def test_a_stop_leaves_no_result(asked):
    with pytest.raises(Stopped):
        run(asked(), is_stopped=True)
