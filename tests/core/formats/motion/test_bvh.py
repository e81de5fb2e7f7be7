from pathlib import Path

import numpy as np
import pytest
from perfanim.core.body.motion import Motion
from perfanim.core.body.source_motion import source_kinematics
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import FormatError
from perfanim.core.formats.motion.bvh import UNITS, read_bvh, write_bvh
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry import rotations as rot
from perfanim.core.retarget.to_standard_skeleton import to_standard_skeleton
from small_files import BVH


def random_motion(frames: int = 40, seed: int = 3) -> Motion:
    generator = np.random.default_rng(seed)
    skeleton = default_skeleton()
    rotations = rot.from_rotation_vector(generator.normal(0.0, 0.7, (frames, len(skeleton), 3)))
    return Motion("random", 60.0, skeleton, rotations, generator.normal(0.0, 2.0, (frames, 3)))


@pytest.mark.parametrize("units", ["m", "cm", "in", "cmu"])
def test_round_trip(tmp_path: Path, units: str) -> None:
    motion = random_motion()
    write_bvh(motion, tmp_path / "a.bvh", units)
    again = to_standard_skeleton(read_bvh(tmp_path / "a.bvh"))
    assert again.skeleton.names == motion.skeleton.names
    assert np.degrees(rot.angle_between(again.rotations, motion.rotations)).max() < 1e-4
    assert np.abs(again.root_positions_m - motion.root_positions_m).max() < 1e-6
    assert np.abs(again.skeleton.offsets_m - motion.skeleton.offsets_m).max() < 1e-6
    assert np.abs(again.skeleton.tips_m[1:] - motion.skeleton.tips_m[1:]).max() < 1e-6
    assert again.fps == motion.fps


def test_gimbal_lock_round_trip(tmp_path: Path) -> None:
    motion = random_motion(4)
    rotations = motion.rotations.copy()
    rotations[:, 5] = rot.from_euler(np.array([0.3, 0.5 * np.pi, -0.4]), "ZXY")
    write_bvh(Motion("lock", 30.0, motion.skeleton, rotations, motion.root_positions_m), tmp_path / "a.bvh")
    again = to_standard_skeleton(read_bvh(tmp_path / "a.bvh"))
    assert np.degrees(rot.angle_between(again.rotations, rotations)).max() < 1e-4


def test_channels_are_read_in_their_order() -> None:
    source = read_bvh(BVH.encode(), "small", unit="m")
    assert source.names == ("mixamorig:Hips", "Left Leg", "Slider")
    assert source.euler_orders == ("ZXY", "YXZ", "XYZ")
    assert source.fps == 30.0
    expected = rot.from_euler(np.radians([40.0, 50.0, 60.0]), "YXZ")
    assert rot.angle_between(source.rotations[0, 1], expected) < 1e-12
    np.testing.assert_allclose(source.tips_m[1], [0.0, -0.6, 0.0])


def test_position_channels_replace_the_offset() -> None:
    source = read_bvh(BVH.encode(), "small", unit="m")
    positions, world = source_kinematics(source)
    np.testing.assert_allclose(positions[1, 0], [1.0, 2.0, 4.0])
    lift = rot.rotate(rot.conjugate(world[:, 0]), positions[:, 2] - positions[:, 0])
    np.testing.assert_allclose(lift, [[0.0, 0.5, 0.0], [0.0, 0.7, 0.0]], atol=1e-12)


def test_still_position_channels_are_the_offset() -> None:
    text = BVH.replace("0 0.7 0 4 5 6", "0 0.5 0 4 5 6").replace("OFFSET 0 0.5 0", "OFFSET 9 9 9")
    source = read_bvh(text.encode(), "small", unit="m")
    assert set(source.translations_m) == {0}
    np.testing.assert_allclose(source.offsets_m[2], [0.0, 0.5, 0.0])


@pytest.mark.parametrize("change", [("\n", "\r\n"), ("  ", "\t"), (" 2 3 10", "\t2  3\n10"), ("{", " {")])
def test_white_space_does_not_matter(change: tuple[str, str]) -> None:
    plain = read_bvh(BVH.encode(), "small", unit="m")
    other = read_bvh(BVH.replace(*change).encode(), "small", unit="m")
    np.testing.assert_array_equal(plain.rotations, other.rotations)
    np.testing.assert_array_equal(plain.offsets_m, other.offsets_m)


@pytest.mark.parametrize("unit", ["m", "cm", "in", "cmu"])
def test_unit_is_told_from_the_size_of_the_body(tmp_path: Path, unit: str) -> None:
    write_bvh(random_motion(2), tmp_path / "a.bvh", unit)
    assert read_bvh(tmp_path / "a.bvh").metres_per_unit == UNITS[unit]


def test_other_frame_count_is_noted() -> None:
    source = read_bvh(BVH.replace("Frames: 2", "Frames: 7").encode(), "small")
    assert source.frames == 2
    assert source.notes == ("declares 7 frames, but has 2",)


def test_a_motion_tells_that_its_file_was_cut_off(tmp_path: Path) -> None:
    write_bvh(Motion("a", 30.0, default_skeleton(), rot.identity((9, 29)), np.zeros((9, 3))), tmp_path / "a.bvh")
    text = (tmp_path / "a.bvh").read_text()
    (tmp_path / "a.bvh").write_text(text.replace("Frames: 9", "Frames: 900"))
    assert read_motion(tmp_path / "a.bvh").notes == ("a.bvh declares 900 frames, but has 9",)


def test_nan_stays_and_is_told() -> None:
    source = read_bvh(BVH.replace("1 2 4 11", "1 2 4 NaN").encode(), "small")
    np.testing.assert_array_equal(source.finite_frames, [True, False])


def test_every_cut_of_a_file_is_read_or_refused() -> None:
    outcomes = set()
    for end in range(0, len(BVH), 3):
        try:
            source = read_bvh(BVH[:end].encode(), "cut.bvh")
            outcomes.add("read")
            assert source.frames in (1, 2)
        except FormatError:
            outcomes.add("refused")
    assert outcomes == {"read", "refused"}


def test_nothing_is_left_when_the_unit_is_unknown(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="not a unit"):
        write_bvh(random_motion(2), tmp_path / "a.bvh", "parsec")
    assert list(tmp_path.iterdir()) == []


def test_bandai_file(bandai_dir: Path) -> None:
    source = read_bvh(bandai_dir / "dataset-1" / "dataset-1_bow_active_001.bvh")
    assert source.metres_per_unit == 0.01
    assert source.fps == 30.0
    assert set(source.translations_m) == {0, source.names.index("Hips")}


def test_equal_names_of_many_joints_are_numbered() -> None:
    joint = "JOINT a {\nOFFSET 0 1 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n"
    row = " ".join(["0"] * 3 * 1501)
    text = f"HIERARCHY\n{joint.replace('JOINT', 'ROOT')}{(joint + '}' + chr(10)) * 1500}}}\n"
    motion = f"MOTION\nFrames: 2\nFrame Time: 0.02\n{row}\n{row}\n"
    assert read_bvh((text + motion).encode()).names[-1] == "a_1501"
