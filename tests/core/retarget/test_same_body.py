"""Characters with the performer's joints and proportions: bones of any roll, rigs in other axes and units."""

from dataclasses import replace

import numpy as np
import pytest
from figures import armature
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import CharacterError
from perfanim.core.geometry import rotations as rot
from perfanim.core.retarget.armature_rest import ArmatureRest
from perfanim.core.retarget.bone_map import own_bone_map
from perfanim.core.retarget.retargeter import RetargetPlan, apply_plan, plan_retarget

SKELETON = default_skeleton()
Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def random_rest(seed: int, *, scale: float = 1.0, turn: np.ndarray = Z_UP) -> ArmatureRest:
    random = np.random.default_rng(seed)
    heads = scale * (SKELETON.rest_positions_m + np.array([0.0, 0.9, 0.0])) @ turn.T
    rest = armature(list(SKELETON.names), SKELETON.parents, heads, random)
    return replace(rest, axes=rot.to_matrix(rot.normalize(random.normal(size=(29, 4)))))


def plan(rest: ArmatureRest) -> RetargetPlan:
    return plan_retarget(SKELETON, rest, own_bone_map(rest.names), same_body=True)


def random_rotations(seed: int, *shape: int) -> np.ndarray:
    return rot.normalize(np.random.default_rng(seed).normal(size=(*shape, 29, 4)))


def posed_axes(rest: ArmatureRest, bones: np.ndarray) -> np.ndarray:
    """Armature-from-bone rotations (F, J, 3, 3) as Blender chains them: rest, then pose."""
    posed = np.zeros((*bones.shape[:-1], 3, 3))
    for joint, parent in enumerate(rest.parents):
        above = parent if rest.inherits_rotation[joint] else -1
        carried = rest.axes[joint] if above < 0 else posed[:, above] @ rest.axes[above].T @ rest.axes[joint]
        posed[:, joint] = carried @ rot.to_matrix(bones[:, joint])
    return posed


def check_posed(rest: ArmatureRest, seed: int) -> None:
    """Each bone is turned from its rest axes by what turns the joint in the world."""
    quaternions = random_rotations(seed, 6)
    bones = apply_plan(plan(rest), quaternions, np.zeros((6, 3))).rotations
    _, world = forward_kinematics(SKELETON, quaternions, np.zeros((6, 3)))
    expected = Z_UP @ rot.to_matrix(world) @ Z_UP.T @ rest.axes
    assert np.allclose(posed_axes(rest, bones), expected)


@pytest.mark.parametrize("seed", [4, 5])
def test_bones_with_any_rolls_turn_as_the_joints_do(seed: int) -> None:
    rest = random_rest(seed)
    assert plan(rest).is_direct
    check_posed(rest, seed)
    roots = np.random.default_rng(seed).normal(size=(6, 3))
    location = apply_plan(plan(rest), random_rotations(seed, 6), roots).locations[:, 0]
    assert np.allclose(rest.heads[0] + location @ rest.axes[0].T, roots @ Z_UP.T)


def test_rest_pose_leaves_every_bone_at_rest() -> None:
    pose = apply_plan(plan(random_rest(6)), rot.identity((29,)), [0.0, 0.9, 0.0])
    assert np.allclose(np.abs(pose.rotations[:, 0]), 1.0)
    assert np.allclose(pose.locations, 0.0)


def test_other_parents_in_the_rig_are_followed_too() -> None:
    rest = random_rest(7)
    parents, inherits = rest.parents.copy(), rest.inherits_rotation.copy()
    parents[SKELETON.index("lclavicle")] = SKELETON.index("lowerneck")
    inherits[SKELETON.index("head")] = False
    other = replace(rest, parents=parents, inherits_rotation=inherits)
    assert not plan(other).is_direct
    check_posed(other, 7)


def test_one_frame_is_the_same_as_in_a_motion() -> None:
    rest, rotations, roots = random_rest(12), random_rotations(12, 3), np.ones((3, 3))
    many, one = (apply_plan(plan(rest), *arrays) for arrays in ((rotations, roots), (rotations[1], roots[1])))
    assert np.array_equal(many.rotations[1], one.rotations)
    assert np.allclose(many.locations[1], one.locations, atol=1e-15)


def test_a_rig_in_centimetres_with_y_up_is_recognised() -> None:
    alignment = plan(random_rest(8, scale=100.0, turn=np.eye(3))).alignment
    assert alignment.armature_from_world.tolist() == np.eye(3).tolist()
    assert alignment.units_per_metre == pytest.approx(100.0)


def test_a_leaning_rest_pose_is_still_upright() -> None:
    lean = rot.to_matrix(rot.from_rotation_vector([np.radians(8.0), 0.0, 0.0]))
    alignment = plan(random_rest(9, turn=Z_UP @ lean)).alignment
    assert alignment.armature_from_world.tolist() == Z_UP.tolist()


def test_a_rig_turned_in_its_own_space_is_followed() -> None:
    turn = Z_UP @ rot.to_matrix(rot.from_rotation_vector([0.0, np.radians(45.0), 0.0]))
    assert np.allclose(plan(random_rest(10, turn=turn)).alignment.armature_from_world, turn, atol=0.02)


def test_bones_on_top_of_each_other_are_refused() -> None:
    rest = random_rest(11)
    with pytest.raises(CharacterError, match="left and right of the rest pose are unclear"):
        plan(replace(rest, heads=np.zeros((29, 3))))
