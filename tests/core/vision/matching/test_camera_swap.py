"""Images that do not belong to their cameras are named as what they are."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.camera import WORLD_FROM_CAMERA, Camera, CameraRig
from perfanim.core.vision.matching.camera_swap import CameraSwapDetector
from perfanim.core.vision.matching.stereo import Matches, StereoMatcher

SIZE = (640, 480)
MATRIX = np.array([[600.0, 0.0, 322.0], [0.0, 600.0, 236.0], [0.0, 0.0, 1.0]])


def two_cameras() -> CameraRig:
    """Cameras 1.2 m apart that are turned towards a place 3 m away."""
    cameras = []
    for name, x, turn in (("a", -0.6, -0.2), ("b", 0.6, 0.2)):
        rotation = rot.to_matrix(rot.from_rotation_vector(np.array([0.02 * x, turn, 0.0]))) @ WORLD_FROM_CAMERA
        cameras.append(Camera(name, SIZE, MATRIX, np.zeros(5), rotation, -rotation @ np.array([x, 1.2, 0.0])))
    return CameraRig(tuple(cameras))


def note_of(changed: object, frames: int = 40) -> str:
    """Return the last note for images changed by a function of their blobs."""
    rig = two_cameras()
    detector, matcher = CameraSwapDetector(rig), StereoMatcher(rig)
    generator, note = np.random.default_rng(4), ""
    for _ in range(frames):
        points = generator.uniform((-0.5, 0.4, -3.4), (0.5, 2.0, -2.6), (9, 3))
        blobs = []
        for camera in rig.cameras:
            rows = np.zeros((9, 5), dtype=np.float32)
            rows[:, :2] = camera.project(points) + generator.normal(0.0, 0.2, (9, 2))
            rows[:, 2:] = 30.0
            blobs.append(rows[generator.permutation(9)])
        blobs = changed(blobs)  # type: ignore[operator]
        found = detector.update(blobs, matcher.match(blobs, matcher.undistort(blobs), None))
        note = "" if found is None else found.note
    return note


def flip(rows: np.ndarray, axes: tuple[int, ...]) -> np.ndarray:
    out = rows.copy()
    for axis in axes:
        out[:, axis] = SIZE[axis] - 1 - out[:, axis]
    return out


@pytest.mark.parametrize(
    ("changed", "note"),
    [
        (lambda blobs: blobs, ""),
        (lambda blobs: blobs[::-1], "the left and the right camera seem to be exchanged"),
        (lambda blobs: [flip(blobs[0], (0,)), blobs[1]], "the images of camera a seem to be mirrored"),
        (lambda blobs: [blobs[0], flip(blobs[1], (0,))], "the images of camera b seem to be mirrored"),
        (lambda blobs: [flip(rows, (0,)) for rows in blobs], "the images of both cameras seem to be mirrored"),
        (lambda blobs: [blobs[0], flip(blobs[1], (0, 1))], "the images of camera b seem to be turned upside down"),
        (
            lambda blobs: [flip(rows, (0, 1)) for rows in blobs],
            "the images of both cameras seem to be turned upside down",
        ),
    ],
)
def test_the_mismatch_is_named(changed: object, note: str) -> None:
    assert note_of(changed) == note


def test_other_numbers_of_cameras_are_not_tested() -> None:
    rig = two_cameras()
    three = CameraRig((*rig.cameras, replace(rig.cameras[0], name="c")))
    blobs = [np.zeros((6, 5), dtype=np.float32)] * 3
    none = Matches(np.empty((0, 3)), np.empty((0, 3, 3)), np.empty((0, 3), dtype=np.int64), np.empty((0, 3)))
    detector = CameraSwapDetector(three)
    assert [detector.update(blobs, none) for _ in range(8)] == [None] * 8
