from pathlib import Path

import numpy as np
import pytest
from perfanim.core.body.motion import Motion
from perfanim.core.body.skeleton import forward_kinematics, joint_angles
from perfanim.core.body.standard_skeleton import JOINT_NAMES
from perfanim.core.errors import FormatError
from perfanim.core.formats.motion.amc import CMU_FPS, amc_motion, parse_amc_values
from perfanim.core.formats.motion.asf import AsfFile, parse_asf, read_asf
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry import rotations as rot
from small_files import AMC, ASF

UNIT = 0.0254 / 0.5


def parse_amc(content: bytes, where: str, asf: AsfFile) -> Motion:
    return amc_motion(parse_amc_values(content, where, asf), asf, CMU_FPS, "a")


def rz(degrees: float) -> np.ndarray:
    return rot.from_rotation_vector(np.radians([0.0, 0.0, degrees]))


def test_zero_dof_bones_are_folded_into_offsets() -> None:
    skeleton = parse_asf(ASF.encode(), "a.asf").skeleton
    assert skeleton.names == ("root", "lfemur", "ltibia")
    np.testing.assert_allclose(skeleton.offsets_m, np.array([[0, 0, 0], [2, 0, 0], [0, -10, 0]]) * UNIT)
    np.testing.assert_allclose(skeleton.tips_m[2], np.array([0, -8, 0]) * UNIT)
    assert skeleton.angle_orders == ("ZYX", "ZYX", "X")


def test_values_are_angles_about_fixed_axes_in_the_bone_frame() -> None:
    motion = parse_amc(AMC.encode(), "a.amc", parse_asf(ASF.encode(), "a.asf"))
    x, y, z = (
        rot.from_rotation_vector(np.radians(angle) * axis) for angle, axis in zip((5, 15, 25), np.eye(3), strict=True)
    )
    inner = rot.multiply(z, rot.multiply(y, x))
    expected = rot.multiply(rz(30), rot.multiply(inner, rz(-30)))
    assert rot.angle_between(motion.rotations[0, 1], expected) < 1e-9
    np.testing.assert_allclose(motion.root_positions_m, np.array([[1, 2, 3], [1, 2, 4]]) * UNIT)
    assert motion.fps == 120.0


def test_joint_angles_give_the_values_back() -> None:
    motion = parse_amc(AMC.encode(), "a.amc", parse_asf(ASF.encode(), "a.asf"))
    angles = [np.degrees(a) for a in joint_angles(motion.skeleton, motion.rotations)]
    np.testing.assert_allclose(angles[0][0], [30, 20, 10], atol=1e-9)
    np.testing.assert_allclose(angles[1][0], [25, 15, 5], atol=1e-9)
    np.testing.assert_allclose(angles[2][:, 0], [40, 41], atol=1e-9)


def test_frames_with_nan_are_no_motion() -> None:
    asf = parse_asf(ASF.encode(), "a.asf")
    content = AMC.replace("ltibia 41", "ltibia nan").encode()
    assert np.isnan(parse_amc_values(content, "a.amc", asf).values).sum() == 1
    with pytest.raises(FormatError, match="not a unit quaternion"):
        parse_amc(content, "a.amc", asf)


def test_few_numbers_for_many_joints_are_refused_before_there_are_poses() -> None:
    bone = "begin\nname b{}\ndirection 0 1 0\nlength 1\ndof rx\nend\n"
    links = "".join(f"root b{number}\n" for number in range(1999))
    bones = "".join(bone.format(number) for number in range(1999))
    asf = parse_asf(f":bonedata\n{bones}:root\norder tx\n:hierarchy\n{links}".encode(), "a.asf")
    with pytest.raises(FormatError, match=r"a\.amc: has 20000 frames of 2000 joints, far more than its size allows"):
        parse_amc_values("".join(f"{frame}\nroot 1\n" for frame in range(1, 20_001)).encode(), "a.amc", asf)


def test_angles_that_jump_are_told_though_the_rotation_does_not() -> None:
    asf = parse_asf(ASF.encode(), "a.asf")
    jumping = AMC.replace("lfemur 5 15 25\nltibia 41", "lfemur -175 165 205\nltibia 41").encode()  # the same rotation
    assert parse_amc_values(jumping, "a.amc", asf).angle_jumps.tolist() == [False, True]
    assert parse_amc_values(AMC.encode(), "a.amc", asf).angle_jumps.tolist() == [False, False]
    plain, other = (parse_amc(text, "a.amc", asf) for text in (AMC.encode(), jumping))
    np.testing.assert_allclose(rot.angle_between(plain.rotations, other.rotations), 0.0, atol=1e-7)


def test_radians_windows_lines_tabs_and_blank_lines() -> None:
    asf = parse_asf(ASF.encode(), "a.asf")
    plain = parse_amc(AMC.encode(), "a.amc", asf)
    other = parse_amc(AMC.replace("\n", "\r\n").replace("root ", "root\t").encode(), "a.amc", asf)
    np.testing.assert_array_equal(plain.rotations, other.rotations)
    spaced = parse_amc(AMC.replace("\nlfemur", " \n\n   lfemur").rstrip().encode(), "a.amc", asf)
    np.testing.assert_array_equal(plain.rotations, spaced.rotations)
    radians = parse_amc(AMC.replace(":DEGREES", ":RADIANS").replace(" 41", " 0.5").encode(), "a.amc", asf)
    assert rot.angle_between(radians.rotations[1, 2], rot.identity()) == pytest.approx(0.5)


def test_bones_that_a_motion_leaves_out_stay_at_rest() -> None:
    motion = parse_amc(
        AMC.replace("ltibia 40\n", "").replace("ltibia 41\n", "").encode(), "a.amc", parse_asf(ASF.encode(), "a")
    )
    np.testing.assert_array_equal(motion.rotations[:, 2], rot.identity((2,)))


def test_missing_skeleton_file(tmp_path: Path) -> None:
    (tmp_path / "a.amc").write_text(AMC)
    with pytest.raises(FormatError, match=r"none\.asf: cannot be read"):
        read_motion(tmp_path / "a.amc", tmp_path / "none.asf")


def test_cmu_trial(cmu_dir: Path) -> None:
    motion = read_motion(cmu_dir / "14" / "14_02.amc", cmu_dir / "14" / "14.asf")
    assert motion.skeleton.names == JOINT_NAMES
    positions, _ = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    assert 1.4 < positions[0, motion.skeleton.index("head"), 1] < 1.7
    assert positions[..., motion.skeleton.index("ltoes"), 1].min() > -0.1
    assert sum(len(order) for order in motion.skeleton.angle_orders) + 3 == 62


def test_every_cmu_skeleton_reads(cmu_dir: Path) -> None:
    paths = sorted(cmu_dir.glob("*/*.asf"))
    assert len(paths) == 15
    for path in paths:
        skeleton = read_asf(path).skeleton
        assert skeleton.names == JOINT_NAMES
        leg = np.linalg.norm(skeleton.tips_m[[1, 2]], axis=1).sum()
        assert 0.7 < leg < 1.0
