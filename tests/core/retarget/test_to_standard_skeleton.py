"""The product's motion is put on other skeletons, by names and rest poses of other programs, and mapped back."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from perfanim.core.body.motion import Motion
from perfanim.core.body.skeleton import Skeleton, forward_kinematics, joint_angles
from perfanim.core.body.source_motion import SourceMotion, source_kinematics
from perfanim.core.body.standard_skeleton import JOINT_NAMES, default_skeleton
from perfanim.core.errors import SkeletonError
from perfanim.core.formats.motion.bvh import read_bvh, write_bvh
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry import rotations as rot
from perfanim.core.retarget.bone_name_parser import parse_bone_name
from perfanim.core.retarget.file_joints import match_joints
from perfanim.core.retarget.to_standard_skeleton import to_standard_skeleton

Array = NDArray[np.float64]

MIXAMO = {
    "root": "mixamorig:Hips", "lowerback": "mixamorig:Spine", "upperback": "mixamorig:Spine1",
    "thorax": "mixamorig:Spine2", "lowerneck": "mixamorig:Neck", "head": "mixamorig:Head",
    **{f"{s}{ours}": f"mixamorig:{side}{theirs}" for s, side in (("l", "Left"), ("r", "Right")) for ours, theirs in {
        "clavicle": "Shoulder", "humerus": "Arm", "radius": "ForeArm", "hand": "Hand", "fingers": "HandMiddle1",
        "thumb": "HandThumb1", "femur": "UpLeg", "tibia": "Leg", "foot": "Foot", "toes": "ToeBase"}.items()},
}  # fmt: skip
VRM = {
    "root": "J_Bip_C_Hips", "lowerback": "J_Bip_C_Spine", "upperback": "J_Bip_C_Chest", "thorax": "J_Bip_C_UpperChest",
    "lowerneck": "J_Bip_C_Neck", "head": "J_Bip_C_Head",
    **{f"{s}{ours}": f"J_Bip_{s.upper()}_{theirs}" for s in "lr" for ours, theirs in {
        "clavicle": "Shoulder", "humerus": "UpperArm", "radius": "LowerArm", "hand": "Hand", "fingers": "Middle1",
        "thumb": "Thumb1", "femur": "UpperLeg", "tibia": "LowerLeg", "foot": "Foot", "toes": "ToeBase"}.items()},
}  # fmt: skip
BANDAI = {
    "root": "Hips", "upperback": "Spine", "thorax": "Chest", "lowerneck": "Neck", "head": "Head",
    **{f"{s}{ours}": f"{theirs}_{s.upper()}" for s in "lr" for ours, theirs in {
        "clavicle": "Shoulder", "humerus": "UpperArm", "radius": "LowerArm", "hand": "Hand",
        "femur": "UpperLeg", "tibia": "LowerLeg", "foot": "Foot", "toes": "Toes"}.items()},
}  # fmt: skip
DAZ = {
    "root": "hip", "upperback": "abdomen", "thorax": "chest", "lowerneck": "neck", "head": "head",
    **{f"{s}{ours}": f"{s}{theirs}" for s in "lr" for ours, theirs in {
        "clavicle": "Collar", "humerus": "Shldr", "radius": "ForeArm", "hand": "Hand", "femur": "Thigh",
        "tibia": "Shin", "foot": "Foot", "toes": "Toe"}.items()},
}  # fmt: skip
BIOVISION = {
    "root": "Hips", "thorax": "Chest", "lowerneck": "Neck", "head": "Head",
    **{f"{s}{ours}": f"{side}{theirs}" for s, side in (("l", "Left"), ("r", "Right")) for ours, theirs in {
        "clavicle": "Collar", "humerus": "Shoulder", "radius": "Elbow", "hand": "Wrist", "femur": "Hip",
        "tibia": "Knee", "foot": "Ankle"}.items()},
}  # fmt: skip
CMU_BVH = {name: other.replace("mixamorig:", "") for name, other in MIXAMO.items()} | {
    "lowerback": "LowerBack", "upperback": "Spine", "thorax": "Spine1", "lowerneck": "Neck", "upperneck": "Neck1",
}  # fmt: skip


def moving(frames: int = 30, seed: int = 5) -> Motion:
    """A motion in which only joints that all programs have are turned, elbows about their hinge."""
    generator = np.random.default_rng(seed)
    skeleton = default_skeleton()
    rotations = rot.identity((frames, len(skeleton)))
    still = ("lowerback", "upperback", "lowerneck", "upperneck", "wrist", "fingers", "thumb", "toes", "hand", "radius")
    for joint, name in enumerate(JOINT_NAMES):
        if name not in still and name[1:] not in still:
            rotations[:, joint] = rot.from_rotation_vector(generator.normal(0.0, 0.4, (frames, 3)))
    return Motion("moving", 60.0, skeleton, rotations, generator.normal(0.0, 1.0, (frames, 3)))


def as_source(
    motion: Motion, names: Mapping[str, str], rest_turns: Mapping[str, Array] | None = None, extra_root: bool = False
) -> SourceMotion:
    """Return the motion as a file of another program would hold it.

    Args:
        names: product joint -> the file's joint; others are left out.
        rest_turns: product joint -> turn of its bone in the file's rest pose relative to the product's.
    """
    turns = {name: rot.identity() for name in JOINT_NAMES} | dict(rest_turns or {})
    positions, world = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    kept = [name for name in JOINT_NAMES if name in names]
    parents, offsets, local, theirs = [], [], [], {}
    for name in kept:
        joint = JOINT_NAMES.index(name)
        theirs[name] = rot.multiply(world[:, joint], rot.conjugate(turns[name]))
        above = int(motion.skeleton.parents[joint])
        while above >= 0 and JOINT_NAMES[above] not in names:
            above = int(motion.skeleton.parents[above])
        parents.append(kept.index(JOINT_NAMES[above]) if above >= 0 else -1)
        if above < 0:
            offsets.append(np.zeros(3))
            local.append(theirs[name])
            continue
        back = rot.conjugate(theirs[JOINT_NAMES[above]])
        offsets.append(np.mean(rot.rotate(back, positions[:, joint] - positions[:, above]), axis=0))
        local.append(rot.multiply(back, theirs[name]))
    rows = [names[name] for name in kept]
    paths = {0: motion.root_positions_m}
    if extra_root:
        parents = [-1, *(parent + 1 for parent in parents)]
        offsets, rows = [np.zeros(3), *offsets], ["joint_Root", *rows]
        local, paths = [rot.identity((motion.frames,)), *local], {0: np.zeros((motion.frames, 3)), 1: paths[0]}
    return SourceMotion(
        name="other", where="other.bvh", fps=motion.fps, names=tuple(rows), parents=np.array(parents),
        offsets_m=np.array(offsets), tips_m=np.zeros((len(rows), 3)), rotations=np.stack(local, axis=1),
        translations_m=paths, euler_orders=("ZXY",) * len(rows), metres_per_unit=1.0,
    )  # fmt: skip


def t_pose_turns() -> dict[str, Array]:
    """Turns of a T pose with straight legs and elbows that hinge about the vertical, as most programs have it."""
    turns = {}
    for side, sign in (("l", 1.0), ("r", -1.0)):
        spread = rot.from_rotation_vector(np.radians([0.0, 0.0, -20.0 * sign]))
        roll = rot.from_rotation_vector(np.radians([30.0, 0.0, 0.0]))
        turns |= {side + name: spread for name in ("femur", "tibia", "foot", "toes")}
        turns |= {side + name: roll for name in ("humerus", "radius")}
    return turns


def a_pose_turns() -> dict[str, Array]:
    turns = t_pose_turns()
    for side, sign in (("l", 1.0), ("r", -1.0)):
        down = rot.from_rotation_vector(np.radians([0.0, 0.0, -45.0 * sign]))
        for name in ("humerus", "radius", "hand", "fingers", "thumb"):
            turns[side + name] = rot.multiply(down, turns.get(side + name, rot.identity()))
    return turns


@pytest.mark.parametrize("names", [MIXAMO, VRM, BANDAI, DAZ, BIOVISION, CMU_BVH])
def test_joints_are_told_by_their_names(names: dict[str, str]) -> None:
    source = as_source(moving(2), names, t_pose_turns())
    assert {name: source.names[joint] for name, joint in match_joints(source).items()} == names


@pytest.mark.parametrize("names", [MIXAMO, VRM, DAZ, BIOVISION, CMU_BVH])
@pytest.mark.parametrize("turns", [t_pose_turns(), a_pose_turns()])
def test_positions_and_rotations_come_back(names: dict[str, str], turns: dict[str, Array]) -> None:
    motion = moving()
    source = as_source(motion, names, turns, extra_root=True)
    mapped = to_standard_skeleton(source)
    expected = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    positions, world = forward_kinematics(mapped.skeleton, mapped.rotations, mapped.root_positions_m)
    for name in names:
        joint = JOINT_NAMES.index(name)
        assert np.abs(positions[:, joint] - expected[0][:, joint]).max() < 1e-9
        assert np.degrees(rot.angle_between(world[:, joint], expected[1][:, joint])).max() < 0.5
    assert mapped.fps == motion.fps


def test_mapping_the_own_skeleton_changes_nothing() -> None:
    motion = moving()
    mapped = to_standard_skeleton(as_source(motion, {name: name for name in JOINT_NAMES}))
    np.testing.assert_allclose(mapped.rotations, motion.rotations, atol=1e-14)
    np.testing.assert_allclose(mapped.skeleton.offsets_m, motion.skeleton.offsets_m, atol=1e-12)


@pytest.mark.parametrize("turn", [0.5, 1.0, -0.5])
def test_a_body_that_faces_elsewhere_in_its_rest_pose(turn: float) -> None:
    about_up = rot.from_rotation_vector(np.array([0.0, np.pi * turn, 0.0]))
    motion = moving()
    turns = {name: rot.multiply(about_up, t_pose_turns().get(name, rot.identity())) for name in JOINT_NAMES}
    mapped = to_standard_skeleton(as_source(motion, MIXAMO, turns))
    world = forward_kinematics(mapped.skeleton, mapped.rotations, mapped.root_positions_m)[1]
    expected = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)[1]
    for name in MIXAMO:
        joint = JOINT_NAMES.index(name)
        assert np.degrees(rot.angle_between(world[:, joint], expected[:, joint])).max() < 0.5


def test_z_up_files_are_turned_upright() -> None:
    motion = moving()
    upright = as_source(motion, MIXAMO, t_pose_turns())
    tip = rot.from_rotation_vector(np.array([0.5 * np.pi, 0.0, 0.0]))
    rotations = upright.rotations.copy()
    rotations[:, 0] = rot.multiply(tip, rotations[:, 0])
    path = rot.rotate(tip, upright.translations_m[0])
    tipped = SourceMotion(
        **{**upright.__dict__, "rotations": rotations, "translations_m": {0: path}}  # type: ignore[arg-type]
    )
    mapped, expected = to_standard_skeleton(tipped), to_standard_skeleton(upright)
    assert rot.angle_between(mapped.rotations, expected.rotations).max() < 1e-6
    np.testing.assert_allclose(mapped.root_positions_m, expected.root_positions_m, atol=1e-9)


def test_forearm_twist_goes_to_the_wrist() -> None:
    motion = moving()
    rotations = motion.rotations.copy()
    wrist, hand = JOINT_NAMES.index("lwrist"), JOINT_NAMES.index("lhand")
    rotations[:, wrist] = rot.from_rotation_vector(np.outer(np.linspace(-1.0, 1.0, motion.frames), [1.0, 0.0, 0.0]))
    rotations[:, hand] = rot.from_rotation_vector(np.outer(np.linspace(-0.5, 0.5, motion.frames), [0.0, 0.0, 1.0]))
    twisted = Motion("twisted", 60.0, motion.skeleton, rotations, motion.root_positions_m)
    mapped = to_standard_skeleton(as_source(twisted, MIXAMO, t_pose_turns()))
    assert np.degrees(rot.angle_between(mapped.rotations[:, wrist], rotations[:, wrist])).max() < 0.5
    assert np.degrees(rot.angle_between(mapped.rotations[:, hand], rotations[:, hand])).max() < 0.5


def as_bvh(tmp_path: Path, change: Callable[[str], str] = str, sockets: bool = False) -> str:
    """Return a BVH file of moving joints with names of Biovision, changed as a text.

    Args:
        sockets: A joint of length 0 that does not turn is above each hip.
    """
    source = as_source(moving(), BIOVISION | {"ltoes": "LeftToe", "rtoes": "RightToe"})
    names, parents, rotations = list(source.names), source.parents.copy(), source.rotations
    still, end = rot.identity((len(rotations), 2)), np.zeros((2, 3))
    if sockets:
        for hip in (names.index("LeftHip"), names.index("RightHip")):
            names.append(f"{names[hip][0]}HipJoint")
            parents = np.append(parents, parents[hip])
            parents[hip] = len(names) - 1
        order = [0, len(names) - 2, len(names) - 1, *range(1, len(names) - 2)]
        new = np.argsort(order)
        parents = np.array([new[parents[joint]] if parents[joint] >= 0 else -1 for joint in order])
        names = [names[joint] for joint in order]
        rotations = np.concatenate((rotations, still), axis=1)[:, order]
        offsets, tips = (np.concatenate((each, end))[order] for each in (source.offsets_m, source.tips_m))
    else:
        offsets, tips = source.offsets_m, source.tips_m
    motion = Motion("a", 60.0, Skeleton(tuple(names), parents, offsets, tips), rotations, source.translations_m[0])
    path = tmp_path / "b.bvh"
    write_bvh(motion, path)
    path.write_text(change(path.read_text()))
    return str(path)


def without_sides(text: str) -> str:
    return text.replace("Left", "").replace("Right", "")


def with_commas(text: str) -> str:
    return text.replace(".", ",")


@pytest.mark.parametrize(("change", "sockets"), [(str, True), (without_sides, False), (with_commas, False)])
def test_files_of_odd_programs_are_the_same_motion(tmp_path: Path, change: Callable[[str], str], sockets: bool) -> None:
    right = read_motion(as_bvh(tmp_path))
    motion = read_motion(as_bvh(tmp_path, change, sockets))
    np.testing.assert_allclose(motion.rotations, right.rotations, atol=1e-6)
    np.testing.assert_allclose(motion.skeleton.offsets_m, right.skeleton.offsets_m, atol=1e-6)


def test_equal_names_whose_sides_cannot_be_told_are_refused(tmp_path: Path) -> None:
    with pytest.raises(
        SkeletonError, match=r"b.bvh: two joints are called '\w+', and their sides are not named; name the sides"
    ):
        read_motion(as_bvh(tmp_path, lambda text: without_sides(text).replace("Toe", "Pad")))


def test_a_skeleton_without_arms_is_refused() -> None:
    names = {name: other for name, other in MIXAMO.items() if name[1:] not in ("humerus", "radius")}
    with pytest.raises(SkeletonError, match="lradius, rradius"):
        to_standard_skeleton(as_source(moving(2), names))


def test_a_zero_pose_that_is_no_body_is_refused() -> None:
    lying = {name: rot.from_rotation_vector(np.array([0.0, 0.0, 2.0])) for name in JOINT_NAMES if name[1:] == "femur"}
    with pytest.raises(SkeletonError, match="rest pose"):
        motion = moving(2)
        crossed = motion.rotations.copy()
        crossed[0, JOINT_NAMES.index("lfemur")] = lying["lfemur"]
        crossed[0, JOINT_NAMES.index("rfemur")] = rot.conjugate(lying["lfemur"])
        bent = Motion("bent", 60.0, motion.skeleton, crossed, motion.root_positions_m)
        turns = {
            "lfemur": rot.conjugate(lying["lfemur"]),
            "rfemur": lying["lfemur"],
            "root": rot.conjugate(lying["lfemur"]),
        }
        to_standard_skeleton(as_source(bent, MIXAMO, {**turns, "thorax": lying["lfemur"]}))


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("mixamorig:LeftUpLeg", ("l", "upleg")),
        ("Character1_RightForeArm", ("r", "forearm")),
        ("UpperArm_L", ("l", "upperarm")),
        ("thigh.R", ("r", "thigh")),
        ("lfemur", ("l", "femur")),
        ("rShldr", ("r", "shldr")),
        ("LHipJoint", ("l", "hip")),
        ("Bip01 L Thigh", ("l", "thigh")),
        ("lowerback", ("", "lowerback")),
        ("Spine1", ("", "spine")),
        ("root", ("", "root")),
        ("Armature|Hips", ("", "hips")),
    ],
)
def test_names_are_cut_into_side_and_words(name: str, expected: tuple[str, str]) -> None:
    parsed = parse_bone_name(name)
    assert (parsed.side, parsed.words) == expected


def test_bandai_clips(bandai_dir: Path) -> None:
    """Positions are kept; limbs bend the right way; feet stand flat; palms face the thighs of hanging arms."""
    paths = [path for part in ("dataset-1", "dataset-2") for path in sorted((bandai_dir / part).glob("*.bvh"))[::120]]
    assert len(paths) >= 14
    flexion, feet, palms = [], [], []
    for path in paths:
        source = read_bvh(path)
        mapped = to_standard_skeleton(source)
        found = match_joints(source)
        assert len(found) == 21
        positions, world = forward_kinematics(mapped.skeleton, mapped.rotations, mapped.root_positions_m)
        theirs, _ = source_kinematics(source)
        for name, joint in found.items():
            assert np.abs(positions[:, JOINT_NAMES.index(name)] - theirs[:, joint]).max() < 1e-6
        angles = dict(zip(JOINT_NAMES, joint_angles(mapped.skeleton, mapped.rotations), strict=True))
        flexion.append(np.concatenate([angles[name] for name in ("ltibia", "rtibia", "lradius", "rradius")], axis=-1))
        foot = JOINT_NAMES.index("lfoot")
        still = np.linalg.norm(np.gradient(positions[:, foot], axis=0), axis=-1) * mapped.fps < 0.04
        feet.append(rot.rotate(world[still, foot], np.array([0.0, 0.0, 1.0]))[:, 1])
        arm, hand = JOINT_NAMES.index("lhumerus"), JOINT_NAMES.index("lhand")
        forearm = JOINT_NAMES.index("lradius")
        hangs = np.all(rot.rotate(world[:, [arm, forearm]], np.array([1.0, 0.0, 0.0]))[..., 1] < -0.9, axis=-1)
        palm = rot.rotate(world[hangs, hand], np.array([0.0, -1.0, 0.0]))
        palms.append(np.sum(palm * rot.rotate(world[hangs, 0], np.array([-1.0, 0.0, 0.0])), axis=-1))
    bent = np.degrees(np.concatenate(flexion))
    assert np.percentile(bent, 1) > -5.0
    assert np.percentile(bent, 99) > 60.0
    assert abs(float(np.degrees(np.arcsin(np.median(np.concatenate(feet)))))) < 5.0
    assert np.median(np.concatenate(palms)) > 0.5


def test_read_motion_finds_the_skeleton_beside(cmu_dir: Path) -> None:
    motion = read_motion(cmu_dir / "35" / "35_01.amc")
    assert motion.skeleton.names == JOINT_NAMES
    assert motion.fps == 120.0
