import numpy as np
import pytest
from perfanim.core.body.joint_angle_frames import with_angle_frames
from perfanim.core.body.skeleton import (
    Skeleton,
    forward_kinematics,
    forward_kinematics_matrices,
    joint_angles,
    marker_jacobian,
    marker_positions,
)
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import SkeletonError
from perfanim.core.geometry import rotations as rot

QUARTER_Z = rot.from_rotation_vector([0.0, 0.0, np.pi / 2.0])
QUARTER_Y = rot.from_rotation_vector([0.0, np.pi / 2.0, 0.0])


def arm() -> Skeleton:
    """A root with an upper arm along x, a forearm along x, and a leg down."""
    return Skeleton(
        names=("root", "upper", "fore", "leg"),
        parents=np.array([-1, 0, 1, 0]),
        offsets_m=np.array([[0.0, 0.0, 0.0], [0.2, 0.5, 0.0], [0.3, 0.0, 0.0], [0.1, 0.0, 0.0]]),
        tips_m=np.array([[0.0, 0.1, 0.0], [0.3, 0.0, 0.0], [0.25, 0.0, 0.0], [0.0, -0.4, 0.0]]),
    )


def random_pose(skeleton: Skeleton, seed: int, frames: tuple[int, ...] = ()) -> np.ndarray:
    return rot.from_rotation_vector(np.random.default_rng(seed).normal(scale=0.8, size=(*frames, len(skeleton), 3)))


def test_rest_pose() -> None:
    positions, world = forward_kinematics(arm(), rot.identity((4,)), [1.0, 2.0, 3.0])
    expected = [[1.0, 2.0, 3.0], [1.2, 2.5, 3.0], [1.5, 2.5, 3.0], [1.1, 2.0, 3.0]]
    np.testing.assert_allclose(positions, expected)
    np.testing.assert_allclose(positions, arm().rest_positions_m + np.array([1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(world, rot.identity((4,)))


def test_pose_worked_out_by_hand() -> None:
    """The root turns a quarter about y (x goes to -z), the upper arm a quarter about its z (forearm up)."""
    rotations = rot.identity((4,))
    rotations[0], rotations[1] = QUARTER_Y, QUARTER_Z
    positions, world = forward_kinematics(arm(), rotations, [0.0, 1.0, 0.0])
    np.testing.assert_allclose(positions[1], [0.0, 1.5, -0.2], atol=1e-12)
    np.testing.assert_allclose(positions[2], [0.0, 1.8, -0.2], atol=1e-12)
    np.testing.assert_allclose(positions[3], [0.0, 1.0, -0.1], atol=1e-12)
    np.testing.assert_allclose(rot.rotate(world[2], [1.0, 0.0, 0.0]), [0.0, 1.0, 0.0], atol=1e-12)
    markers = marker_positions(arm(), [2, 0], [[0.25, 0.0, 0.02], [0.0, 0.0, 0.1]], rotations, [0.0, 1.0, 0.0])
    np.testing.assert_allclose(markers, [[0.02, 2.05, -0.2], [0.1, 1.0, 0.0]], atol=1e-12)


def test_many_frames_and_matrices_give_the_same() -> None:
    skeleton = default_skeleton()
    poses = random_pose(skeleton, 0, (3, 2))
    roots = np.random.default_rng(1).normal(size=(3, 2, 3))
    positions, world = forward_kinematics(skeleton, poses, roots)
    single, _ = forward_kinematics(skeleton, poses[2, 1], roots[2, 1])
    np.testing.assert_allclose(positions[2, 1], single, atol=1e-14)
    by_matrices, world_matrices = forward_kinematics_matrices(skeleton, rot.to_matrix(poses), roots)
    np.testing.assert_allclose(by_matrices, positions, atol=1e-13)
    np.testing.assert_allclose(world_matrices, rot.to_matrix(world), atol=1e-13)
    local = rot.multiply(rot.conjugate(world[..., skeleton.parents[1:], :]), world[..., 1:, :])
    assert rot.angle_between(local, poses[..., 1:, :]).max() < 1e-7


def test_bones_keep_their_lengths() -> None:
    skeleton = default_skeleton()
    positions, _ = forward_kinematics(skeleton, random_pose(skeleton, 2, (20,)), np.zeros((20, 3)))
    lengths = np.linalg.norm(positions[:, 1:] - positions[:, skeleton.parents[1:]], axis=-1)
    expected = np.broadcast_to(np.linalg.norm(skeleton.offsets_m[1:], axis=1), lengths.shape)
    np.testing.assert_allclose(lengths, expected, atol=1e-13)


def test_marker_jacobian_is_the_derivative() -> None:
    skeleton = default_skeleton()
    joints = np.array([skeleton.index(name) for name in ("root", "head", "lhand", "rfoot", "rthumb")])
    offsets = np.random.default_rng(3).normal(scale=0.1, size=(5, 3))
    step = 1e-6
    for seed in range(3):
        local, root = random_pose(skeleton, seed), np.array([0.3, 1.0, -2.0])

        def markers(change: np.ndarray, local: np.ndarray = local, root: np.ndarray = root) -> np.ndarray:
            turned = rot.multiply(local, rot.from_rotation_vector(change[3:].reshape(-1, 3)))
            return marker_positions(skeleton, joints, offsets, turned, root + change[:3])

        positions, world = forward_kinematics_matrices(skeleton, rot.to_matrix(local), root)
        found = marker_jacobian(skeleton, joints, markers(np.zeros(90)), positions, world)
        changes = step * np.eye(3 + 3 * len(skeleton))
        expected = np.stack([(markers(c) - markers(-c)) / (2.0 * step) for c in changes], axis=-1)
        # central differences err by step^2 times the third derivative and by rounding, 1e-16 / step
        np.testing.assert_allclose(found, expected, atol=2e-9)


def test_ancestors_and_levels() -> None:
    skeleton = arm()
    np.testing.assert_array_equal(np.flatnonzero(skeleton.is_ancestor[2]), [0, 1, 2])
    np.testing.assert_array_equal(np.flatnonzero(skeleton.is_ancestor[3]), [0, 3])
    assert [level.tolist() for level in skeleton.levels] == [[1, 3], [2]]
    assert Skeleton(("only",), np.array([-1]), np.zeros((1, 3)), np.zeros((1, 3))).levels == ()


def test_joint_angles_give_the_rotation_back() -> None:
    skeleton = with_angle_frames(default_skeleton())
    generator = np.random.default_rng(5)
    angles = [generator.uniform(-0.7, 0.7, (10, len(order))) for order in skeleton.angle_orders]
    rotations = np.empty((10, len(skeleton), 4))
    for joint, (values, order) in enumerate(zip(angles, skeleton.angle_orders, strict=True)):
        axes = skeleton.angle_axes[joint]
        framed = rot.from_euler(values, order)
        rotations[:, joint] = rot.multiply(rot.multiply(axes, framed), rot.conjugate(axes))
    assert {len(order) for order in skeleton.angle_orders} == {1, 2, 3}
    for found, expected in zip(joint_angles(skeleton, rotations), angles, strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-7)


def test_a_joint_without_freedom_has_no_angles() -> None:
    skeleton = Skeleton(("a",), np.array([-1]), np.zeros((1, 3)), np.zeros((1, 3)), angle_orders=("",))
    assert joint_angles(skeleton, rot.identity((7, 1)))[0].shape == (7, 0)


def test_unknown_joint_names_those_there_are() -> None:
    assert arm().index("fore") == 2
    with pytest.raises(SkeletonError, match="no joint 'hand'; choose from root, upper, fore, leg"):
        arm().index("hand")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"names": ("a", "a", "b", "c")}, "unique names"),
        ({"parents": np.array([-1, 2, 0, 0])}, "a parent comes after its child"),
        ({"parents": np.array([0, 0, 1, 0])}, "is not the only root"),
        ({"parents": np.array([-1, -1, 1, 0])}, "is not the only root"),
        ({"offsets_m": np.zeros((3, 3))}, "shapes"),
        ({"tips_m": np.full((4, 3), np.nan)}, "finite"),
        ({"angle_orders": ("X",)}, "shapes"),
    ],
)
def test_inconsistent_skeletons_are_refused(change: dict[str, object], message: str) -> None:
    parts = {"names": arm().names, "parents": arm().parents, "offsets_m": arm().offsets_m, "tips_m": arm().tips_m}
    with pytest.raises(SkeletonError, match=message):
        Skeleton(**(parts | change))
    with pytest.raises(SkeletonError, match="is not an Euler order; give each axis at most once"):
        joint_angles(Skeleton(**parts, angle_orders=("XX", "X", "Y", "Z")), rot.identity((4,)))
