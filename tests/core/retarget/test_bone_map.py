"""Bone maps found by names and by shape, of rigs drawn here and of others' layouts."""

from pathlib import Path

import numpy as np
import pytest
from figures import PLAIN, armature, figure
from mpfb_layouts import layout
from perfanim.core.errors import CharacterError
from perfanim.core.retarget.bone_map import MatchState, checked_map, find_bone_map
from perfanim.core.retarget.bone_map_files import read_presets

SPINE = ("root", "lowerback", "upperback", "thorax", "lowerneck", "head")
SPINE_PLACES = ("hips", "spine", "belly", "chest", "neck", "head")
LIMB = ("clavicle", "humerus", "radius", "hand", "femur", "tibia", "foot", "toes")

NAMES = {
    "mixamo": (
        "Hips Spine Spine1 Spine2 Neck Head",
        "Shoulder Arm ForeArm Hand UpLeg Leg Foot ToeBase",
        "mixamorig:{S}{n}",
    ),
    "unreal": (
        "pelvis spine_01 spine_02 spine_03 neck_01 head",
        "clavicle upperarm lowerarm hand thigh calf foot ball",
        "{n}_{s}",
    ),
    "rigify metarig": (
        "spine spine.001 spine.002 spine.003 spine.004 spine.005",
        "shoulder upper_arm forearm hand thigh shin foot toe",
        "{n}.{U}",
    ),
    "rigify deform": (
        "DEF-spine DEF-spine.001 DEF-spine.002 DEF-spine.003 DEF-spine.004 DEF-spine.005",
        "shoulder upper_arm forearm hand thigh shin foot toe",
        "DEF-{n}.{U}",
    ),
    "makehuman": (
        "root spine05 spine03 spine01 neck01 head",
        "clavicle upperarm01 lowerarm01 wrist upperleg01 lowerleg01 foot toe1-1",
        "{n}.{U}",
    ),
    "vroid": (
        "J_Bip_C_Hips J_Bip_C_Spine J_Bip_C_Chest J_Bip_C_UpperChest J_Bip_C_Neck J_Bip_C_Head",
        "Shoulder UpperArm LowerArm Hand UpperLeg LowerLeg Foot ToeBase",
        "J_Bip_{U}_{n}",
    ),
    "rokoko": ("Hips Spine1 Spine2 Spine3 Neck Head", "Shoulder Arm ForeArm Hand Thigh Shin Foot Toe", "{S}{n}"),
    "cmu": (
        "root lowerback upperback thorax lowerneck head",
        "clavicle humerus radius hand femur tibia foot toes",
        "{s}{n}",
    ),
    "biped": (
        "Bip01_Pelvis Bip01_Spine Bip01_Spine1 Bip01_Spine2 Bip01_Neck Bip01_Head",
        "Clavicle UpperArm Forearm Hand Thigh Calf Foot Toe0",
        "Bip01 {U} {n}",
    ),
    "daz": (
        "hip abdomenLower abdomenUpper chestLower neckLower head",
        "Collar ShldrBend ForearmBend Hand ThighBend Shin Foot Toe",
        "{s}{n}",
    ),
}  # fmt: skip


def named(convention: str) -> tuple[dict[str, str], dict[str, str]]:
    """Plain joint -> name, and the product's joint -> name."""
    middle, limb, pattern = NAMES[convention]
    names = dict(zip(SPINE_PLACES, middle.split(), strict=True))
    wanted = dict(zip(SPINE, middle.split(), strict=True))
    for side, long in (("l", "Left"), ("r", "Right")):
        for joint, word in zip(LIMB, limb.split(), strict=True):
            names[side + joint] = wanted[side + joint] = pattern.format(s=side, U=side.upper(), S=long, n=word)
    return names, wanted


@pytest.mark.parametrize("convention", NAMES)
@pytest.mark.parametrize("arms_down_deg", [0.0, 50.0])
def test_names_of_each_convention_are_known(convention: str, arms_down_deg: float) -> None:
    names, wanted = named(convention)
    found = find_bone_map(figure(names, arms_down_deg=arms_down_deg), read_presets())
    assert found.bones == wanted
    assert found.complete


def test_helper_bones_and_namespaces_do_not_mislead() -> None:
    names, wanted = named("unreal")
    rest = figure({joint: f"hero:{name}" for joint, name in names.items()})
    helpers = ["hero:ik_hand_l", "hero:upperarm_twist_01_l", "hero:thigh_twist_01_l", "hero:ik_foot_l", "hero:breast_l"]
    parents = [0, rest.index["hero:upperarm_l"], rest.index["hero:thigh_l"], 0, rest.index["hero:spine_03"]]
    heads = np.concatenate((rest.heads, rest.heads[parents] + 0.01))
    both = armature([*rest.names, *helpers], [*rest.parents, *parents], heads, np.random.default_rng(1))
    found = find_bone_map(both)
    assert found.bones == {joint: f"hero:{bone}" for joint, bone in wanted.items()}


@pytest.mark.parametrize("frame", [np.eye(3), np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])])
@pytest.mark.parametrize("scale", [1.0, 100.0])
def test_shape_tells_what_names_do_not(frame: np.ndarray, scale: float) -> None:
    numbers = {joint: f"Bone.{place:03d}" for place, joint in enumerate(PLAIN)}
    found = find_bone_map(figure(numbers, arms_down_deg=30.0, frame=frame, scale=scale))
    assert found.origin == "shape"
    assert found.complete
    places = (
        dict(zip(SPINE, SPINE_PLACES, strict=True))
        | {"upperback": "waist"}
        | {s + joint: s + joint for s in "lr" for joint in LIMB}
    )
    assert found.bones == {joint: numbers[place] for joint, place in places.items()}


def test_sides_named_as_the_viewer_sees_them_are_swapped() -> None:
    names, _ = named("cmu")
    swapped = {
        joint: names[{"l": "r", "r": "l"}[joint[0]] + joint[1:]] if joint[1:] in LIMB else name
        for joint, name in names.items()
    }
    found = find_bone_map(figure(swapped))
    assert found.bones["lhand"] == "rhand"
    assert "feet" in found.matches["lhand"].reason


def test_a_bone_called_root_below_which_the_hips_have_another_name_carries_them() -> None:
    names, wanted = named("unreal")
    rest = figure(names | {"ground": "root", "hips": "bone_base"})
    assert find_bone_map(rest).bones == wanted | {"root": "bone_base"}


def test_a_spine_of_any_length_is_shared() -> None:
    names, _ = named("mixamo")
    for left_out, present in ((("belly",), ("upperback", "thorax")), (("spine", "belly"), ("thorax",))):
        found = find_bone_map(figure({joint: name for joint, name in names.items() if joint not in left_out}))
        assert [joint for joint in ("lowerback", "upperback", "thorax") if joint in found.bones] == list(present)
        assert found.complete


def test_four_legs_are_refused_with_the_reason() -> None:
    names = ["hip", "chest", "head", "tail"]
    heads = [(0, 0.4, 0.5), (0, -0.3, 0.5), (0, -0.6, 0.7), (0, 0.8, 0.4)]
    parents = [-1, 0, 1, 0]
    for side, x in (("Left", 0.1), ("Right", -0.1)):
        for bones, at, above in (("UpperArm ForeArm Hand", -0.3, 1), ("Leg01 Leg02 Foot", 0.4, 0)):
            for place, word in enumerate(bones.split()):
                names.append(f"b_{side}{word}")
                parents.append(above if place == 0 else len(names) - 2)
                heads.append((x, at, 0.5 - 0.22 * place))
    with pytest.raises(CharacterError, match=r"not a biped: its trunk leans \d\d degrees"):
        find_bone_map(armature(names, parents, np.array(heads), np.random.default_rng(0)))


def test_a_lone_bone_is_refused() -> None:
    with pytest.raises(CharacterError, match="the armature is not recognised as a biped"):
        find_bone_map(armature(["Bone"], [-1], np.zeros((1, 3)), np.random.default_rng(0)))


def test_doubtful_joints_say_why() -> None:
    names, wanted = named("unreal")
    rest = figure(names)
    twice = checked_map(rest, wanted | {"lhand": "lowerarm_l"}, "chosen by hand")
    assert twice.matches["lhand"].state is MatchState.SUSPECT
    assert "lradius" in twice.matches["lhand"].reason
    crossed = checked_map(rest, wanted | {"lfoot": "foot_r", "rfoot": "foot_l"}, "chosen by hand")
    assert {crossed.matches[side + "foot"].state for side in "lr"} == {MatchState.SUSPECT}
    assert not crossed.complete
    with pytest.raises(CharacterError, match="no bone nose"):
        checked_map(rest, wanted | {"head": "nose"}, "chosen by hand")
    with pytest.raises(CharacterError, match="no bone is given for Thigh L"):
        checked_map(rest, {joint: bone for joint, bone in wanted.items() if joint != "lfemur"}, "chosen by hand")


@pytest.mark.parametrize(
    "name",
    [
        "rigify/rig.human", "rigify/rig.human_toes", "standard/rig.cmu_mb", "standard/rig.default",
        "standard/rig.default_no_toes", "standard/rig.game_engine", "standard/rig.game_engine_with_breast",
        "standard/rig.mixamo", "standard/rig.mixamo_unity",
    ],
)  # fmt: skip
def test_layouts_of_mpfb_map_completely(shared_dir: Path, name: str) -> None:
    found = find_bone_map(layout(shared_dir / "rigs/MPFB2_rigs/rigs" / f"{name}.json"), read_presets())
    assert found.complete
    assert {"lhand", "rhand", "ltoes", "rtoes", "lclavicle", "rclavicle", "lthumb", "rfingers"} <= found.bones.keys()


def test_a_layout_without_a_common_root_is_refused(shared_dir: Path) -> None:
    with pytest.raises(CharacterError, match="no common parent bone"):
        find_bone_map(layout(shared_dir / "rigs/MPFB2_rigs/rigs/standard/rig.openpose.json"))
