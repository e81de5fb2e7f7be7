"""Motion under the names of other programs."""

import numpy as np
import pytest
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import JOINT_NAMES, mirrored_name
from perfanim.core.errors import SettingsError
from perfanim.core.formats.motion.bvh import read_bvh, write_bvh
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.formats.vmc.humanoid import BONES
from perfanim.core.geometry import rotations as rot
from perfanim.core.retarget.displayed_joint_names import NAMINGS, naming_of, rename_joints


@pytest.mark.parametrize("naming", NAMINGS)
def test_every_joint_has_a_name_and_both_sides_are_called_alike(naming):
    names = NAMINGS[naming]
    assert tuple(names) == JOINT_NAMES
    assert len(set(names.values())) == len(JOINT_NAMES)
    for joint, name in names.items():
        other = names[mirrored_name(joint)]
        assert (name == other) == (joint == mirrored_name(joint))
        assert len(other) in (len(name), len(name) + 1, len(name) - 1)  # left and right


def test_vrm_names_are_its_bones(tmp_path):
    bones = {joint: bone[0].lower() + bone[1:] for bone, (joint, _) in BONES.items()}
    assert {joint: name for joint, name in NAMINGS["vrm"].items() if joint in bones} == bones


@pytest.mark.parametrize("naming", NAMINGS)
@pytest.mark.parametrize("units", ["m", "cm"])
def test_a_file_has_the_names_and_is_read_as_the_same_motion(truth, tmp_path, naming, units):
    path = tmp_path / "walk.bvh"
    write_bvh(rename_joints(truth, naming), path, units)
    assert set(read_bvh(path).names) == set(NAMINGS[naming].values())
    again = read_motion(path)
    assert again.skeleton.names == JOINT_NAMES
    assert np.degrees(rot.angle_between(again.rotations, truth.rotations)).max() < 1e-5
    places = [forward_kinematics(m.skeleton, m.rotations, m.root_positions_m)[0] for m in (again, truth)]
    assert np.abs(places[0] - places[1]).max() < 1e-5


def test_a_body_of_that_program_with_all_the_names_is_not_taken_for_the_products(truth, tmp_path):
    """Unreal's mannequin has the twist bone beside the hand, not above it."""
    path = tmp_path / "walk.bvh"
    write_bvh(rename_joints(truth, "unreal"), path)
    text = path.read_text()
    for side in "lr":
        text = text.replace(f"JOINT hand_{side}\n", "JOINT swapped\n")
        text = text.replace(f"JOINT lowerarm_twist_01_{side}\n", f"JOINT hand_{side}\n")
        text = text.replace("JOINT swapped\n", f"JOINT lowerarm_twist_01_{side}\n")
    path.write_text(text)
    again = read_motion(path)
    hands = [
        forward_kinematics(m.skeleton, m.rotations, m.root_positions_m)[0][:, m.skeleton.index(joint)]
        for m, joint in ((again, "lhand"), (truth, "lwrist"))
    ]
    assert np.abs(hands[0] - hands[1]).max() < 1e-5


def test_an_unknown_naming_is_told():
    with pytest.raises(SettingsError, match="choose one of cmu, blender, unreal, vrm, mixamo"):
        naming_of("maya")
