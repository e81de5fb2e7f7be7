"""Cameras calibrated by a person who walks, or by waved markers, against the true cameras of simulated rooms."""

import logging
import re

import numpy as np
import pytest
from perfanim.core.errors import CalibrationError
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.vision.calibration.calibrate_moving import calibrate_with_markers, calibrate_with_person
from perfanim.core.vision.calibration.moving_fit import usual_camera
from walked_rooms import (
    ERRORS,
    FPS,
    POINTS,
    angles_and_distances,
    by_board,
    height_m,
    marker_frames,
    middle_error_m,
    middle_of_the_room,
    person_frames,
    room,
    walk,
    waved,
)

NOISE_PX = 0.3
LOG = logging.getLogger(__name__)  # `pytest --log-cli-level=INFO` shows the figures
# walks of people on whom no setting was chosen, and seconds of each
WALKS = (("91_01", 23.0), ("91_04", 18.0), ("29_01", 11.0), ("91_17", 13.0))
KNOWN, FREE = np.zeros(2, dtype=bool), np.ones(2, dtype=bool)


@pytest.fixture(scope="module")
def standing():
    """Points of a person who stands still for 3 s."""
    pose = np.random.default_rng(0).normal((0.0, 1.0, 0.0), 0.3, (1, len(POINTS), 3))
    return np.repeat(pose, 90, axis=0)


def across_the_room(points_m):
    return points_m + np.linspace(-1.0, 1.0, len(points_m))[:, None, None] * [1.0, 0.0, 0.3]


@pytest.mark.parametrize("seed", [11, 12])
def test_a_waved_marker_places_three_cameras(seed):
    cameras = room(seed, 3)
    apart_m = float(np.linalg.norm(cameras[0].centre_m - cameras[1].centre_m))
    frames = marker_frames(cameras, waved(20.0, seed), NOISE_PX, seed)
    found = calibrate_with_markers(cameras, np.zeros(3, dtype=bool), frames, apart_m=apart_m)
    angles_deg, distances = angles_and_distances(found.result.rig.cameras, cameras)
    LOG.info("marker %s: angles %s deg, distances %s", seed, angles_deg.round(3), distances.round(4))
    assert angles_deg.max() < 0.1 and np.abs(distances).max() < 0.003
    assert found.accuracy.angle_sigma_deg < 0.1 and not found.has_floor


@pytest.mark.long
@pytest.mark.parametrize("seed", [13, 14])
def test_a_waved_stick_gives_the_scale(seed):
    cameras = room(seed)
    frames = marker_frames(cameras, waved(20.0, seed, markers=2), NOISE_PX, seed)
    found = calibrate_with_markers(cameras, KNOWN, frames, stick_m=0.5)
    angles_deg, distances = angles_and_distances(found.result.rig.cameras, cameras)
    LOG.info("stick %s: angle %s deg, distance %s", seed, angles_deg.round(3), distances.round(4))
    assert angles_deg.max() < 0.1 and np.abs(distances).max() < 0.003


@pytest.mark.long
def test_cameras_side_by_side_are_told():
    cameras = room(1, apart_deg=(2.0, 3.0))
    with pytest.raises(CalibrationError, match=r"side by side.*put them 60 to 110 degrees apart"):
        calibrate_with_markers(cameras, KNOWN, marker_frames(cameras, waved(10.0, 1), NOISE_PX), apart_m=0.2)


def test_a_camera_without_a_person_is_told(standing):
    cameras = room(2)
    frames = [
        MarkerFrame(each.number, each.time_s, blobs=(each.blobs[0], np.empty((0, 5), dtype=np.float32)))
        for each in person_frames(cameras, across_the_room(standing))
    ]
    with pytest.raises(CalibrationError, match="nobody was found in the pictures of cam2; walk about for 20 s"):
        calibrate_with_person(cameras, KNOWN, frames, POINTS)


def test_too_few_moments_are_told(standing):
    cameras = room(2)
    frames = person_frames(cameras, across_the_room(standing))[:20]
    with pytest.raises(CalibrationError, match=r"saw the person together at only 20 moments, within 0.6 s; walk"):
        calibrate_with_person(cameras, KNOWN, frames, POINTS)


def test_a_person_who_stands_still_is_told(standing):
    cameras = room(2)
    with pytest.raises(CalibrationError, match="the person stays in one place; walk about"):
        calibrate_with_person(cameras, KNOWN, person_frames(cameras, standing), POINTS)


def test_films_out_of_step_are_told():
    cameras, late = room(15), 15
    points_m = waved(12.0, 15)
    frames, after = marker_frames(cameras, points_m, NOISE_PX), marker_frames(cameras, points_m, NOISE_PX, 1)
    shown = [
        MarkerFrame(n, n / FPS, blobs=(frames[n].blobs[0], after[max(n - late, 0)].blobs[1]))
        for n in range(len(frames))
    ]
    with pytest.raises(CalibrationError, match=r"cam2 are about 0.5 s behind those of cam1; start both"):
        calibrate_with_markers(cameras, KNOWN, shown, apart_m=3.0)


@pytest.mark.long
@pytest.mark.parametrize("is_free", [KNOWN, FREE], ids=["known", "unknown"])
@pytest.mark.parametrize(("trial", "seconds"), WALKS)
def test_a_walk_calibrates(cmu_dir, trial, seconds, is_free):
    motion, seed = read_motion(next(cmu_dir.rglob(f"{trial}.amc"))), 100 + int(trial[-2:])
    cameras, points_m = room(seed), walk(motion, seconds, seed)
    start = [usual_camera(each.name, each.image_size) for each in cameras] if is_free[0] else cameras
    found = calibrate_with_person(start, is_free, person_frames(cameras, points_m, seed), POINTS, height_m(motion))
    rig = found.result.rig
    angles_deg, distances = angles_and_distances(rig.cameras, cameras)
    people = middle_of_the_room(cameras, ERRORS.slow_m, seed)
    exact = middle_of_the_room(cameras, 0.0, seed)
    board = by_board(cameras, seed)
    with_m, board_m = (middle_error_m(each, cameras, *people) for each in (rig.cameras, board))
    own_mm, board_mm = (1e3 * middle_error_m(each, cameras, *exact) for each in (rig.cameras, board))
    focal = [100.0 * (one.focal_px / true.focal_px - 1.0) for one, true in zip(rig.cameras, cameras, strict=True)]
    told = found.accuracy
    LOG.info(
        f"{trial} {'unknown' if is_free[0] else 'known'} lens: angle {angles_deg[0]:.2f} deg (sigma "
        f"{told.angle_sigma_deg:.2f}), distance {100 * distances[0]:+.1f} % (sigma {100 * told.distance_sigma:.1f}), "
        f"focal {np.round(focal, 1)} % (sigma {np.round(100 * told.focal_sigmas, 1)}), people in the middle "
        f"{1e3 * with_m:.1f} mm, by board {1e3 * board_m:.1f}; the calibration {own_mm:.1f}, by board {board_mm:.1f}; "
        f"floor {found.has_floor}, up {np.degrees(np.arccos(up_of(rig.cameras[0], cameras[0]))):.1f} deg; "
        f"{found.result.verdict}"
    )
    assert angles_deg[0] < 3.0 * told.angle_sigma_deg
    assert abs(distances[0]) < 3.0 * told.distance_sigma
    assert with_m < 1.3 * board_m


@pytest.mark.long
@pytest.mark.parametrize("seed", [301, 302])
def test_a_minute_of_walking_determines_the_angle(cmu_dir, seed):
    random, parts = np.random.default_rng(seed), []
    for trial, seconds in (("91_01", 23.0), ("91_04", 18.0), ("91_17", 13.0), ("91_02", 14.0)):
        motion = read_motion(next(cmu_dir.rglob(f"{trial}.amc")))
        turn = rot.to_matrix(rot.from_rotation_vector(np.array([0.0, random.uniform(0.0, 2.0 * np.pi), 0.0])))
        parts.append(walk(motion, seconds, seed) @ turn.T)
    cameras = room(seed)
    frames = person_frames(cameras, np.concatenate(parts), seed)
    found = calibrate_with_person(cameras, KNOWN, frames, POINTS, height_m(motion))
    angles_deg, distances = angles_and_distances(found.result.rig.cameras, cameras)
    LOG.info("a minute, %s: angle %s deg, distance %s", seed, angles_deg.round(2), distances.round(3))
    assert angles_deg[0] < 0.3 and abs(distances[0]) < 3.0 * found.accuracy.distance_sigma
    assert found.result.verdict == "good"


@pytest.mark.long
@pytest.mark.parametrize("late", [15, -9])
def test_films_of_a_walk_out_of_step_are_told(cmu_dir, late):
    points_m = walk(read_motion(next(cmu_dir.rglob("09_12.amc"))), 14.0)
    cameras, (behind, ahead) = room(16), ("cam2", "cam1") if late > 0 else ("cam1", "cam2")
    frames = person_frames(cameras, points_m, late={int(late > 0): abs(late)})
    with pytest.raises(
        CalibrationError, match=rf"{behind} are about .* s behind those of {ahead}; start both"
    ) as error:
        calibrate_with_person(cameras, KNOWN, frames, POINTS)
    told_s = float(re.findall(r"about ([0-9.]+) s", str(error.value))[0])
    assert told_s == pytest.approx(abs(late) / FPS, abs=0.11)  # compared in steps of 0.1 s


def up_of(found, true) -> float:
    """Cosine between the found and the true direction upwards, in the camera."""
    return float(found.rotation[:, 1] @ true.rotation[:, 1])
