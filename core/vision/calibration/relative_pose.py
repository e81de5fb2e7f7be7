"""Relative pose of two cameras from board poses, allowing for half turns of the board.

Poses are matrices (4, 4) that multiply homogeneous coordinates.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from ...geometry.arrays import Array
from .bundle import FIT


def pose_matrix(pose: Array) -> Array:
    """Return the matrix (4, 4) of a rotation vector and a translation (6,)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = cv2.Rodrigues(pose[:3])[0], pose[3:]
    return matrix


def pose_vector(matrix: Array) -> Array:
    """Return the rotation vector and the translation (6,) of a matrix (4, 4)."""
    return np.append(cv2.Rodrigues(matrix[:3, :3])[0], matrix[:3, 3])


def half_turn(centre: Array) -> Array:
    """Return the half turn (4, 4) of a board about its normal through a point (3,) on it."""
    matrix = np.diag([-1.0, -1.0, 1.0, 1.0])
    matrix[:2, 3] = 2.0 * centre[:2]
    return matrix


def relative_pose(first: Sequence[Array], second: Sequence[Array], centre: Array | None) -> Array:
    """Return the second-from-first pose (4, 4) on which most moments agree.

    If several poses tie (as with a board that is always held the same way up), the one that turns the cameras least
    wins.

    Args:
        first, second: Camera-from-board poses at the same moments.
        centre: Centre (3,) of a board that looks the same after a half turn about its normal, else None.
    """
    options = [_options(a, b, centre) for a, b in zip(first, second, strict=True)]
    scale = float(np.median([np.linalg.norm(pose[:3, 3]) for pose in first]))

    def agreement(hypothesis: Array) -> tuple[int, float]:
        near = (min(_distance(option, hypothesis, scale) for option in row) < 1.0 for row in options)
        return sum(near), -_angle_deg(hypothesis)

    return max((option for row in options for option in row), key=agreement)


def seen_alike(
    first: Array, second: Array, second_from_first: Array, centre: Array | None, scale: float
) -> tuple[bool, bool]:
    """Return whether two cameras see a board in the same place, and whether they differ by a half turn of it.

    Args:
        first, second: Camera-from-board poses at one moment.
        centre: As for `relative_pose`.
        scale: Median distance to the board.
    """
    distances = [_distance(option, second_from_first, scale) for option in _options(first, second, centre)]
    return min(distances) < 1.0, distances.index(min(distances)) == 1


def _options(first: Array, second: Array, centre: Array | None) -> list[Array]:
    straight = second @ np.linalg.inv(first)
    return [straight] if centre is None else [straight, second @ half_turn(centre) @ np.linalg.inv(first)]


def _distance(a: Array, b: Array, scale: float) -> float:
    """Return how far apart two poses are, as a multiple of the limits."""
    apart = np.linalg.norm((np.linalg.inv(a) - np.linalg.inv(b))[:3, 3])
    return max(_angle_deg(a @ np.linalg.inv(b)) / FIT.same_angle_deg, float(apart) / (FIT.same_distance * scale))


def _angle_deg(pose: Array) -> float:
    return float(np.degrees(np.arccos(np.clip((np.trace(pose[:3, :3]) - 1.0) / 2.0, -1.0, 1.0))))
