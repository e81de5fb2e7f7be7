from collections.abc import Sequence

import numpy as np
import pytest
from perfanim.core.body.pose_slew_limit import PoseSlewLimit
from perfanim.core.body.skeleton import Skeleton, marker_positions
from perfanim.core.geometry import rotations as rot

FPS, JOINTS, JOINT = 60.0, 5, 3
OFFSETS = np.random.default_rng(0).normal(size=(9, 3))
CARRIERS = np.full(9, JOINT)  # one limb, with all markers at its joint
BONES = np.tile([0.0, 0.2, 0.0], (JOINTS, 1))
CHAIN = Skeleton(tuple("abcde"), np.arange(JOINTS) - 1, BONES, BONES)
POINTS = marker_positions(CHAIN, CARRIERS, OFFSETS, rot.identity((JOINTS,)), np.zeros(3))
LIMIT_DEG = 10.0  # of a joint between two frames, beyond the truth


def turned(angles_deg: np.ndarray, joint: int = JOINT) -> np.ndarray:
    """Rotations (F, J, 4): one joint has these angles, the others turn slowly below a still root."""
    vectors = np.zeros((len(angles_deg), JOINTS, 3))
    vectors[:, 1:, 1] = np.radians(0.5) * np.arange(len(angles_deg))[:, None]
    vectors[:, joint] = np.radians(angles_deg)[:, None] * np.array([1.0, 0.0, 0.0])
    return rot.from_rotation_vector(vectors)


def eased(rotations: np.ndarray, points: Sequence[np.ndarray] | None = None, held: range = range(0)) -> np.ndarray:
    slew_limit = PoseSlewLimit(CHAIN, CARRIERS, OFFSETS)
    shown = []
    for i, each in enumerate(rotations):
        shown.append(slew_limit.step(i / FPS, each, np.zeros(3), POINTS if points is None else points[i], i in held))
    return np.array(shown)


def changes_deg(rotations: np.ndarray) -> np.ndarray:
    return np.degrees(rot.angle_between(rotations[:-1], rotations[1:]))


NEAR = 0.25  # markers as far from their joint as a body's
# 1,200 degrees a second after 0.1 s, as in a punch, and back to rest
SPEEDS = np.concatenate((np.zeros(5), np.linspace(0.0, 20.0, 7), np.linspace(20.0, 0.0, 7), np.zeros(10)))
PUNCH = np.cumsum(SPEEDS)
JUMP = np.where(np.arange(60) < 20, 0.0, 60.0)


def test_a_jump_takes_a_quarter_second() -> None:
    solved = turned(JUMP)
    shown = eased(solved)
    assert changes_deg(solved).max() > 59.0
    assert changes_deg(shown).max() <= LIMIT_DEG
    late = rot.angle_between(shown, solved)[20 + round(0.35 * FPS) :, JOINT]
    assert np.degrees(late).max() < 2.0
    np.testing.assert_array_equal(shown[:20], solved[:20])
    others = np.arange(JOINTS) != JOINT
    assert np.degrees(rot.angle_between(shown, solved)[:, others]).max() < 1e-6


def test_two_successive_jumps_are_limited() -> None:
    angles = np.concatenate((np.zeros(10), [25.0, 50.0], np.full(30, 50.0)))
    assert changes_deg(eased(turned(angles))).max() <= LIMIT_DEG


@pytest.mark.parametrize("joint", [JOINT, 0])
def test_movement_with_markers_is_unchanged(joint: int) -> None:
    solved = turned(PUNCH, joint)
    moving = marker_positions(CHAIN, CARRIERS, NEAR * OFFSETS, solved, np.zeros(3))
    np.testing.assert_array_equal(eased(solved, moving), solved)


def test_movement_without_markers_is_limited() -> None:
    assert changes_deg(eased(turned(PUNCH))).max() <= LIMIT_DEG
    below = turned(PUNCH, JOINT + 1)  # carries no marker
    moving = marker_positions(CHAIN, CARRIERS, NEAR * OFFSETS, turned(PUNCH), np.zeros(3))
    assert changes_deg(eased(below, moving)).max() <= LIMIT_DEG


def test_jump_with_markers_is_limited() -> None:
    solved = turned(JUMP / 4.0)
    moving = marker_positions(CHAIN, CARRIERS, NEAR * OFFSETS, solved, np.zeros(3))
    assert changes_deg(solved).max() > LIMIT_DEG >= changes_deg(eased(solved, moving)).max()


def test_smaller_jump_is_limited_only_where_a_marker_appears() -> None:
    solved = turned(JUMP / 10.0)
    hidden = np.where(np.arange(9)[:, None] < 1, np.nan, POINTS)
    points = [POINTS if i >= 20 else hidden for i in range(60)]
    np.testing.assert_array_equal(eased(solved), solved)
    assert changes_deg(eased(solved, points)).max() < 3.0 < changes_deg(solved).max()


def test_root_is_not_limited() -> None:
    solved = turned(JUMP, joint=0)
    np.testing.assert_array_equal(eased(solved), solved)


def test_cut_is_not_limited() -> None:
    solved = turned(JUMP)
    points = [POINTS + (i >= 20) * np.array([0.3, 0.0, 0.0]) for i in range(len(solved))]
    np.testing.assert_array_equal(eased(solved, points), solved)


def test_few_jumping_markers_are_not_a_cut_with_found_labels() -> None:
    solved, far = turned(JUMP), (np.arange(9) < 3)[:, None] * np.array([0.3, 0.0, 0.0])
    for known, limit in ((True, 61.0), (False, LIMIT_DEG)):
        slew_limit = PoseSlewLimit(CHAIN, CARRIERS, OFFSETS)
        shown = [
            slew_limit.step(i / FPS, each, np.zeros(3), POINTS + (i >= 20) * far, labels_known=known)
            for i, each in enumerate(solved)
        ]
        assert 0.9 * limit < changes_deg(np.array(shown)).max() <= limit


def test_markers_that_return_elsewhere_are_not_a_cut() -> None:
    away = np.isin(np.arange(9), (2, 5))[:, None]
    points = [np.where(away & (i in range(12, 20)), np.nan, POINTS + (i >= 20) * 0.3 * away) for i in range(60)]
    assert changes_deg(eased(turned(JUMP), points)).max() <= LIMIT_DEG


def test_returning_marker_is_not_a_cut() -> None:
    points = [POINTS if i >= 20 else np.where(np.arange(9)[:, None] < 1, np.nan, POINTS) for i in range(60)]
    assert changes_deg(eased(turned(JUMP), points)).max() <= LIMIT_DEG


def test_exchanged_labels_are_not_a_cut() -> None:
    points = [POINTS if i >= 20 else POINTS[[1, 0, *range(2, 9)]] for i in range(60)]
    assert changes_deg(eased(turned(JUMP), points)).max() <= LIMIT_DEG


def test_flickering_markers_are_not_a_cut() -> None:
    points = [POINTS if i % 3 else np.where(np.arange(9)[:, None] < 3, np.nan, POINTS) for i in range(60)]
    assert changes_deg(eased(turned(JUMP), points)).max() <= LIMIT_DEG


def test_pose_after_a_gap_is_not_limited() -> None:
    slew_limit, solved = PoseSlewLimit(CHAIN, CARRIERS, OFFSETS), turned(JUMP)
    slew_limit.step(0.0, solved[0], np.zeros(3), POINTS)
    np.testing.assert_array_equal(slew_limit.step(0.5, solved[40], np.zeros(3), POINTS), solved[40])


def test_held_joints_stay_until_released() -> None:
    solved = turned(3.0 * np.arange(60))
    shown = eased(solved, held=range(20, 26))
    np.testing.assert_allclose(rot.angle_between(shown[19:26], shown[19])[:, 1:], 0.0, atol=1e-6)
    assert changes_deg(shown).max() <= LIMIT_DEG
    assert np.degrees(rot.angle_between(shown[-1], solved[-1])).max() < 2.0
