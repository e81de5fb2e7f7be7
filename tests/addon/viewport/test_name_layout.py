"""Names of markers lie beside their markers and never over each other."""

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from perfanim.perfanim_addon.viewport.name_layout import place_names

SIZE, BESIDE, DOT = 11.0, 8.0, 5.0
BODY = np.array([[0, 170], [20, 140], [-20, 140], [35, 95], [-35, 95], [12, 100], [-12, 100], [15, 8], [-15, 8]])
WIDTHS = [55.0, 62.0, 62.0, 35.0, 35.0, 42.0, 42.0, 38.0, 38.0]


def placed(points: np.ndarray) -> list[Any]:
    return place_names(points, WIDTHS, SIZE, BESIDE, DOT)


def common(one: Any, other: Any) -> bool:
    """Whether two boxes share more than a border."""
    return all(min(one[side + 2], other[side + 2]) - max(one[side], other[side]) > 1e-9 for side in (0, 1))


@pytest.mark.parametrize("scale", [0.05, 0.2, 0.5, 1.0, 3.0])
@pytest.mark.parametrize("seed", range(5))
def test_no_name_lies_over_another_or_over_a_marker(scale: float, seed: int) -> None:
    points = scale * (BODY + np.random.default_rng(seed).normal(scale=10.0, size=BODY.shape))
    names = placed(points)
    assert len(names) == len(BODY)
    assert not any(common(one.box, other.box) for one, other in combinations(names, 2))
    dots = [(x - DOT, y - DOT, x + DOT, y + DOT) for x, y in points]
    assert not any(common(name.box, dot) for name in names for dot in dots)


def test_on_a_large_character_each_is_right_beside_its_marker() -> None:
    points = 10.0 * BODY
    for name, point in zip(placed(points), points, strict=True):
        assert not name.is_away
        np.testing.assert_allclose(name.near, point + np.array([BESIDE, 0.0]))
        assert name.start[0] == name.box[0] == point[0] + BESIDE
        assert name.box[1] < name.start[1] < point[1] < name.box[3]  # in the middle of its letters


def test_on_a_small_one_names_stay_near_and_those_away_say_so() -> None:
    points = 0.1 * BODY
    names = placed(points)
    assert any(name.is_away for name in names)
    for name, point in zip(names, points, strict=True):
        is_beside = abs(name.near[0] - point[0]) == pytest.approx(BESIDE) and name.near[1] == pytest.approx(point[1])
        assert name.is_away != is_beside
        assert np.linalg.norm(name.near - point) < len(BODY) * 1.5 * SIZE
