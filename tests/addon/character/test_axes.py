"""Between the product's space and Blender's: directions, bone axes, rigs of other shapes."""

import numpy as np
import pytest
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import CharacterError
from perfanim.core.geometry import rotations as rot
from perfanim.perfanim_addon.character import axes

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


def posed_axes(rest: axes.RigRest, bones: np.ndarray) -> np.ndarray:
    """Armature-from-bone rotations (F, J, 3, 3) as Blender chains them: rest, then pose."""
    posed = np.zeros((*bones.shape[:-1], 3, 3))
    for joint in np.argsort([depth(rest.ancestors, joint) for joint in range(len(rest.ancestors))], kind="stable"):
        above = rest.ancestors[joint]
        carried = rest.axes[joint] if above < 0 else posed[:, above] @ rest.axes[above].T @ rest.axes[joint]
        posed[:, joint] = carried @ rot.to_matrix(bones[:, joint])
    return posed


def depth(ancestors: np.ndarray, joint: int) -> int:
    return 0 if joint < 0 else 1 + depth(ancestors, int(ancestors[joint]))


def check_posed(rest: axes.RigRest, seed: int) -> None:
    """Posed by the map, each bone is turned from its rest axes by what turns the joint in the world."""
    quaternions = random_rotations(seed, 6)
    bones = axes.PoseMap(SKELETON, rest).bone_rotations(quaternions)
    _, world = forward_kinematics(SKELETON, quaternions, np.zeros((6, 3)))
    turn = axes.BLENDER_FROM_PRODUCT
    expected = turn @ rot.to_matrix(world) @ turn.T @ rest.axes
    assert np.allclose(posed_axes(rest, bones), expected)


@pytest.mark.parametrize("seed", [4, 5])
def test_bones_with_any_rolls_turn_as_the_joints_do(seed):
    rest = random_rest(seed)
    check_posed(rest, seed)
    roots = np.random.default_rng(seed).normal(size=(6, 3))
    location = axes.PoseMap(SKELETON, rest).root_location(roots)
    assert np.allclose(rest.heads[0] + location @ rest.axes[0].T, axes.points_to_blender(roots))


def test_rest_pose_leaves_every_bone_at_rest():
    pose_map = axes.PoseMap(SKELETON, random_rest(6))
    assert np.allclose(np.abs(pose_map.bone_rotations(rot.identity((29,)))[:, 0]), 1.0)
    assert np.allclose(pose_map.root_location([0.0, 0.9, 0.0]), 0.0)


def test_other_parents_in_the_rig_are_followed_too():
    ancestors = SKELETON.parents.copy()
    ancestors[SKELETON.index("lclavicle")] = SKELETON.index("lowerneck")
    ancestors[SKELETON.index("head")] = -1
    rest = random_rest(7)
    check_posed(axes.RigRest(rest.heads, rest.axes, ancestors), 7)


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
