"""A prop found by its distances, followed, lost and found again, with and without images."""

import numpy as np
import pytest
from perfanim.core.geometry import rotations as rot
from perfanim.core.labelling.prop_tracking import PropTracker
from perfanim.core.markers.prop import Prop, load_prop
from props import FPS, Film, markers_of, swung

FRAMES = 90
# 0.1 pixel at 3.3 m and 540 pixels of focal length is 0.6 mm across and, 1.8 m apart, 1.6 mm in depth; five of these
PLACE_M = 0.008
TURN_DEG = 3.0  # the same at the guard, 15 cm from the blade
WITHOUT_IMAGES_M, WITHOUT_IMAGES_DEG = 0.008, 5.0  # 1 mm of noise on each coordinate, three points at least


@pytest.fixture(scope="module")
def sword():
    return load_prop("sword")


@pytest.fixture
def film(record):
    return Film(record)


def crowd(count, frames, seed=3):
    """Points (F, N, 3) of a performer about the prop, moving."""
    generator = np.random.default_rng(seed)
    homes = np.array([0.0, 1.0, 0.0]) + generator.uniform(-0.7, 0.7, (count, 3))
    t = np.arange(frames)[:, None, None] / FPS
    return homes + 0.1 * np.sin(generator.uniform(2.0, 6.0, (count, 3)) * t)


def off(pose, turn, place):
    return np.linalg.norm(pose.position_m - place), np.degrees(rot.angle_between(pose.rotation, turn))


@pytest.mark.parametrize("images", [True, False])
def test_a_prop_is_followed_among_a_performers_markers(sword, film, images):
    turns, places = swung(FRAMES)
    points = np.concatenate((markers_of(sword, turns, places), crowd(9, FRAMES)), axis=1)
    tracker = PropTracker(sword, film.rig.cameras if images else ())
    limits = (PLACE_M, TURN_DEG) if images else (WITHOUT_IMAGES_M, WITHOUT_IMAGES_DEG)
    for number, row in enumerate(points):
        frame = film(row, number, images=images)
        sighting = tracker.step(frame)
        assert sighting.pose.seen == 5
        assert np.all(np.array(off(sighting.pose, turns[number], places[number])) < limits)
        # what is left is the performer's, all of it and nothing else
        left = np.linalg.norm(sighting.rest.points_m[:, None] - row[None, 5:], axis=-1)
        assert sorted(left.argmin(axis=1)) == list(range(9))
        assert left.min(axis=1).max() < 0.01
        assert [len(blobs) for blobs in sighting.rest.blobs] == [9, 9] * images


def test_markers_that_one_camera_sees_count(sword, film):
    """Two markers are located, which tells no turn; with those that single cameras show it is known."""
    turns, places = swung(FRAMES)
    points = np.concatenate((markers_of(sword, turns, places), crowd(9, FRAMES)), axis=1)
    tracker = PropTracker(sword, film.rig.cameras)
    for number, row in enumerate(points):
        hidden = ((0, 0), (1, 1), (4, 0)) if number >= 20 else ()
        pose = tracker.step(film(row, number, hidden)).pose
        assert pose.found
        place_m, turn_deg = off(pose, turns[number], places[number])
        assert place_m < PLACE_M and turn_deg < TURN_DEG


@pytest.mark.parametrize("images", [True, False])
def test_a_prop_that_was_hidden_is_found_again_wherever_it_is(sword, film, images):
    turns, places = swung(FRAMES)
    places = places + np.where(np.arange(FRAMES) >= 60, 1.0, 0.0)[:, None] * np.array([-0.8, 0.1, -0.5])
    points = np.concatenate((markers_of(sword, turns, places), crowd(9, FRAMES)), axis=1)
    tracker = PropTracker(sword, film.rig.cameras if images else ())
    poses = []
    for number, row in enumerate(points):
        gone = 25 <= number < 60  # longer than it is held
        hidden = tuple((marker, -1) for marker in range(5)) if gone else ((3, -1),)
        sighting = tracker.step(film(row, number, hidden, images=images))
        poses.append(sighting.pose)
        assert sighting.pose.found == (not gone)
        if gone:  # it stands where it was seen last, and the performer loses nothing to it but for a moment
            np.testing.assert_array_equal(sighting.pose.position_m, poses[24].position_m)
            assert number < 25 + 0.1 * FPS + 1 or len(sighting.rest.points_m) == 9
        else:
            assert off(sighting.pose, turns[number], places[number])[0] < PLACE_M


def test_three_points_that_are_a_prop_by_chance_are_none_for_long(film):
    """Performers' markers come by a triangle's distances now and then, but do not keep them."""
    triangle = Prop("triangle", ("A", "B", "C"), np.array([[0.0, 0.0, 0.0], [0.30, 0.0, 0.0], [0.05, 0.20, 0.0]]))
    performer = crowd(9, FRAMES)
    meeting = FRAMES // 2
    performer[:, :3] += triangle.positions_m + np.array([0.1, 1.1, 0.2]) - performer[meeting, :3]
    tracker = PropTracker(triangle)
    taken = []
    for number, row in enumerate(performer):
        sighting = tracker.step(film(row, number, images=False))
        assert not sighting.pose.found
        taken.append(9 - len(sighting.rest.points_m))
    assert max(taken[meeting - 2 : meeting + 3]) == 3  # it was tried
    assert sum(count > 0 for count in taken) < 0.3 * FRAMES


def test_a_triangle_that_is_there_is_known_once_it_has_lasted(film):
    triangle = Prop("triangle", ("A", "B", "C"), np.array([[0.0, 0.0, 0.0], [0.30, 0.0, 0.0], [0.05, 0.20, 0.0]]))
    turns, places = swung(40)
    points = np.concatenate((markers_of(triangle, turns, places), crowd(9, 40)), axis=1)
    for cameras in (film.rig.cameras, ()):
        tracker = PropTracker(triangle, cameras)
        found = [tracker.step(film(row, n, images=bool(cameras))).pose.found for n, row in enumerate(points)]
        assert not any(found[:6])
        assert all(found[8:])


def test_nobody_knows_a_prop_that_is_not_there(sword, film):
    tracker = PropTracker(sword, film.rig.cameras)
    for number, row in enumerate(crowd(9, 30)):
        frame = film(row, number)
        sighting = tracker.step(frame)
        assert not sighting.pose.found
        assert sighting.rest is frame
    assert not tracker.step(film(np.empty((0, 3)), 30)).pose.found
