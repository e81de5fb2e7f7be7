"""Relative pose of two cameras from board poses, with half turns of the board."""

from collections.abc import Sequence

import numpy as np

from ...geometry.arrays import Array

Transform = tuple[Array, Array]
"""(rotation (3, 3), translation (3,)): x_a = rotation @ x_b + translation."""

# loose: one camera's own board poses are rough, and a half turn or a wrong pair is far outside; other errors
# show in the reprojection
_SAME_ANGLE = np.radians(8.0)
_SAME_DISTANCE = 0.3  # of the typical distance to the board


def inverse(transform: Transform) -> Transform:
    """Return b-from-a of a-from-b."""
    rotation, translation = transform
    return rotation.T, -rotation.T @ translation


def compose(a_from_b: Transform, b_from_c: Transform) -> Transform:
    """Return a-from-c."""
    return a_from_b[0] @ b_from_c[0], a_from_b[0] @ b_from_c[1] + a_from_b[1]


def half_turn(centre: Array) -> Transform:
    """Return the half turn of a board about its normal through a point (3,) of it."""
    rotation = np.diag([-1.0, -1.0, 1.0])
    return rotation, centre - rotation @ centre


def relative_poses(first: Sequence[Transform], second: Sequence[Transform], centre: Array | None) -> Transform:
    """Find the second-from-first pose that most moments agree on.

    Args:
        first, second: camera-from-board of the same moments.
        centre: (3,) centre of a board that looks the same after a half turn about its normal, else None.

    Ties (a board always held the same way up fits both) go to the pose that turns the cameras least.
    """
    options = [_options(a, b, centre) for a, b in zip(first, second, strict=True)]
    scale = float(np.median([np.linalg.norm(t) for _, t in first])) if first else 1.0
    best_key: tuple[int, float] = (-1, 0.0)
    best: Transform = np.eye(3), np.zeros(3)
    for hypothesis in (option for row in options for option in row):
        distances = np.array([[_distance(option, hypothesis, scale) for option in row] for row in options])
        key = (int((distances.min(axis=1) < 1.0).sum()), -_angle(hypothesis[0]))
        if key > best_key:
            best_key, best = key, hypothesis
    return best


def seen_alike(
    first: Transform, second: Transform, second_from_first: Transform, centre: Array | None, scale: float
) -> tuple[bool, bool]:
    """Return whether two cameras see a board in one place, and whether half-turned.

    Args:
        first, second: camera-from-board; second_from_first: the cameras.
        centre: as for `relative_poses`; scale: typical distance to the board.
    """
    distances = [_distance(option, second_from_first, scale) for option in _options(first, second, centre)]
    return min(distances) < 1.0, distances.index(min(distances)) == 1


def _options(first: Transform, second: Transform, centre: Array | None) -> list[Transform]:
    straight = compose(second, inverse(first))
    if centre is None:
        return [straight]
    return [straight, compose(compose(second, half_turn(centre)), inverse(first))]


def _distance(a: Transform, b: Transform, scale: float) -> float:
    return max(
        _angle(a[0] @ b[0].T) / _SAME_ANGLE,
        float(np.linalg.norm(inverse(a)[1] - inverse(b)[1])) / (_SAME_DISTANCE * scale),
    )


def _angle(rotation: Array) -> float:
    return float(np.arccos(np.clip((np.trace(rotation) - 1.0) / 2.0, -1.0, 1.0)))
