"""BVH files brought to another space: all joints go along, and angles stay continuous."""

import numpy as np
import pytest
from perfanim.core.body.motion import sliced
from perfanim.core.body.source_motion import source_kinematics
from perfanim.core.formats.motion.bvh import read_bvh, write_bvh
from perfanim.core.formats.motion.bvh_transform import transform_bvh
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry import rotations as rot
from perfanim.core.system.assets import MOTION

ROUNDED_M = 1e-5  # six decimals of metres and of degrees, down an arm
FRAMES = 80


@pytest.fixture
def text(tmp_path):
    walk = next(MOTION.glob("walking-01*.bvh"))  # somebody who turns round
    write_bvh(sliced(read_motion(walk), 0, FRAMES), tmp_path / "walk.bvh")
    return (tmp_path / "walk.bvh").read_text()


def space(turns, scale, places):
    matrices = np.tile(np.eye(4), (FRAMES, 1, 1))
    matrices[:, :3, :3] = scale * rot.to_matrix(rot.from_rotation_vector(turns))
    matrices[:, :3, 3] = places
    return matrices


@pytest.mark.parametrize(
    ("turns", "scale"),
    [
        (np.tile([-np.pi / 2, 0.0, 0.0], (FRAMES, 1)), 1.0),
        (np.tile([0.4, -1.3, 0.8], (FRAMES, 1)), 100.0),
        (np.linspace(0.0, 4.0, FRAMES)[:, None] * [0.2, 1.0, 0.3], 1.0),
    ],
)
def test_every_joint_goes_along(text, turns, scale):
    matrices = space(turns, scale, np.linspace(0.0, 1.0, FRAMES)[:, None] * [1.0, 2.0, -3.0])
    before, after = (read_bvh(data.encode(), "walk", unit="m") for data in (text, transform_bvh(text, matrices)))
    assert (after.names, after.fps, after.euler_orders) == (before.names, before.fps, before.euler_orders)
    wanted = np.einsum("fij,fnj->fni", matrices[:, :3, :3], source_kinematics(before)[0]) + matrices[:, None, :3, 3]
    np.testing.assert_allclose(source_kinematics(after)[0], wanted, atol=scale * ROUNDED_M)
    assert not after.angle_jumps.any()


def test_nothing_changes_in_its_own_space(text):
    moved = transform_bvh(text, np.tile(np.eye(4), (FRAMES, 1, 1)))
    before, after = (read_bvh(data.encode(), "walk", unit="m") for data in (text, moved))
    np.testing.assert_allclose(after.offsets_m, before.offsets_m, atol=ROUNDED_M)
    np.testing.assert_allclose(source_kinematics(after)[0], source_kinematics(before)[0], atol=ROUNDED_M)
