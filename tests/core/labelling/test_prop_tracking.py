"""A prop found by its distances, followed, lost and found again, with and without images."""

from dataclasses import replace

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
def test_prop_is_tracked_among_a_performers_markers(sword, film, images):
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


def test_single_camera_markers_count(sword, film):
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
def test_hidden_prop_is_found_anywhere(sword, film, images):
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


def test_accidental_triangle_is_not_accepted(film):
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


def test_lasting_triangle_is_accepted(film):
    triangle = Prop("triangle", ("A", "B", "C"), np.array([[0.0, 0.0, 0.0], [0.30, 0.0, 0.0], [0.05, 0.20, 0.0]]))
    turns, places = swung(40)
    points = np.concatenate((markers_of(triangle, turns, places), crowd(9, 40)), axis=1)
    for cameras in (film.rig.cameras, ()):
        tracker = PropTracker(triangle, cameras)
        found = [tracker.step(film(row, n, images=bool(cameras))).pose.found for n, row in enumerate(points)]
        assert not any(found[:6])
        assert all(found[8:])


def steady(frames, speed_m_s=3.0, turn_rad_s=4.0):
    """Poses (F, 4), (F, 3) of a prop whose markers' middle moves sideways while it turns, both steadily."""
    time_s = np.arange(frames) / FPS
    turns = rot.from_rotation_vector(turn_rad_s * time_s[:, None] * np.array([0.0, 0.6, 0.8]))
    middle = load_prop("sword").positions_m.mean(axis=0)
    places = np.array([-0.5, 1.2, 0.3]) + speed_m_s * time_s[:, None] * np.array([1.0, 0.2, 0.0])
    return turns, places - rot.rotate(turns, middle)


def test_prop_is_expected_along_its_motion(sword, film):
    """After four frames out of sight, by blobs of one camera or the other alone: no point tells where it is."""
    turns, places = steady(15)
    tracker = PropTracker(sword, film.rig.cameras)
    both, alone = tuple((m, -1) for m in range(5)), ((0, 0), (1, 1), (2, 0), (3, 1), (4, 0))
    for number, row in enumerate(markers_of(sword, turns, places)):
        hidden = both if 10 <= number < 14 else alone if number == 14 else ()
        sighting = tracker.step(film(row, number, hidden))
        assert sighting.pose.found == (not 10 <= number < 14)
    assert len(film(row, 14, alone).points_m) == 0
    place_m, turn_deg = off(sighting.pose, turns[14], places[14])
    assert place_m < 5.0 * PLACE_M and turn_deg < 5.0 * TURN_DEG  # five blobs tell ten numbers of six
    assert sighting.pose.seen == 5
    assert [len(blobs) for blobs in sighting.rest.blobs] == [0, 0]


def test_reachable_points_are_tried_first(sword, film):
    """Of two swords the one where the known one should be is it, though both look alike; without a past neither is."""
    for images in (True, False):
        turns, places = steady(20)
        own, other = markers_of(sword, turns, places), markers_of(sword, turns, places + np.array([0.0, 0.0, -1.0]))
        tracker, late = (PropTracker(sword, film.rig.cameras if images else ()) for _ in range(2))
        for number in range(20):
            both = np.concatenate((own[number], other[number]))
            pose = tracker.step(film(both if number >= 5 else own[number], number, images=images)).pose
            assert off(pose, turns[number], places[number])[0] < WITHOUT_IMAGES_M
            if number >= 5:
                assert not late.step(film(both, number, images=images)).pose.found


@pytest.mark.parametrize(("shown", "found"), [(5, True), (4, True), (3, False)])
def test_tracked_prop_elsewhere_needs_more_than_three_points(sword, film, shown, found):
    turns, places = swung(20)
    tracker = PropTracker(sword)
    for number in range(20):
        jumped = np.array([0.0, 0.3, -1.5]) if number >= 10 else np.zeros(3)
        hidden = tuple((m, -1) for m in (2, 3)[: 5 - shown]) if number >= 10 else ()
        row = markers_of(sword, turns, places + jumped)[number]
        sighting = tracker.step(film(row, number, hidden, images=False))
        assert sighting.pose.found == (number < 10 or found)
        assert len(sighting.rest.points_m) == (0 if sighting.pose.found else shown)


def test_poorly_visible_prop_keeps_its_blobs_for_a_moment(sword, film):
    """For a tenth of a second; what lies further off, and all of it later, is the performer's."""
    turns, places = np.tile(rot.identity(), (30, 1)), np.tile([0.0, 1.0, 0.3], (30, 1))
    beside = np.array([[0.0, 1.12, 0.3]]) - [[0.10, 0.0, 0.0]]
    rows = np.concatenate((markers_of(sword, turns, places), np.tile(beside, (30, 1, 1))), axis=1)
    tracker = PropTracker(sword, film.rig.cameras)
    for number, row in enumerate(rows):
        gone = tuple((m, -1) for m in (1, 2, 3)) if number >= 10 else ()
        sighting = tracker.step(film(row, number, gone))
        assert sighting.pose.found == (number < 10)
        if number < 10:
            last = sighting.pose
        else:
            np.testing.assert_array_equal(sighting.pose.position_m, last.position_m)
            np.testing.assert_array_equal(sighting.pose.rotation, last.rotation)
        if number != 15:  # a tenth of a second after it was last seen
            left = 1 if number < 15 else 3
            assert [len(blobs) for blobs in sighting.rest.blobs] == [left, left]


@pytest.mark.parametrize("images", [True, False])
def test_other_distances_are_not_the_prop(sword, film, images):
    """Not by markers a centimetre or two elsewhere, which is 2 to 4 pixels; by some millimetres it is a bent one."""
    turns, places = swung(10)
    aside = np.array([[1.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 0.0, 1.0], [0.0, -1.0, 1.0]])
    for away_m, found in ((0.015, False), (0.001, True)):
        bent = Prop("bent", sword.names, sword.positions_m + away_m * aside)
        tracker = PropTracker(sword, film.rig.cameras if images else ())
        for number, row in enumerate(markers_of(bent, turns, places)):
            sighting = tracker.step(film(row, number, images=images))
            assert sighting.pose.found == found


@pytest.mark.parametrize(("sigma_m", "found"), [(0.001, False), (0.02, True)])
def test_uncertain_points_have_wider_tolerances(sword, film, sigma_m, found):
    turns, places = swung(10)
    aside = np.array([[1.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 0.0, 1.0], [0.0, -1.0, 1.0]])
    bent = Prop("bent", sword.names, sword.positions_m + 0.006 * aside)
    tracker = PropTracker(sword)
    for number, row in enumerate(markers_of(bent, turns, places)):
        frame = film(row, number, images=False)
        frame = replace(frame, covariances_m2=np.tile(sigma_m**2 * np.eye(3), (5, 1, 1)))
        assert (tracker.step(frame).pose.seen == 5) == found


def test_frames_without_images_are_tracked_by_points(sword, film):
    turns, places = swung(20)
    tracker = PropTracker(sword, film.rig.cameras)
    for number, row in enumerate(markers_of(sword, turns, places)):
        sighting = tracker.step(film(row, number, images=number % 3 == 0))
        assert sighting.pose.seen == 5
        assert off(sighting.pose, turns[number], places[number])[0] < WITHOUT_IMAGES_M
        assert len(sighting.rest.points_m) == 0


@pytest.mark.parametrize("images", [True, False])
def test_reported_error_is_that_of_the_markers(sword, film, images):
    """Of points with 1 mm of noise on each coordinate, fifteen of them for six unknowns; of rays 0.1 pixel."""
    turns, places = swung(40)
    tracker = PropTracker(sword, film.rig.cameras if images else ())
    told = [tracker.step(film(row, n, images=images)).pose.rms_m for n, row in
            enumerate(markers_of(sword, turns, places))]  # fmt: skip
    expected = np.sqrt(2.0) * 0.1 / 540.0 * 3.3 * np.sqrt(14.0 / 20.0) if images else 0.001 * np.sqrt(3.0 * 9.0 / 15.0)
    assert np.mean(told) == pytest.approx(expected, rel=0.25)


def test_prop_quaternions_are_continuous(sword, film):
    turns, places = steady(60, speed_m_s=0.2, turn_rad_s=8.0)
    tracker = PropTracker(sword)
    found = [tracker.step(film(row, n, images=False)).pose.rotation for n, row in
             enumerate(markers_of(sword, turns, places))]  # fmt: skip
    assert np.all(np.sum(np.array(found)[1:] * np.array(found)[:-1], axis=1) > 0.9)
    assert np.min(np.array(found)[:, 0]) < -0.5


def test_tracker_restarts_when_time_goes_back(sword, film):
    """A film that is played again, or a camera that was restarted: three points are believed only after a while."""
    turns, places = swung(40)
    tracker = PropTracker(sword)
    for number in (20, 21, 22):
        assert tracker.step(film(markers_of(sword, turns, places)[number], number, images=False)).pose.found
    hidden = ((2, -1), (3, -1))
    found = [tracker.step(film(markers_of(sword, turns, places)[n], n, hidden, images=False)).pose.found
             for n in range(10)]  # fmt: skip
    assert found == [False] * 6 + [True] * 4


def test_absent_prop_is_not_found(sword, film):
    tracker = PropTracker(sword, film.rig.cameras)
    for number, row in enumerate(crowd(9, 30)):
        frame = film(row, number)
        sighting = tracker.step(frame)
        assert not sighting.pose.found
        assert sighting.rest is frame
    assert not tracker.step(film(np.empty((0, 3)), 30)).pose.found
