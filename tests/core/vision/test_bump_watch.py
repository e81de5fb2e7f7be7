from dataclasses import replace

import numpy as np
import pytest
from futures import at_once
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.vision.bump_watch import BumpDetector, meeting_error_px
from perfanim.core.vision.pipeline import MarkerPipeline

RATE = 30.0
NOISE_PX = 0.3  # what unsynchronised cameras leave over


def turned(rig: CameraRig, degrees: tuple[float, float, float]) -> CameraRig:
    left, right = rig.cameras
    rotation = rot.to_matrix(rot.from_rotation_vector(np.radians(degrees))) @ right.rotation
    return CameraRig((left, replace(right, rotation=rotation, translation_m=-rotation @ right.centre_m)))


def told(calibrated: CameraRig, standing, seconds: float, clutter: int = 0) -> list[tuple[float, str]]:
    """What is said, and when, while six markers wander; `standing(t)` is where the cameras really are."""
    rng = np.random.default_rng(3)
    pipeline, watch = MarkerPipeline(calibrated), BumpDetector(calibrated, at_once)
    starts, speeds = rng.uniform(-0.4, 0.4, (6, 3)), rng.uniform(0.5, 2.0, (6, 3))
    reflections = rng.uniform(20, 460, (2, clutter, 2))
    said = []
    for number in range(round(seconds * RATE)):
        time_s = number / RATE
        points = starts + 0.3 * np.sin(speeds * time_s + 5 * starts) + [0.0, 0.0, -2.2]
        blobs = []
        for index, camera in enumerate(standing(time_s).cameras):
            pixels = np.concatenate((camera.project(points), reflections[index])) + rng.normal(0, NOISE_PX, (1, 2))
            rows = np.full((len(pixels), 5), (0.0, 0.0, 3.0, 200.0, 20.0), dtype=np.float32)
            rows[:, :2] = pixels
            blobs.append(rows)
        seen = MarkerFrame(number, time_s, blobs=tuple(blobs), camera_times_s=np.array([time_s, time_s]))
        text = watch.update(pipeline.locate(seen), pipeline.last_errors_px)
        said += [(time_s, text)] if text else []
    return said


@pytest.mark.parametrize("degrees", [(0.6, 0.0, 0.0), (1.5, 2.0, 1.0)])
def test_bumped_camera_is_reported_once(rig, degrees):
    now = turned(rig, degrees)
    ((time_s, text),) = told(rig, lambda t: rig if t < 2.0 else now, 9.0)
    assert 2.0 < time_s < 9.0
    assert "calibrate the cameras again" in text
    assert float(text.split("about ")[1].split()[0]) == pytest.approx(float(np.linalg.norm(degrees)), rel=0.3)


def test_still_cameras_and_reflections_are_not_reported(rig):
    assert told(rig, lambda t: rig, 6.0) == []
    assert told(rig, lambda t: rig, 6.0, clutter=8) == []


def test_blob_without_a_partner_has_the_largest_error():
    blobs = tuple(np.zeros((count, 5), dtype=np.float32) for count in (5, 8))
    errors = np.array([[0.5, 0.5], [0.3, 0.3], [0.4, 0.4]])
    assert meeting_error_px(blobs, errors) == pytest.approx((0.5 + 0.3 + 0.4 + 2 * 4.0) / 5)
    assert meeting_error_px((blobs[0][:3], blobs[1]), errors) is None
