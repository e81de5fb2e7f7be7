"""Wild points: what a trajectory does without them decides."""

import numpy as np
import pytest
from perfanim.core.markers.marker_set import PointKind
from perfanim.core.markers.source_noise import noise_of
from perfanim.core.markers.wild_points import find_wild_points

NOISE_M = 0.001
FRAMES, AT = 60, 30


def found_in(points_m: np.ndarray, fps: float, bone: int = 1) -> list[int]:
    """Return the frames in which the first of the markers (F, M, 3) is wild; the first `bone` ones are on one bone."""
    noise = np.random.default_rng(4).normal(scale=NOISE_M, size=points_m.shape)
    nearest = np.zeros((points_m.shape[1],) * 2, dtype=bool)
    nearest[:bone, :bone] = ~np.eye(bone, dtype=bool)
    times_s = np.arange(len(points_m)) / fps
    wild = find_wild_points(times_s, points_m + noise, noise_of(PointKind.MARKERS), nearest)
    return np.flatnonzero(wild[:, 0]).tolist()


def swinging(fps: float, markers: int = 7) -> np.ndarray:
    """Return markers (F, M, 3), 10 cm apart, of a hand that swings by 30 cm to either side, once a second."""
    phase = 2.0 * np.pi * np.arange(FRAMES) / fps
    path = np.stack((0.3 * np.sin(phase), 0.1 * np.cos(phase), np.zeros(FRAMES)), axis=-1)
    return path[:, None] + np.array([0.0, 0.0, 0.1]) * np.arange(markers)[:, None]


@pytest.mark.parametrize("fps", [30.0, 60.0, 120.0])
@pytest.mark.parametrize("frames", [1, 2, 3])
def test_points_beside_a_motion_that_goes_on_are_wild(fps, frames):
    points_m = swinging(fps)
    points_m[AT : AT + frames, 0] += [0.0, 0.0, 0.12]
    assert found_in(points_m, fps) == list(range(AT, AT + frames))


@pytest.mark.parametrize("fps", [30.0, 60.0])
def test_a_blow_that_is_stopped_is_a_motion(fps):
    """A fist at 6 m/s that a bag throws back at half the speed: nothing before tells what comes after."""
    points_m, after = swinging(fps), np.arange(FRAMES - AT) / fps
    points_m[:AT, 0, 0] = points_m[AT, 0, 0] - 6.0 * np.arange(AT, 0, -1) / fps
    points_m[AT:, 0, 0] = points_m[AT, 0, 0] - 3.0 * after
    assert found_in(points_m, fps) == []


def test_a_bone_that_jumps_is_the_body():
    points_m = swinging(60.0)
    points_m[AT, :3] += [0.0, 0.0, 0.08]
    assert found_in(points_m, 60.0, bone=3) == []
    assert found_in(points_m, 60.0) == [AT]


def test_a_jump_in_the_last_frame_may_be_a_motion_that_begins():
    points_m = swinging(60.0)
    points_m[-1, 0] += [0.0, 0.0, 0.08]
    assert found_in(points_m, 60.0) == []
