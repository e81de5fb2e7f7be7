import numpy as np
import pytest
from perfanim.core.geometry import point_patterns
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.point_patterns import match_rigid_pattern, place_pattern, planarity_m, point_distances
from scipy.spatial.distance import cdist

CHANCE = np.random.default_rng(7)
PATTERN_M = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.5, 0.0], [0.1, 0.1, 0.7]])
SPANS_M = np.linalg.norm(PATTERN_M[:, None] - PATTERN_M[None], axis=-1)
TURN, SHIFT = rot.from_rotation_vector(np.array([0.4, -1.0, 0.3])), np.array([1.0, 2.0, -0.5])
PLACED_M = rot.rotate(TURN, PATTERN_M) + SHIFT


def matched(points_m: np.ndarray, fewest: int = 4, allowed: np.ndarray | None = None) -> list[list[int]]:
    tolerances_m = np.full((len(points_m), len(points_m)), 0.01)
    return match_rigid_pattern(points_m, SPANS_M, tolerances_m, fewest, allowed).tolist()


def test_distances_between_points_are_scipys() -> None:
    for count, other in ((0, 3), (4, 0), (7, 5)):
        points_m, others_m = CHANCE.normal(size=(count, 3)), CHANCE.normal(size=(other, 3))
        np.testing.assert_allclose(point_distances(points_m, others_m), cdist(points_m, others_m), rtol=1e-14)


def test_a_pattern_is_found_among_other_points() -> None:
    order = [4, 2, 6, 0]
    points_m = CHANCE.uniform(-3.0, 3.0, (7, 3))
    points_m[order] = PLACED_M
    assert matched(points_m) == [order]


def test_a_pattern_with_a_marker_missing_is_found_if_so_few_are_enough() -> None:
    points_m = PLACED_M[[2, 0, 3]]
    assert matched(points_m) == []
    assert matched(points_m, 3) == [[1, -1, 0, 2]]


def test_fuller_matches_come_first() -> None:
    found = matched(PLACED_M, 3)
    assert found[0] == [0, 1, 2, 3]
    assert sorted(found[1:]) == [[-1, 1, 2, 3], [0, -1, 2, 3], [0, 1, -1, 3], [0, 1, 2, -1]]


def test_mask_excludes_points() -> None:
    allowed = np.ones((4, 4), dtype=bool)
    allowed[1, 1] = False
    assert matched(PLACED_M, 3, allowed) == [[0, -1, 2, 3]]


def test_a_distance_off_by_more_than_its_tolerance_is_no_match() -> None:
    far = PLACED_M.copy()
    far[3] += 0.02 * (far[3] - far[0]) / np.linalg.norm(far[3] - far[0])
    assert matched(far) == []


def test_placed_pattern_has_rotation_translation_and_residual() -> None:
    turn, shift, off_m = place_pattern(PATTERN_M, PLACED_M)
    np.testing.assert_allclose(turn, rot.to_matrix(TURN), atol=1e-12)
    np.testing.assert_allclose(shift, SHIFT)
    assert off_m == pytest.approx(0.0, abs=1e-9)
    # two points of a line that is 2 cm longer: each 1 cm away
    _, _, off_m = place_pattern(
        np.array([[-0.5, 0, 0], [0.5, 0, 0], [0, 0, 0]]), np.array([[-0.51, 0, 0], [0.51, 0, 0], [0, 0, 0]])
    )
    assert off_m == pytest.approx(0.01 * np.sqrt(2.0 / 3.0))


def test_planarity_is_the_distance_from_a_line() -> None:
    along = np.array([[-2.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, -0.1, 0.0]])
    assert planarity_m(along) == pytest.approx(0.1 * np.sqrt(0.5))
    assert planarity_m(along + 5.0) == pytest.approx(0.1 * np.sqrt(0.5))
    assert planarity_m(along[:2]) == pytest.approx(0.0, abs=1e-12)


def test_excluded_points_are_not_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a followed prop cannot be is left out before distances are taken."""
    points_m = np.concatenate((CHANCE.uniform(-3.0, 3.0, (500, 3)), PLACED_M))
    allowed = np.zeros((len(points_m), 4), dtype=bool)
    allowed[-4:] = True
    sizes, extend = [], point_patterns._extend_matches

    def counted(between_m: np.ndarray, *rest: np.ndarray) -> np.ndarray:
        sizes.append(between_m.shape)
        return extend(between_m, *rest)

    monkeypatch.setattr(point_patterns, "_extend_matches", counted)
    assert matched(points_m, 4, allowed) == [[500, 501, 502, 503]]
    assert sizes == [(4, 4)]
    assert matched(points_m, 4, np.zeros_like(allowed)) == []
