import numpy as np
from perfanim.core.body.joint_angle_frames import with_angle_frames
from perfanim.core.body.mirroring import mirrored_behaviour, mirrored_points, mirrored_rotations, mirrored_skeleton
from perfanim.core.body.skeleton import Skeleton, forward_kinematics, joint_angles
from perfanim.core.body.standard_skeleton import JOINT_NAMES, default_skeleton, mirrored_name
from perfanim.core.geometry import rotations as rot

OTHER = [JOINT_NAMES.index(mirrored_name(name)) for name in JOINT_NAMES]


def uneven() -> Skeleton:
    """A body whose left side is not its right one's image."""
    skeleton = with_angle_frames(default_skeleton())
    generator = np.random.default_rng(1)
    offsets, tips = (
        array + generator.normal(0.0, 0.02, array.shape) for array in (skeleton.offsets_m, skeleton.tips_m)
    )
    offsets[0] = 0.0
    return Skeleton(JOINT_NAMES, skeleton.parents, offsets, tips, skeleton.angle_axes, skeleton.angle_orders)


def some_motion() -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(2)
    rotations = rot.from_rotation_vector(generator.normal(0.0, 0.8, (20, len(JOINT_NAMES), 3)))
    return rotations, generator.normal(0.0, 1.0, (20, 3))


def test_every_joint_is_the_mirror_image_of_the_other_sides() -> None:
    skeleton, (rotations, path) = uneven(), some_motion()
    positions, _ = forward_kinematics(skeleton, rotations, path)
    image, _ = forward_kinematics(mirrored_skeleton(skeleton), mirrored_rotations(rotations), mirrored_points(path))
    np.testing.assert_allclose(image, positions[:, OTHER] * [-1.0, 1.0, 1.0], atol=1e-12)


def test_the_ends_of_bones_are_mirrored_too() -> None:
    skeleton, (rotations, path) = uneven(), some_motion()

    def ends(body: Skeleton, local: np.ndarray, root: np.ndarray) -> np.ndarray:
        positions, world = forward_kinematics(body, local, root)
        return positions + rot.rotate(world, body.tips_m)

    image = ends(mirrored_skeleton(skeleton), mirrored_rotations(rotations), mirrored_points(path))
    np.testing.assert_allclose(image, ends(skeleton, rotations, path)[:, OTHER] * [-1.0, 1.0, 1.0], atol=1e-12)


def test_twice_mirrored_is_the_original() -> None:
    skeleton, (rotations, path) = uneven(), some_motion()
    np.testing.assert_array_equal(mirrored_rotations(mirrored_rotations(rotations)), rotations)
    np.testing.assert_array_equal(mirrored_points(mirrored_points(path)), path)
    again = mirrored_skeleton(mirrored_skeleton(skeleton))
    for name in ("offsets_m", "tips_m", "angle_axes"):
        np.testing.assert_array_equal(getattr(again, name), getattr(skeleton, name))
    assert again.angle_orders == skeleton.angle_orders


def test_angles_are_measured_in_the_products_frames() -> None:
    """The knee that is bent by 40 degrees is bent by 40 degrees on the other side."""
    skeleton = with_angle_frames(default_skeleton())
    image = mirrored_skeleton(skeleton)
    assert rot.angle_between(image.angle_axes, skeleton.angle_axes).max() < 1e-7
    rotations, _ = some_motion()
    before, after = joint_angles(skeleton, rotations), joint_angles(image, mirrored_rotations(rotations))
    for joint, name in enumerate(JOINT_NAMES):
        signs = [1.0 if axis == "X" else -1.0 for axis in skeleton.angle_orders[joint]]
        if name[1:] in ("tibia", "foot", "toes", "femur", "radius"):
            np.testing.assert_allclose(after[OTHER[joint]], before[joint] * signs, atol=1e-7)


def test_names_of_behaviours_change_sides() -> None:
    assert mirrored_behaviour("walk-turn-left") == "walk-turn-right"
    assert mirrored_behaviour("raise up right hand") == "raise up left hand"
    assert mirrored_behaviour("copyright") == "copyright"
    assert mirrored_behaviour("from left to right") == "from right to left"
