"""Films of a person that were not started together: when each began, and their points at the same moments."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.errors import CaptureError
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.vision.people.person_clocks import at_one_time, person_offsets, synchronise_person
from perfanim.core.vision.tracked_take import relocate
from walked_rooms import OTHERS, POINTS, film_frames, room, walk

LOG = logging.getLogger(__name__)  # `pytest --log-cli-level=INFO` shows the figures
HALF_A_PICTURE_S = 0.5 / 30.0
LATE_S, RATES = 0.87, (30.0, 25.0)
CUT = 13  # number of pictures that are cut off the beam's second film
# takes on which no setting was chosen
MOVED = ("91_01", "91_04", "86_01", "14_14", "29_02", "13_31", "127_02", "135_02")
PAIRS = (("91_01", "91_04"), ("14_07", "14_08"), ("29_02", "29_07"), ("13_31", "14_14"), ("135_02", "135_03"))


@pytest.fixture(scope="module")
def walked(cmu_dir):
    """walked("91_01") -> true points (F, K, 3) of a take, 30 a second, and the same with the rates of both films."""
    known = {}

    def points(trial):
        if trial not in known:
            motion = read_motion(cmu_dir / trial[: trial.index("_")] / f"{trial}.amc")
            known[trial] = motion.fps, walk(motion, 20.0, fps=motion.fps)
        return known[trial]

    return points


def films(cameras, taken, seed, *, late_s=LATE_S, rates=RATES, exact=False):
    """Return the frames of films of takes (fps, points), of which the second begins later and has another rate."""
    starts_s = (0.0, late_s)
    return [
        frame
        for number, (camera, (fps, points_m)) in enumerate(zip(cameras, taken, strict=True))
        for frame in film_frames(
            camera, number, points_m, fps, starts_s[number], rates[number], None if exact else seed + number
        )
    ]


@pytest.mark.long
@pytest.mark.parametrize("placed", [True, False])
@pytest.mark.parametrize("trial", MOVED)
def test_the_offset_is_found_within_half_a_picture(walked, trial, placed):
    cameras = room(41)
    found = person_offsets(cameras, films(cameras, [walked(trial)] * 2, 7), POINTS, placed=placed)[1]
    off_ms = 1e3 * (found.offset_s - LATE_S)
    LOG.info("%s, poses known %s: off by %.0f ms, sigma %.0f ms", trial, placed, off_ms, 1e3 * found.sigma_s)
    assert found.is_found and abs(found.offset_s - LATE_S) < HALF_A_PICTURE_S


@pytest.mark.long
@pytest.mark.parametrize("trial", MOVED[:3])
def test_points_are_as_good_as_with_the_true_offset(walked, trial):
    cameras = room(41)
    fps, points_m = walked(trial)
    frames = films(cameras, [walked(trial)] * 2, 7)
    found = person_offsets(cameras, frames, POINTS, placed=True)[1].offset_s
    usual_m = []
    for offset_s in (found, LATE_S):
        moments = at_one_time(cameras, frames, POINTS, (0.0, offset_s))
        away_m = []
        for frame in relocate(CameraRig(tuple(cameras)), moments):
            at = round((frame.time_s + offset_s) * fps)  # in the time of the first film, which has all of the motion
            away_m.append(np.linalg.norm(frame.points_m - points_m[at][frame.labels], axis=1))
        usual_m.append(float(np.median(np.concatenate(away_m))))
    LOG.info("%s: points off by %.1f mm, with the true offset %.1f mm", trial, *(1e3 * each for each in usual_m))
    assert usual_m[0] < 1.02 * usual_m[1]


@pytest.mark.long
@pytest.mark.parametrize("pair", PAIRS)
def test_different_takes_are_told(walked, pair):
    cameras = room(42)
    frames = films(cameras, [walked(trial) for trial in pair], 9)
    with pytest.raises(CaptureError, match="when cam2 began to film cannot be told from the motion that cam1 shows"):
        synchronise_person(cameras, frames, POINTS, placed=True)


@pytest.mark.parametrize("placed", [True, False])
def test_a_person_who_stands_still_is_told(placed):
    cameras = room(43)
    pose = np.random.default_rng(0).normal((0.0, 1.0, 0.0), 0.3, (1, len(POINTS), 3))
    frames = films(cameras, [(30.0, np.repeat(pose, 180, axis=0))] * 2, 5, late_s=0.5)
    with pytest.raises(CaptureError, match="give films of the same motion in which the person walks about"):
        synchronise_person(cameras, frames, POINTS, placed=placed)


def test_a_film_of_nobody_has_no_offset(truth_points):
    cameras = room(44)
    frames = [each for each in films(cameras, [truth_points] * 2, 3) if np.isfinite(each.camera_times_s[0])]
    assert not person_offsets(cameras, frames, POINTS, placed=True)[1].is_found


@pytest.mark.long
@pytest.mark.parametrize("placed", [True, False])
@pytest.mark.parametrize(("pair", "is_told"), [((0, 2), False), ((0, 3), False), ((1, 2), True), ((1, 3), True)])
def test_a_second_and_a_half_of_a_man_on_a_beam_suffices_or_is_told(beam, pair, is_told, placed):
    """The second camera's film lacks the first 13 pictures, and every other one of the rest."""
    rig, seen = beam
    cameras, nobody = [rig.cameras[camera] for camera in pair], np.empty((0, 5), dtype=np.float32)
    frames = []
    for frame in seen:
        own, other = (frame.blobs[camera] for camera in pair)
        frames.append(MarkerFrame(0, 0.0, blobs=(own, nobody), camera_times_s=np.array([frame.time_s, np.nan])))
        if frame.number >= CUT and (frame.number - CUT) % 2 == 0:
            late_s = np.array([np.nan, frame.time_s - seen[CUT].time_s])
            frames.append(MarkerFrame(0, 0.0, blobs=(nobody, other), camera_times_s=late_s))
    found = person_offsets(cameras, frames, POINTS, placed=placed)[1]
    LOG.info("beam %s, poses known %s: %s", pair, placed, found)
    assert found.is_found != is_told
    if found.is_found:
        assert abs(found.offset_s - seen[CUT].time_s) < HALF_A_PICTURE_S


@pytest.fixture(scope="module")
def truth_points(truth):
    """Frame rate and true points of a simulated performer, in the middle of the room."""
    return truth.fps, walk(truth, 12.0, fps=truth.fps)


def test_points_of_two_films_meet_at_one_time(truth_points):
    cameras = room(45)
    fps, points_m = truth_points
    frames = films(cameras, [truth_points] * 2, 3, exact=True)
    moved = at_one_time(cameras, frames, POINTS, (0.0, LATE_S))
    assert [frame.number for frame in moved] == list(range(len(moved)))
    np.testing.assert_allclose(np.diff([frame.time_s for frame in moved]), 1.0 / RATES[1])  # of the slower one
    for frame in moved:
        at = (frame.time_s + LATE_S) * fps
        true = (1.0 - at % 1.0) * points_m[int(at)] + at % 1.0 * points_m[int(at) + 1]
        for camera, rows in zip(cameras, frame.blobs, strict=True):
            assert np.median(np.linalg.norm(rows[:, :2] - camera.project(true), axis=1)) < 0.5


def test_sides_that_change_between_two_pictures_are_not_mixed(truth_points):
    cameras = room(45)
    frames = films(cameras, [truth_points] * 2, 3, exact=True)
    whole = at_one_time(cameras, frames, POINTS, (0.0, LATE_S))
    sides = np.where(OTHERS >= 0, OTHERS, np.arange(len(POINTS)))
    changed = [
        replace(each, blobs=(each.blobs[0][sides], each.blobs[1]), detected=())
        if each.number % 7 < 3 and len(each.blobs[0])
        else each
        for each in frames
    ]
    limbs = [row for row, name in enumerate(POINTS.names) if name.endswith(("elbow", "wrist", "knee", "ankle"))]
    for frame, expected in zip(at_one_time(cameras, changed, POINTS, (0.0, LATE_S)), whole, strict=True):
        rows = expected.blobs[0][:, :2]
        own, exchanged = (np.abs(frame.blobs[0][limbs, :2] - each[limbs]).max(axis=1) for each in (rows, rows[sides]))
        assert np.minimum(own, exchanged).max() < 1e-3
