"""Markers of many poses at rest by the kernel are those of NumPy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from perfanim.core.body.posed_markers import markers_at_rest
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.geometry import rotations as rot

SKELETON = default_skeleton(1.75)
JOINTS = len(SKELETON)


def body(generator: np.random.Generator, markers: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return joints that carry markers, offsets of these, and reference rotations."""
    joints = generator.integers(0, JOINTS, markers)
    means = rot.normalize(generator.normal(size=(JOINTS, 4)))
    return joints, generator.normal(0.0, 0.1, (markers, 3)), means


def both(joints: np.ndarray, offsets_m: np.ndarray, means: np.ndarray, poses: np.ndarray) -> list[np.ndarray]:
    with np.errstate(all="ignore"):
        arguments = SKELETON, joints, offsets_m, means, poses
        return [of(*arguments) for of in (markers_at_rest.numpy_body, markers_at_rest.compiled_body)]


@given(st.integers(0, 2**32), st.integers(0, 9), st.integers(1, 20), st.sampled_from([0.0, 1e-9, 0.3, 2.0, 30.0]))
def test_random_poses(seed, frames, markers, spread_rad):
    generator = np.random.default_rng(seed)
    poses = generator.normal(0.0, spread_rad, (frames, JOINTS - 1, 3)).astype(np.float32)
    expected, found = both(*body(generator, markers), poses)
    assert found.shape == expected.shape == (frames, markers, 3)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=4e-7)  # metres, in single precision


@pytest.mark.parametrize("special", [np.nan, np.inf, -np.inf, 1e30, 3e38])
@pytest.mark.parametrize("frame", [0, 3, 4, 6])
def test_a_hostile_pose_spoils_no_other(special, frame):
    generator = np.random.default_rng(1)
    poses = generator.normal(0.0, 0.4, (7, JOINTS - 1, 3)).astype(np.float32)
    poses[frame, 3] = special
    expected, found = both(*body(generator, 12), poses)
    others = np.arange(7) != frame
    np.testing.assert_allclose(found[others], expected[others], rtol=0.0, atol=4e-7)
    assert np.isfinite(found[others]).all()


def test_a_half_turn_is_exact_on_either_side():
    """The series serves up to there, and beyond it another formula."""
    angles = np.linspace(2.9, 3.3, 41, dtype=np.float32)
    poses = np.zeros((len(angles), JOINTS - 1, 3), dtype=np.float32)
    poses[:, :, 1] = angles[:, None]
    expected, found = both(*body(np.random.default_rng(2), 20), poses)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=4e-7)
