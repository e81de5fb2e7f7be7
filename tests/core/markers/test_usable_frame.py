"""What the door of a session leaves out of a marker frame, and which times it believes."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.usable_frame import FrameTimes, usable_frame

MARKERS = 6
FOLLOWS, AFTER_GAP, REFUSED = "follows", "after gap", "refused"


def frame(labelled: bool = True) -> MarkerFrame:
    """Four points of two cameras, and two rays."""
    generator = np.random.default_rng(0)
    return MarkerFrame(
        0,
        0.0,
        generator.normal(size=(4, 3)),
        np.tile(1e-6 * np.eye(3), (4, 1, 1)),
        np.arange(4) if labelled else np.full(4, -1),
        tuple(generator.uniform(0.0, 255.0, (5, 5)).astype(np.float32) for _ in range(2)),
        point_blobs=np.tile(np.arange(4)[:, None], (1, 2)),
        single_cameras=np.array([0, 1]),
        single_blobs=np.array([4, 4]),
        single_points=generator.normal(size=(2, 2)),
        single_labels=np.array([4, 5]) if labelled else np.full(2, -1),
    )


def changed(name: str, place: tuple[int, ...], value: float, labelled: bool = True) -> MarkerFrame:
    values = np.array(getattr(frame(labelled), name))
    values[place] = value
    return replace(frame(labelled), **{name: values})


@pytest.mark.parametrize("labelled", [True, False])
def test_ordinary_frame_is_unchanged(labelled):
    ordinary = frame(labelled)
    assert usable_frame(ordinary, MARKERS, 2) is ordinary
    assert usable_frame(ordinary, MARKERS, 0) is ordinary
    # a marker that one camera shows, and a point of the others
    both = replace(ordinary, single_labels=ordinary.labels[:2])
    assert usable_frame(both, MARKERS, 2) is both
    empty = MarkerFrame(0, 0.0)
    assert usable_frame(empty, MARKERS, 2) is empty
    many = replace(ordinary, points_m=ordinary.points_m + 400.0)  # their squares add up to more than one may have
    assert usable_frame(many, MARKERS, 2) is many


@pytest.mark.parametrize(
    ("name", "place", "value"),
    [
        *[("points_m", (1, 2), value) for value in (np.nan, np.inf, -np.inf, 1e30, 1e160, 1e300, 600.0)],
        *[("covariances_m2", (1, 0, 0), value) for value in (np.nan, np.inf, 1e30, -1e-6)],
        ("covariances_m2", (1,), 0.0),
        *[("labels", (1,), value) for value in (MARKERS, 1000, -2, -5)],
        *[("point_blobs", (1, 1), value) for value in (5, 1000, -2)],
    ],
)
def test_impossible_point_is_left_out(name, place, value):
    rest = usable_frame(changed(name, place, value), MARKERS, 2)
    kept = [0, 2, 3]
    np.testing.assert_array_equal(rest.points_m, frame().points_m[kept])
    np.testing.assert_array_equal(rest.labels, kept)
    np.testing.assert_array_equal(rest.single_points, frame().single_points)
    assert rest.notes == ("impossible, left out: 1 point",)


def test_points_with_the_same_label_are_left_out():
    rest = usable_frame(changed("labels", (1,), 3), MARKERS, 2)
    np.testing.assert_array_equal(rest.labels, [0, 2])
    assert rest.notes == ("impossible, left out: 2 points",)
    unlabelled = frame(labelled=False)
    assert usable_frame(unlabelled, MARKERS, 2) is unlabelled


@pytest.mark.parametrize(
    ("name", "place", "value"),
    [
        *[("single_points", (0, 1), value) for value in (np.nan, np.inf, 1e30)],
        *[("single_cameras", (0,), value) for value in (2, 7, -3)],
        *[("single_blobs", (0,), value) for value in (5, 1000, -2)],
        *[("single_labels", (0,), value) for value in (MARKERS, -2)],
    ],
)
def test_impossible_ray_is_left_out(name, place, value):
    rest = usable_frame(changed(name, place, value), MARKERS, 2)
    np.testing.assert_array_equal(rest.single_points, frame().single_points[1:])
    np.testing.assert_array_equal(rest.points_m, frame().points_m)
    assert rest.notes == ("impossible, left out: 1 ray",)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e30, -2e5])
def test_impossible_blob_is_left_out_with_its_point(value):
    blobs = [np.array(rows) for rows in frame().blobs]
    blobs[1][1, 0] = value
    rest = usable_frame(replace(frame(), blobs=tuple(blobs), detected=(), notes=("left camera frozen",)), MARKERS, 2)
    np.testing.assert_array_equal(rest.labels, [0, 2, 3])
    np.testing.assert_array_equal(rest.point_blobs, [[0, 0], [2, 1], [3, 2]])
    np.testing.assert_array_equal(rest.single_blobs, [4, 3])
    assert [len(rows) for rows in rest.blobs] == [5, 4]
    assert rest.notes == ("left camera frozen", "impossible, left out: 1 blob")


def passages(times_s) -> list[str]:
    times, told = FrameTimes(), []
    for time_s in times_s:
        admitted = times.admit(time_s)
        told.append(REFUSED if not admitted else AFTER_GAP if times.jumped else FOLLOWS)
    return told


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, 1e18, -1e18, 3600.1, -3600.0, 0.1, 0.05])
def test_single_wrong_time_has_no_effect(wrong):
    assert passages((0.0, 0.1, wrong, 0.2, wrong, wrong, 0.3)) == [
        FOLLOWS,
        FOLLOWS,
        REFUSED,
        FOLLOWS,
        REFUSED,
        REFUSED,
        FOLLOWS,
    ]


@pytest.mark.parametrize("jump_s", [-3600.0, -0.5, 5.0, 3600.0])
def test_jump_in_time_is_confirmed_by_three_frames(jump_s):
    times_s = (9.9, 10.0, *(10.0 + jump_s + 0.1 * np.arange(5)))
    assert passages(times_s) == [FOLLOWS, FOLLOWS, REFUSED, REFUSED, AFTER_GAP, FOLLOWS, FOLLOWS]


def test_one_frame_per_second_has_no_gaps():
    assert set(passages(range(10))) == {FOLLOWS}


def test_impossible_first_time_is_refused():
    assert passages((np.nan, 1e30, 5.0)) == [REFUSED, REFUSED, FOLLOWS]
