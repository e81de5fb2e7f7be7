"""Between the product's space and Blender's: directions, bone axes, rigs of other shapes."""

import numpy as np
import pytest
from perfanim.core import rotations as rot
from perfanim.core.errors import CharacterError
from perfanim.core.product_skeleton import default_skeleton
from perfanim.perfanim_addon import axes

SKELETON = default_skeleton()


def random_rest(seed: int, *, scale: float = 1.0, turn: np.ndarray = axes.BLENDER_FROM_PRODUCT) -> axes.RigRest:
    random = np.random.default_rng(seed)
    return axes.RigRest(
        heads=scale * (SKELETON.rest_positions_m + np.array([0.0, 0.9, 0.0])) @ turn.T,
        axes=rot.to_matrix(rot.normalize(random.normal(size=(29, 4)))),
        ancestors=SKELETON.parents,
    )


def random_rotations(seed: int, *shape: int) -> np.ndarray:
    return rot.normalize(np.random.default_rng(seed).normal(size=(*shape, 29, 4)))


def test_performer_faces_minus_y_with_z_up():
    left, up, forward = axes.points_to_blender(np.eye(3))
    assert left.tolist() == [1.0, 0.0, 0.0]
    assert up.tolist() == [0.0, 0.0, 1.0]
    assert forward.tolist() == [0.0, -1.0, 0.0]


def test_points_and_rotations_come_back():
    points = np.random.default_rng(1).normal(size=(7, 3))
    quaternions = random_rotations(2, 5)
    assert np.allclose(axes.points_from_blender(axes.points_to_blender(points)), points)
    assert np.allclose(axes.rotations_from_blender(axes.rotations_to_blender(quaternions)), quaternions)


def test_turning_then_converting_is_converting_then_turning():
    quaternion, point = random_rotations(3)[0], np.array([0.3, -0.8, 1.1])
    there = axes.points_to_blender(rot.rotate(quaternion, point))
    assert np.allclose(rot.rotate(axes.rotations_to_blender(quaternion), axes.points_to_blender(point)), there)


@pytest.mark.parametrize("seed", [4, 5])
def test_bone_rotations_and_root_come_back_for_any_rolls(seed):
    pose_map = axes.PoseMap(SKELETON, random_rest(seed))
    quaternions, roots = random_rotations(seed, 6), np.random.default_rng(seed).normal(size=(6, 3))
    bones = pose_map.bone_rotations(quaternions)
    assert np.allclose(np.linalg.norm(bones, axis=-1), 1.0)
    assert np.allclose(pose_map.product_rotations(bones), quaternions)
    assert np.allclose(pose_map.root_position_m(pose_map.root_location(roots)), roots)


def test_rest_pose_leaves_every_bone_at_rest():
    pose_map = axes.PoseMap(SKELETON, random_rest(6))
    assert np.allclose(np.abs(pose_map.bone_rotations(rot.identity((29,)))[:, 0]), 1.0)
    assert np.allclose(pose_map.root_location([0.0, 0.9, 0.0]), 0.0)


def test_other_parents_in_the_rig_come_back_too():
    ancestors = SKELETON.parents.copy()
    ancestors[SKELETON.index("lclavicle")] = SKELETON.index("lowerneck")
    ancestors[SKELETON.index("head")] = -1
    rest = random_rest(7)
    pose_map = axes.PoseMap(SKELETON, axes.RigRest(rest.heads, rest.axes, ancestors))
    quaternions = random_rotations(7, 3)
    bones = pose_map.bone_rotations(quaternions)
    assert np.max(rot.angle_between(pose_map.product_rotations(bones), quaternions)) < 1e-7


def test_a_rig_in_centimetres_with_y_up_is_recognised():
    pose_map = axes.PoseMap(SKELETON, random_rest(8, scale=100.0, turn=np.eye(3)))
    assert pose_map.armature_from_product.tolist() == np.eye(3).tolist()
    assert pose_map.units_per_metre == pytest.approx(100.0)


def test_a_leaning_rest_pose_is_still_upright():
    lean = rot.to_matrix(rot.from_rotation_vector([np.radians(8.0), 0.0, 0.0]))
    pose_map = axes.PoseMap(SKELETON, random_rest(9, turn=axes.BLENDER_FROM_PRODUCT @ lean))
    assert pose_map.armature_from_product.tolist() == axes.BLENDER_FROM_PRODUCT.tolist()


def test_a_rig_turned_in_its_own_space_is_followed():
    turn = axes.BLENDER_FROM_PRODUCT @ rot.to_matrix(rot.from_rotation_vector([0.0, np.radians(45.0), 0.0]))
    assert np.allclose(axes.PoseMap(SKELETON, random_rest(10, turn=turn)).armature_from_product, turn, atol=0.02)


def test_bones_on_top_of_each_other_are_refused():
    rest = random_rest(11)
    with pytest.raises(CharacterError, match="rest pose has no left and right"):
        axes.PoseMap(SKELETON, axes.RigRest(np.zeros((29, 3)), rest.axes, rest.ancestors))
