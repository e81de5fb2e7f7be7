import numpy as np
import pytest
from perfanim.core.geometry import quaternion_components as c
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.two_bone_ik import reach_with_two_bones, triangle_angle, two_bone_directions

CHANCE = np.random.default_rng(5)
THIGH_M, SHIN_M = 0.45, 0.38
HINGE = np.array([1.0, 0.0, 0.0])
STILL = np.array([1.0, 0.0, 0.0, 0.0])


def limb(bend_rad: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return hip, knee and ankle of a leg that hangs down and bends to the back."""
    hip = np.array([0.1, 0.9, 0.2])
    knee = hip - [0.0, THIGH_M, 0.0]
    return hip, knee, knee - SHIN_M * np.array([0.0, np.cos(bend_rad), np.sin(bend_rad)])


def moved(points: tuple[np.ndarray, ...], before: tuple[np.ndarray, ...], after: tuple[np.ndarray, ...]) -> np.ndarray:
    """Return knee and ankle from the start, once both bones are turned."""
    bones = (points[1] - points[0], points[2] - points[1])
    turned = [
        rot.rotate(rot.multiply(new, rot.conjugate(old)), bone)
        for bone, old, new in zip(bones, before, after, strict=True)
    ]
    return np.cumsum(turned, axis=0)


@pytest.mark.parametrize("sides", [(3.0, 4.0, 5.0), (2.0, 2.0, 2.0), (1.5, 0.7, 1.1)])
def test_an_angle_follows_the_law_of_cosines(sides: tuple[float, float, float]) -> None:
    a, b, opposite = sides
    angle = triangle_angle(a, b, opposite)
    ends = np.array([a, 0.0]), b * np.array([np.cos(angle), np.sin(angle)])
    assert np.linalg.norm(ends[0] - ends[1]) == pytest.approx(opposite)


def test_impossible_triangle_is_straight() -> None:
    assert triangle_angle(1.0, 1.0, 2.5) == pytest.approx(np.pi)
    assert triangle_angle(2.0, 1.0, 0.5) == pytest.approx(0.0)


@pytest.mark.parametrize("bend_rad", [0.2, 1.0, 2.2])
def test_bones_end_at_the_target_and_bend_in_their_plane(bend_rad: float) -> None:
    points = limb(bend_rad)
    before = tuple(rot.from_rotation_vector(CHANCE.normal(size=(2, 3))))
    target = np.array([0.1, -0.6, 0.2])
    knee, ankle = moved(points, before, reach_with_two_bones(points, before, target, HINGE, 0.999))
    np.testing.assert_allclose(ankle, target, atol=1e-9)
    assert np.linalg.norm(knee) == pytest.approx(THIGH_M)
    assert np.linalg.norm(ankle - knee) == pytest.approx(SHIN_M)
    turn = rot.between((points[2] - points[0]) / np.linalg.norm(points[2] - points[0]), target / np.linalg.norm(target))
    assert np.dot(np.cross(knee, ankle - knee), rot.rotate(turn, HINGE)) > 0.0  # the knee bends as it did
    assert abs(np.dot(knee, rot.rotate(turn, HINGE))) < 1e-9


def test_a_straight_limb_bends_about_its_hinge() -> None:
    points = limb(0.0)
    before = (STILL, STILL)
    target = np.array([0.0, -0.7, 0.0])
    knee, ankle = moved(points, before, reach_with_two_bones(points, before, target, HINGE, 0.999))
    np.testing.assert_allclose(ankle, target, atol=1e-9)
    assert abs(knee[0]) < 1e-12
    assert knee[2] > 0.1  # to the front


def test_limb_points_at_a_target_out_of_reach() -> None:
    points = limb(1.0)
    before = (STILL, STILL)
    target = np.array([0.3, -2.0, 0.5])
    _, ankle = moved(points, before, reach_with_two_bones(points, before, target, HINGE, 0.98))
    np.testing.assert_allclose(ankle, 0.98 * (THIGH_M + SHIN_M) * target / np.linalg.norm(target), atol=1e-9)


def test_directions_end_at_the_reach_and_keep_the_side_of_the_bend() -> None:
    unreached = (0.0, -0.8, 0.05)
    normal = (1.0, 0.0, 0.0)
    reach = (0.15, -0.55, 0.2)
    first, second = two_bone_directions(reach, normal, THIGH_M, SHIN_M, unreached)
    end = c.plus(c.times(THIGH_M, first), c.times(SHIN_M, second))
    np.testing.assert_allclose(end, reach, atol=1e-12)
    np.testing.assert_allclose([c.length(first), c.length(second)], 1.0)
    turned = c.rotate(c.shortest_turn(c.unit(unreached), c.unit(reach)), normal)
    assert c.dot(c.cross(reach, first), turned) < 0.0  # so that the normal is way x bend
    far, _ = two_bone_directions((0.0, -3.0, 0.0), normal, THIGH_M, SHIN_M, unreached)
    assert 0.99 < -far[1] < 1.0
