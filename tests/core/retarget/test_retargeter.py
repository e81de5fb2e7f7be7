"""Motion on other characters: where hands and feet point, where feet stand, what carries the character."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from figures import PLAIN, figure
from measures import direction_errors_deg, pose_bones, slides_cm_s, to_performer
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import scaled
from perfanim.core.body.standing_on_floor import on_floor
from perfanim.core.errors import CharacterError
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry import rotations as rot
from perfanim.core.retarget.armature_rest import ArmatureRest
from perfanim.core.retarget.bone_map import find_bone_map
from perfanim.core.retarget.character_fit import CharacterFit, SkinPoints
from perfanim.core.retarget.retargeter import RetargetPlan, RootMotion, apply_plan, plan_retarget
from perfanim.core.system.assets import MOTION

DIRECTION_DEG = 3.0  # required: median of hands and feet
SLIDE_CM_S = 1.0  # required: more than the performer's


@lru_cache(maxsize=4)
def shipped(name: str) -> Motion:
    return sliced(read_motion(MOTION / f"{name}.bvh"), 0, 240)


def retargeted(motion: Motion, rest: ArmatureRest, root_motion: RootMotion = RootMotion.HIPS) -> tuple:
    made = plan_retarget(motion.skeleton, rest, find_bone_map(rest), root_motion)
    pose = apply_plan(made, motion.rotations, motion.root_positions_m)
    return made, pose, *pose_bones(rest, made, pose)


def check(motion: Motion, rest: ArmatureRest) -> None:
    made, pose, heads, turns = retargeted(motion, rest)
    errors = direction_errors_deg(motion, rest, made, turns)
    assert {side + kind for side in "lr" for kind in ("hand", "foot", "humerus", "radius")} <= errors.keys()
    for name in errors:
        if name[1:] not in ("femur", "tibia"):  # legs are bent to where the feet stand
            assert np.median(errors[name]) <= DIRECTION_DEG, name
    slide, own = slides_cm_s(motion, made, heads)
    assert slide <= own + SLIDE_CM_S
    # no bone turns faster than the performer's fastest joint does, but for what bending a knee adds
    steps = np.degrees(rot.angle_between(pose.rotations[1:], pose.rotations[:-1]))
    _, world = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    fastest = np.max(np.degrees(rot.angle_between(world[1:], world[:-1])))
    assert np.max(steps) <= 2.0 * fastest
    knees_bend_forward(made, heads)


def knees_bend_forward(made: RetargetPlan, heads: np.ndarray) -> None:
    """A knee lies before the line from hip to ankle, as the toes tell, in all but nearly straight legs."""
    points = to_performer(made, heads)
    for side in "lr":
        hip, knee, ankle, toes = (points[:, made.joints[side + name]] for name in ("femur", "tibia", "foot", "toes"))
        line = (ankle - hip) / np.linalg.norm(ankle - hip, axis=-1, keepdims=True)
        out = knee - hip - np.sum((knee - hip) * line, axis=-1, keepdims=True) * line
        shin = (ankle - knee) / np.linalg.norm(ankle - knee, axis=-1, keepdims=True)
        foot = toes - ankle - np.sum((toes - ankle) * shin, axis=-1, keepdims=True) * shin
        # a foot that is stretched along the shin points nowhere
        told = (np.linalg.norm(out, axis=-1) > 0.05) & (np.linalg.norm(foot, axis=-1) > 0.03)
        assert np.count_nonzero(told) > 10
        assert np.all(np.sum(out * foot, axis=-1)[told] > 0.0)


@pytest.mark.parametrize("clip", ["walking-01-neutral", "boxing-01-neutral"])
@pytest.mark.parametrize("arms_down_deg", [0.0, 45.0, 80.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_hands_feet_and_knees_are_the_performers(clip: str, arms_down_deg: float, seed: int) -> None:
    turn = rot.to_matrix(rot.from_rotation_vector(np.array([0.0, 0.0, 1.1]))) if seed else np.eye(3)
    check(shipped(clip), figure(arms_down_deg=arms_down_deg, frame=turn, scale=100.0 if seed else 1.0, seed=seed))


@pytest.mark.parametrize(("trial", "first", "last"), [("16_31", 0, 400), ("14_02", 1000, 2200)])
def test_recorded_walking_and_boxing(cmu_dir: Path, trial: str, first: int, last: int) -> None:
    found = next(path for path in cmu_dir.rglob(f"{trial}.amc"))
    check(sliced(read_motion(found), first, last), figure(arms_down_deg=45.0))


def test_the_performer_of_another_size_takes_the_same_steps() -> None:
    motion = shipped("walking-01-neutral")
    small = Motion(
        motion.name, motion.fps, scaled(motion.skeleton, 0.5), motion.rotations, 0.5 * motion.root_positions_m
    )
    rest = figure()
    _, _, heads, _ = retargeted(motion, rest)
    _, _, of_small, _ = retargeted(small, rest)
    assert np.allclose(heads, of_small, atol=1e-9)


def test_a_standing_performers_character_stands_on_its_ground() -> None:
    """The rest pose with the soles on the floor: hips as high as its legs allow, toes as high as in its rest pose."""
    motion = shipped("walking-01-neutral")
    made, _, heads, _ = retargeted(motion, figure())
    toes = heads[:, [made.joints["ltoes"], made.joints["rtoes"]], 2]
    assert np.percentile(toes.min(axis=1), 5) == pytest.approx(0.02, abs=0.03)


def test_heels_that_turn_with_the_shin_stay_on_the_floor() -> None:
    """As on robots and stiff boots: the shin leans back as the foot lands, and its heel would go into the floor."""
    motion, rest = on_floor(sliced(shipped("walking-01-neutral"), 0, 120)), figure(seed=1)
    bones, skins, heels = find_bone_map(rest), {}, {}
    for side in "lr":
        ankle = rest.heads[rest.index[bones.bones[side + "foot"]]]
        flat = [ankle * [1.0, 1.0, 0.0] + [across, ahead, 0.0] for across in (-0.04, 0.04) for ahead in (-0.18, 0.0)]
        heels[side] = ankle * [1.0, 1.0, 0.0] + [0.0, 0.1, 0.0]
        skins[side] = SkinPoints(
            np.array(flat), np.zeros(4), np.array([heels[side], ankle + np.array([0.0, 0.05, 0.0])])
        )
    lowest_mm = []
    for known in (False, True):
        shanks = {side: skin.shank if known else np.empty((0, 3)) for side, skin in skins.items()}
        fit = CharacterFit({side: replace(skin, shank=shanks[side]) for side, skin in skins.items()})
        made = plan_retarget(motion.skeleton, rest, bones, fit=fit)
        heads, turns = pose_bones(rest, made, apply_plan(made, motion.rotations, motion.root_positions_m))
        places = []
        for side, heel in heels.items():
            shank = rest.index[bones.bones[side + "tibia"]]
            since = rot.multiply(turns[:, shank], rot.conjugate(rot.from_matrix(rest.axes[shank])))
            places.append(to_performer(made, heads[:, shank] + rot.rotate(since, heel - rest.heads[shank]))[:, 1])
        lowest_mm.append(1000.0 * float(np.min(places)))
    assert lowest_mm[0] < -20.0  # as if the heel were not there
    assert lowest_mm[1] > -3.0


@pytest.mark.parametrize("root_motion", [RootMotion.ROOT_BONE, RootMotion.OBJECT])
def test_root_motion_changes_what_moves_but_not_the_body(root_motion: RootMotion) -> None:
    motion, rest = shipped("walking-01-neutral"), figure(arms_down_deg=45.0, seed=3)
    made, plain, heads, turns = retargeted(motion, rest)
    _, pose, moved_heads, moved_turns = retargeted(motion, rest, root_motion)
    driven = [made.joints[joint] for joint in made.joints]
    assert np.allclose(heads[:, driven], moved_heads[:, driven], atol=1e-9)
    assert np.max(rot.angle_between(turns[:, driven], moved_turns[:, driven])) < 1e-6
    assert np.ptp(plain.locations[:, 0], axis=0).max() > 1.0
    assert np.ptp(pose.locations[:, 0], axis=0).max() < 0.3  # what is left to the hips is their bobbing
    carried = moved_heads[:, 0] if root_motion is RootMotion.ROOT_BONE else pose.object_location
    assert np.ptp(carried[:, 2]) < 1e-9  # along the floor
    assert np.ptp(carried[:, :2], axis=0).max() > 1.0


@pytest.mark.parametrize("root_motion", list(RootMotion))
@pytest.mark.parametrize("held", [("hips",), ("hips", "ground")])
def test_hips_that_are_held_by_the_bone_above_are_moved_by_it(root_motion: RootMotion, held: tuple[str, ...]) -> None:
    motion, rest = shipped("walking-01-neutral"), figure(seed=3)
    made, _, heads, turns = retargeted(motion, rest)
    connected = replace(rest, connected=np.isin(rest.names, held))  # a bone without a parent is held by none
    carried, pose, moved_heads, moved_turns = retargeted(motion, connected, root_motion)
    assert carried.located == ("ground",)
    assert pose.locations.shape == (motion.frames, 1, 3)
    driven = list(made.joints.values())
    assert np.allclose(heads[:, driven], moved_heads[:, driven], atol=1e-9)
    assert np.max(rot.angle_between(turns[:, driven], moved_turns[:, driven])) < 1e-6


def test_without_a_root_bone_the_hips_carry_the_character() -> None:
    names = {joint: joint for joint in PLAIN if joint != "ground"}
    made, _, _, _ = retargeted(shipped("walking-01-neutral"), figure(names), RootMotion.ROOT_BONE)
    assert made.root_motion is RootMotion.HIPS
    assert made.located == ("hips",)


def test_a_single_frame_is_posed_like_many() -> None:
    motion = shipped("boxing-01-neutral")
    rest = figure(arms_down_deg=45.0, seed=2)
    for root_motion in RootMotion:
        made, pose, _, _ = retargeted(motion, rest, root_motion)
        one = apply_plan(made, motion.rotations[7], motion.root_positions_m[7])
        assert np.allclose(one.rotations, pose.rotations[7], atol=1e-12)
        assert np.allclose(one.locations, pose.locations[7], atol=1e-12)


@pytest.mark.parametrize(
    "left_out",
    [
        ("ltoes", "rtoes"),
        ("belly", "spine"),
        ("lclavicle", "rclavicle"),
        ("lfingers", "rfingers"),
        ("neck",),
        ("ground",),
    ],
)
def test_rigs_that_lack_bones_follow_with_the_others(left_out: tuple[str, ...]) -> None:
    motion = shipped("boxing-01-neutral")
    rest = figure({joint: joint for joint in PLAIN if joint not in left_out}, arms_down_deg=30.0)
    made, _, heads, turns = retargeted(motion, rest)
    errors = direction_errors_deg(motion, rest, made, turns)
    assert max(np.median(errors[name]) for name in errors if name[1:] not in ("femur", "tibia")) <= DIRECTION_DEG
    slide, own = slides_cm_s(motion, made, heads)
    assert slide <= own + SLIDE_CM_S


def test_a_long_spine_bends_evenly() -> None:
    """Bones between two that stand for joints take what lies between: each a part of the turn, in one plane."""
    motion = shipped("walking-01-neutral")
    bent = rot.identity((1, len(motion.skeleton)))
    bent[0, motion.skeleton.index("thorax")] = rot.from_rotation_vector(np.array([0.6, 0.0, 0.0]))
    pose = Motion("bow", 60.0, motion.skeleton, bent, np.array([[0.0, 1.0, 0.0]]))
    rest = figure()
    made, _, _, turns = retargeted(pose, rest)
    axes = rot.from_matrix(rest.axes)
    turned = rot.multiply(turns[0], rot.conjugate(axes))
    vectors = {name: rot.to_rotation_vector(turned[rest.index[name]]) for name in ("spine", "waist", "belly", "chest")}
    sideways = made.alignment.armature_from_world @ [1.0, 0.0, 0.0]
    # the waist is the upper back, which does not turn, and the belly lies a third of the way from it to the chest
    for name, angle in (("spine", 0.0), ("waist", 0.0), ("belly", 0.2), ("chest", 0.6)):
        assert np.allclose(vectors[name], angle * sideways, atol=5e-3), name


def test_helper_bones_between_those_of_the_spine_are_left_alone() -> None:
    names = {joint: joint for joint in PLAIN} | {"belly": "MCH-belly"}
    made, _, _, _ = retargeted(shipped("walking-01-neutral"), figure(names))
    assert "MCH-belly" not in made.bones
    assert "waist" in made.bones


def test_palms_lie_as_the_performers() -> None:
    """In the product's T pose, palms down: the thumb's side of each hand is in front, whatever the rest pose was."""
    skeleton = shipped("walking-01-neutral").skeleton
    still = Motion("t", 60.0, skeleton, rot.identity((1, len(skeleton))), np.array([[0.0, 1.0, 0.0]]))
    for arms_down_deg in (0.0, 60.0):
        made, _, heads, _ = retargeted(still, (rest := figure(arms_down_deg=arms_down_deg, seed=4)))
        points = to_performer(made, heads)[0]
        for side in "lr":
            across = points[rest.index[side + "index"]] - points[rest.index[side + "pinky"]]
            assert across[2] > 0.95 * np.linalg.norm(across[1:])


def test_legs_without_length_are_refused() -> None:
    rest = figure()
    flat = rest.heads.copy()
    for name in ("ltibia", "lfoot", "rtibia", "rfoot"):
        flat[rest.index[name]] = flat[rest.index[name[0] + "femur"]]
    made = find_bone_map(rest)
    squashed = replace(rest, heads=flat)
    with pytest.raises(CharacterError, match="legs have no length"):
        plan_retarget(shipped("walking-01-neutral").skeleton, squashed, made)
