from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.errors import CalibrationError
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.vision.calibration.rig_refinement import refine_rig

NOISE_PX = 0.1


def marker_frames(rig: CameraRig, frames: int, markers: int, ghosts: int = 0, seed: int = 0) -> list[list[np.ndarray]]:
    """Blobs of markers that move about 2 m before the rig, with ghosts in each image at random."""
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(frames):
        points = np.column_stack(
            (rng.uniform(-0.5, 0.5, markers), rng.uniform(-0.5, 0.5, markers), rng.uniform(-2.8, -1.6, markers))
        )
        images = []
        for camera in rig.cameras:
            pixels = np.concatenate(
                (camera.project(points) + rng.normal(0, NOISE_PX, (markers, 2)), rng.uniform(0, 480, (ghosts, 2)))
            )
            blobs = np.zeros((len(pixels), 5), dtype=np.float32)
            blobs[:, :2], blobs[:, 2:] = pixels, (3.0, 200.0, 20.0)
            images.append(blobs[rng.permutation(len(blobs))])
        rows.append(images)
    return rows


def bumped(rig: CameraRig, index: int, turn_deg: tuple[float, float, float], shift_m: tuple[float, ...]) -> CameraRig:
    cameras = list(rig.cameras)
    camera = cameras[index]
    rotation = rot.to_matrix(rot.from_rotation_vector(np.radians(turn_deg))) @ camera.rotation
    centre = camera.centre_m + np.array(shift_m)
    cameras[index] = replace(camera, rotation=rotation, translation_m=-rotation @ centre)
    return replace(rig, cameras=tuple(cameras))


def angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip((np.trace(a @ b.T) - 1.0) / 2.0, -1.0, 1.0))))


@pytest.mark.parametrize(("markers", "ghosts"), [(1, 0), (6, 2)])
def test_bumped_camera_is_detected_and_placed(rig, markers, ghosts):
    now = bumped(rig, 1, (1.2, -0.8, 0.6), (0.0, 0.015, 0.01))
    result = refine_rig(rig, marker_frames(now, 240 // markers, markers, ghosts))
    assert result.bumped and result.before_px > 2.0
    # noise of two images, less the freedom of each point: the median of |n| with that deviation, ghosts apart
    assert result.after_px < 2.0 * NOISE_PX
    assert result.turned_deg[0] == 0.0 and result.turned_deg[1] == pytest.approx(1.56, abs=0.15)
    truth, found = now.cameras[1], result.rig.cameras[1]
    # 0.1 px of 620 is 0.01 degrees in one marker; toed-in cameras tell turns from shifts ten times worse
    assert angle_deg(found.rotation, truth.rotation) < 0.1
    np.testing.assert_allclose(found.centre_m, truth.centre_m, atol=0.005)
    assert result.rig.baseline_m() == pytest.approx(rig.baseline_m(), rel=1e-9)  # the scale is kept


def test_unmoved_cameras_stay(rig):
    result = refine_rig(rig, marker_frames(rig, 60, 5))
    assert not result.bumped and result.sure
    assert result.turned_deg[1] < 0.1 and result.moved_mm[1] < 5.0


def test_one_bumped_camera_of_three_is_placed(rig):
    left, right = rig.cameras
    third = replace(left, name="third", translation_m=left.translation_m + np.array([-0.4, 0.05, 0.0]))
    wide = CameraRig((left, right, third))
    now = bumped(wide, 2, (0.7, 0.7, 0.0), (0.01, 0.0, 0.0))
    result = refine_rig(wide, marker_frames(now, 60, 5))
    assert result.bumped
    assert angle_deg(result.rig.cameras[2].rotation, now.cameras[2].rotation) < 0.1
    assert result.turned_deg[1] < 0.1


def test_cameras_close_together_are_unsure(rig):
    left = rig.cameras[0]
    near = replace(left, name="near", translation_m=left.translation_m - left.rotation @ np.array([0.15, 0.0, 0.0]))
    close = replace(rig, cameras=(left, near))
    result = refine_rig(close, marker_frames(bumped(close, 1, (1.0, 0.5, 0.0), (0.0, 0.0, 0.0)), 60, 5))
    assert result.bumped and not result.sure


def test_too_few_markers_are_refused(rig):
    with pytest.raises(CalibrationError, match="at least 200 positions at 20 moments are needed"):
        refine_rig(rig, marker_frames(rig, 30, 2))
    with pytest.raises(CalibrationError, match="0 marker positions"):
        refine_rig(rig, [])
    with pytest.raises(CalibrationError, match="at least two cameras"):
        refine_rig(replace(rig, cameras=rig.cameras[:1]), [])
