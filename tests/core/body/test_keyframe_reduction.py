"""Fewer keys: the cubics between them stay within the bound, and there are few of them."""

import itertools

import numpy as np
import pytest
from perfanim.core.body.keyframe_reduction import location_keys, rotation_keys, slopes
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry import rotations as rot
from perfanim.core.system.assets import MOTION


def cubic(at, first, last, left, right, steep_left, steep_right):
    """The Bezier curve whose handles reach a third of the way, by de Casteljau's construction."""
    share = ((at - first) / (last - first))[:, None]
    third = (last - first) / 3.0
    points = [left, left + third * steep_left, right - third * steep_right, right]
    points = [np.broadcast_to(point, (len(at), len(left))) for point in points]
    while len(points) > 1:
        points = [(1 - share) * a + share * b for a, b in itertools.pairwise(points)]
    return points[0]


def redrawn(frames, values, keys):
    steep = slopes(frames, values)
    found = values.copy()
    for first, last in itertools.pairwise(keys):
        at = slice(first, last + 1)
        ends = (values[first], values[last], steep[first], steep[last])
        found[at] = cubic(frames[at], frames[first], frames[last], *ends)
    return found


@pytest.fixture(scope="module")
def walk():
    return read_motion(next(MOTION.glob("walking-01*.bvh")))


@pytest.mark.parametrize("bound_deg", [0.2, 1.0])
def test_rotations_stay_within_the_bound_with_few_keys(walk, bound_deg):
    frames = 5.0 + 0.4 * np.arange(walk.frames)
    counts = []
    for joint in range(len(walk.skeleton)):
        quaternions = rot.continuous(walk.rotations[:, joint])
        keys = rotation_keys(frames, quaternions, np.radians(bound_deg))
        found = redrawn(frames, quaternions, keys)
        found /= np.linalg.norm(found, axis=1, keepdims=True)
        assert np.degrees(rot.angle_between(found, quaternions)).max() <= bound_deg + 1e-9
        assert (keys[0], keys[-1]) == (0, walk.frames - 1)
        counts.append(len(keys))
    assert np.sum(counts) < 0.5 * len(counts) * walk.frames


def test_locations_stay_within_the_bound(walk):
    frames = np.cumsum(np.random.default_rng(1).uniform(0.2, 1.0, walk.frames))
    keys = location_keys(frames, walk.root_positions_m, 0.002)
    found = redrawn(frames, walk.root_positions_m, keys)
    assert np.linalg.norm(found - walk.root_positions_m, axis=1).max() <= 0.002 + 1e-12
    assert len(keys) < 0.5 * walk.frames


def test_what_stands_still_needs_two_keys_and_a_jump_is_kept():
    frames = np.arange(100.0)
    still = np.tile([1.0, 0.0, 0.0, 0.0], (100, 1))
    np.testing.assert_array_equal(rotation_keys(frames, still, 1e-3), [0, 99])
    np.testing.assert_array_equal(rotation_keys(frames[:1], still[:1], 1e-3), [0])
    np.testing.assert_array_equal(location_keys(frames[:2], still[:2, :3], 1e-3), [0, 1])
    jump = np.zeros((100, 3))
    jump[40:] = 1.0
    found = redrawn(frames, jump, location_keys(frames, jump, 0.01))
    assert np.abs(found - jump).max() <= 0.01
