"""Motion read back from a character, written again, and made with other adjustments."""

from dataclasses import replace

import numpy as np
import pytest
from figures import figure
from measures import pose_bones, to_performer
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.errors import CharacterError
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry import rotations as rot
from perfanim.core.retarget.bone_map import find_bone_map
from perfanim.core.retarget.character_fit import Adjustments, CharacterFit
from perfanim.core.retarget.character_motion import own_body_plan, read_poses, readjusted
from perfanim.core.retarget.character_skeleton import character_skeleton
from perfanim.core.retarget.retargeter import RootMotion, apply_plan, plan_retarget
from perfanim.core.system.assets import MOTION

REST = figure(arms_down_deg=45.0, seed=3)
MAP = find_bone_map(REST)


@pytest.fixture(scope="module")
def walk() -> Motion:
    return sliced(read_motion(MOTION / "walking-01-neutral.bvh"), 0, 60)


def test_what_is_read_and_written_again_is_the_same_pose(walk: Motion) -> None:
    made = plan_retarget(walk.skeleton, REST, MAP)
    pose = apply_plan(made, walk.rotations, walk.root_positions_m)
    again = apply_plan(own_body_plan(made), *read_poses(made, pose))
    heads, turns = pose_bones(REST, made, pose)
    same_heads, same_turns = pose_bones(REST, made, again)
    assert np.allclose(heads, same_heads, atol=1e-9)
    driven = list(made.joints.values())
    assert np.max(rot.angle_between(turns[:, driven], same_turns[:, driven])) < 1e-6


def test_root_motion_on_another_bone_is_refused(walk: Motion) -> None:
    with pytest.raises(CharacterError, match="on the root bone"):
        own_body_plan(plan_retarget(walk.skeleton, REST, MAP, RootMotion.ROOT_BONE))


def test_adjustments_are_the_same_now_and_afterwards(walk: Motion) -> None:
    """A pose made plainly and adjusted later is the one made with the adjustments; back again, it is the first."""
    chosen = Adjustments(-0.05, 8.0, 12.0, 6.0)
    fits = [CharacterFit(adjustments=each) for each in (Adjustments(), chosen)]
    plain, adjusted = (plan_retarget(walk.skeleton, REST, MAP, fit=fit) for fit in fits)
    poses = [apply_plan(made, walk.rotations, walk.root_positions_m) for made in (plain, adjusted)]
    own = character_skeleton("figure", REST, MAP.bones)
    plain_own, adjusted_own = (plan_retarget(own, REST, MAP, fit=fit) for fit in fits)
    later = readjusted(plain_own, adjusted_own, poses[0])
    back = readjusted(adjusted_own, plain_own, later)
    heads = [pose_bones(REST, plain, pose)[0] for pose in (*poses, later, back)]
    points = [to_performer(plain, each) for each in heads]
    hips, arm = MAP.bones["root"], MAP.bones["lhand"]
    lower = (points[0] - points[1])[:, REST.index[hips], 1]
    assert np.min(lower) > 0.03  # where a leg was too short for the floor, the hips were low before
    assert np.linalg.norm((points[1] - points[0])[:, REST.index[arm]], axis=-1).min() > 0.05
    assert np.median(np.abs(points[2] - points[1])) < 0.001
    feet = [REST.index[MAP.bones[side + name]] for side in "lr" for name in ("foot", "toes")]
    assert np.abs(points[2] - points[1])[:, feet].max() < 0.005
    assert np.abs(points[3] - points[0]).max() < 0.005


def test_the_soles_stay_on_the_floor_whatever_is_adjusted(walk: Motion) -> None:
    lowest = []
    for chosen in (Adjustments(), Adjustments(hip_height_m=-0.1), Adjustments(foot_pitch_deg=10.0)):
        made = plan_retarget(walk.skeleton, REST, MAP, fit=CharacterFit(adjustments=chosen))
        pose = apply_plan(made, walk.rotations, walk.root_positions_m)
        heads, turns = pose_bones(REST, made, pose)
        ends = heads + rot.rotate(
            rot.multiply(turns, rot.conjugate(rot.from_matrix(REST.axes))), REST.tails - REST.heads
        )
        bones = [made.joints[side + name] for side in "lr" for name in ("foot", "toes")]
        both = np.concatenate((heads[:, bones], ends[:, bones]), axis=1)
        lowest.append(both[..., 2].min(axis=1))
    assert np.abs(lowest[0]).max() < 0.005
    assert np.allclose(lowest[0], lowest[1], atol=1e-3)
    assert np.allclose(lowest[0], lowest[2], atol=1e-3)


def test_a_character_that_hangs_below_its_origin_stands_on_the_floor(walk: Motion) -> None:
    sunk = replace(REST, heads=REST.heads - [0.0, 0.0, 0.051], tails=REST.tails - [0.0, 0.0, 0.051])
    places = []
    for rest in (REST, sunk):
        made = plan_retarget(walk.skeleton, rest, MAP)
        pose = apply_plan(made, walk.rotations, walk.root_positions_m)
        places.append(pose_bones(rest, made, pose)[0][:, list(made.joints.values())])
    assert np.allclose(places[0], places[1], atol=1e-9)
