"""Left and right, exchanged by a network in single pictures of single cameras."""

import numpy as np
import pytest
from filmed_people import OTHERS, POINTS, keypoints
from perfanim.core.body.body_parts import PARTS
from perfanim.core.geometry.camera import undistort_all
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.vision.people.side_exchanges import SideExchanges

FPS = 60.0
LIMBS = {
    limb: [
        i
        for i, marker in enumerate(POINTS.markers)
        if marker.joint in {joint for side in ("left", "right") for part in parts for joint in PARTS[f"{side} {part}"]}
    ]
    for limb, parts in (("arms", ("arm", "hand")), ("legs", ("leg", "foot")))
}


@pytest.fixture(scope="module")
def points_m(truth):
    return keypoints(truth)


def decided(rig, points_m, exchanged, error_m=0.03, seed=0):
    """Return the decisions (F, C, K), and the right ones.

    Args:
        exchanged: Mask (F, C, K) of the points that have the places of their counterparts.
        error_m: Standard deviation of the slow errors of each camera's points.
    """
    random = np.random.default_rng(seed)
    frames, count = points_m.shape[:2]
    exchanges, found, slow = SideExchanges(rig.cameras, POINTS.markers), [], np.zeros((len(rig), count, 3))
    for frame in range(frames):
        keep = np.exp(-1.0 / (FPS * 0.35)) if frame else 0.0
        slow = keep * slow + np.sqrt(1.0 - keep**2) * random.normal(0.0, error_m, slow.shape)
        fast = random.normal(0.0, 0.006, slow.shape)
        pixels = np.array([camera.project(points_m[frame] + slow[c] + fast[c]) for c, camera in enumerate(rig.cameras)])
        pixels = np.where(exchanged[frame][..., None], pixels[:, OTHERS], pixels)
        found.append(exchanges.step(frame / FPS, np.array(undistort_all(rig.cameras, list(pixels)))))
    return np.array(found), np.where(exchanged, OTHERS, np.arange(count))


def stretches(points_m, cameras, seed, groups=("arms", "legs")):
    """Return exchanges of 5 to 15 frames in a fifth of the frames of one camera at a time, or of both."""
    random = np.random.default_rng(seed)
    exchanged = np.zeros((len(points_m), cameras, len(POINTS)), dtype=bool)
    for start in range(20, len(points_m) - 20, 50):
        rows, camera = slice(start, start + random.integers(5, 16)), random.integers(cameras)
        exchanged[rows, camera, LIMBS[random.choice(groups)]] = True
    return exchanged


@pytest.mark.parametrize("seed", range(4))
def test_exchanged_limbs_of_one_camera_are_found(points_m, seed):
    rig = default_rig()
    exchanged = stretches(points_m, len(rig), seed)
    found, right = decided(rig, points_m, exchanged, seed=seed)
    limbs = sorted(LIMBS["arms"] + LIMBS["legs"])
    wrong = (found != right)[..., limbs].any(axis=(1, 2))
    assert np.mean(wrong) < 0.01
    assert exchanged.any(axis=(1, 2)).mean() > 0.15


def test_right_pictures_are_left_alone(points_m):
    rig = default_rig()
    found, right = decided(rig, points_m, np.zeros((len(points_m), len(rig), len(POINTS)), dtype=bool))
    np.testing.assert_array_equal(found, right)


def test_the_past_tells_if_both_cameras_exchange_the_legs(points_m):
    rig = default_rig()
    exchanged = np.zeros((len(points_m), len(rig), len(POINTS)), dtype=bool)
    exchanged[60:68, :, LIMBS["legs"]] = True
    found, right = decided(rig, points_m, exchanged, error_m=0.01)
    np.testing.assert_array_equal(found[..., LIMBS["legs"]], right[..., LIMBS["legs"]])


def test_points_that_are_not_found_change_nothing(points_m):
    rig = default_rig()
    exchanges = SideExchanges(rig.cameras, POINTS.markers)
    nothing = np.full((len(rig), len(POINTS), 2), np.nan)
    for frame in range(5):
        np.testing.assert_array_equal(exchanges.step(frame / FPS, nothing)[0], np.arange(len(POINTS)))


def test_a_picture_that_places_arms_between_both_sides_is_left_out(points_m):
    rig, random, exchanges = (
        default_rig(),
        np.random.default_rng(0),
        SideExchanges(default_rig().cameras, POINTS.markers),
    )
    between = np.where(np.isin(np.arange(len(POINTS)), LIMBS["arms"])[:, None], 0.5, 0.0)
    found = []
    for frame in range(40):
        seen_m = points_m[frame] + random.normal(0.0, 0.006, (len(rig), *points_m.shape[1:]))
        if 20 <= frame < 23:
            seen_m[1] += between * (seen_m[1, OTHERS] - seen_m[1])
        pixels = [camera.project(each_m) for camera, each_m in zip(rig.cameras, seen_m, strict=True)]
        found.append(exchanges.step(frame / FPS, np.array(undistort_all(rig.cameras, pixels))))
    left_out = np.array(found) < 0
    expected = np.zeros_like(left_out)
    expected[20:23, 1, LIMBS["arms"]] = True
    np.testing.assert_array_equal(left_out, expected)
