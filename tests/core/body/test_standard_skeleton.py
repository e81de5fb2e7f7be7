import numpy as np
import pytest
from perfanim.core.body.calibration_poses import t_pose
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import JOINT_NAMES, default_skeleton, mirrored_name, scaled


def test_joints_are_the_cmu_databases() -> None:
    assert len(JOINT_NAMES) == len(set(JOINT_NAMES)) == 29
    assert JOINT_NAMES[:5] == ("root", "lfemur", "ltibia", "lfoot", "ltoes")
    assert JOINT_NAMES[9:15] == ("lowerback", "upperback", "thorax", "lowerneck", "upperneck", "head")
    skeleton = default_skeleton()
    parent = {name: skeleton.names[skeleton.parents[i]] for i, name in enumerate(skeleton.names)}
    assert (parent["lfemur"], parent["lclavicle"], parent["rthumb"]) == ("root", "thorax", "rwrist")


def test_rest_pose_is_a_t_with_spread_legs() -> None:
    skeleton = default_skeleton()
    femur = skeleton.tips_m[skeleton.index("lfemur")]
    np.testing.assert_allclose(femur / np.linalg.norm(femur), [0.342, -0.940, 0.0], atol=5e-4)
    at = dict(zip(skeleton.names, skeleton.rest_positions_m, strict=True))
    assert np.ptp([at[name][1] for name in ("lhumerus", "lradius", "lhand", "rfingers")]) == pytest.approx(0.0)
    assert at["lhand"][0] > at["lradius"][0] > at["lhumerus"][0] > 0.0 > at["rhand"][0]
    assert at["ltoes"][2] > at["lfoot"][2]


def test_left_and_right_are_mirror_images() -> None:
    skeleton = default_skeleton()
    for joint, name in enumerate(skeleton.names):
        other = skeleton.index(mirrored_name(name))
        np.testing.assert_array_equal(skeleton.offsets_m[joint] * [-1.0, 1.0, 1.0], skeleton.offsets_m[other])
        np.testing.assert_array_equal(skeleton.tips_m[joint] * [-1.0, 1.0, 1.0], skeleton.tips_m[other])
    assert mirrored_name("lowerback") == "lowerback"
    assert mirrored_name("root") == "root"
    assert mirrored_name("rthumb") == "lthumb"


@pytest.mark.parametrize("height", [1.5, 1.75, 2.0])
def test_standing_height_is_the_one_asked_for(height: float) -> None:
    skeleton = default_skeleton(height)
    positions, _ = forward_kinematics(skeleton, t_pose(skeleton), np.zeros(3))
    head = skeleton.index("head")
    top = positions[head, 1] + skeleton.tips_m[head, 1]
    lowest = positions[:, 1].min()
    # the head bone ends below the crown and the sole lies below the toe joint: together up to a tenth of the height
    assert 0.9 * height < top - lowest < height


def test_scaling() -> None:
    plain = default_skeleton()
    np.testing.assert_allclose(scaled(plain, 2.0).offsets_m, 2.0 * plain.offsets_m)
    factors = np.linspace(0.5, 1.5, len(plain))
    np.testing.assert_allclose(scaled(plain, factors).tips_m, factors[:, None] * plain.tips_m)
    np.testing.assert_allclose(default_skeleton(3.5).offsets_m, 2.0 * plain.offsets_m)
