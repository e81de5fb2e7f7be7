import numpy as np
import pytest
from perfanim.core.geometry import quaternion_components as c
from perfanim.core.geometry.two_bone_ik import triangle_angle, two_bone_directions

THIGH_M, SHIN_M = 0.45, 0.38


@pytest.mark.parametrize("sides", [(3.0, 4.0, 5.0), (2.0, 2.0, 2.0), (1.5, 0.7, 1.1)])
def test_an_angle_follows_the_law_of_cosines(sides: tuple[float, float, float]) -> None:
    a, b, opposite = sides
    angle = triangle_angle(a, b, opposite)
    ends = np.array([a, 0.0]), b * np.array([np.cos(angle), np.sin(angle)])
    assert np.linalg.norm(ends[0] - ends[1]) == pytest.approx(opposite)


def test_impossible_triangle_is_straight() -> None:
    assert triangle_angle(1.0, 1.0, 2.5) == pytest.approx(np.pi)
    assert triangle_angle(2.0, 1.0, 0.5) == pytest.approx(0.0)


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
    ways = two_bone_directions((0.3, -2.0, 0.5), normal, THIGH_M, SHIN_M, unreached, 0.98)
    far = c.plus(c.times(THIGH_M, ways[0]), c.times(SHIN_M, ways[1]))
    np.testing.assert_allclose(far, c.times(0.98 * (THIGH_M + SHIN_M), c.unit((0.3, -2.0, 0.5))), atol=1e-9)
