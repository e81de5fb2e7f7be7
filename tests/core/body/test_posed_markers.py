import numpy as np
import pytest
from perfanim.core.body.posed_markers import markers_at_rest
from perfanim.core.body.skeleton import marker_positions
from perfanim.core.database.store import rotations_from_pose
from perfanim.core.geometry import rotations as rot


@pytest.mark.parametrize("scale", [0.0, 1e-13, 1e-6, 0.4, 3.0])
def test_they_are_where_forward_kinematics_puts_them(model, database, scale):
    generator = np.random.default_rng(5)
    joints = np.concatenate((model.joints, [0, 28]))  # also on the root, and on the last joint of a chain
    offsets_m = generator.normal(scale=0.1, size=(len(joints), 3))
    poses = generator.normal(scale=scale, size=(9000, 28, 3)).astype(np.float32)  # more than are posed at once
    found = markers_at_rest(model.skeleton, joints, offsets_m, database.mean_rotations, poses)
    some = [0, 8191, 8192, 8999]
    local = rotations_from_pose(poses[some].astype(float), database.mean_rotations, rot.identity())
    expected = marker_positions(model.skeleton, joints, offsets_m, local, np.zeros(3))
    np.testing.assert_allclose(found[some], expected, atol=1e-6)  # float32 two metres from the root
