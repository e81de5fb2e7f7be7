import numpy as np
import pytest
from perfanim.core.body.pose_easing import PoseEaser
from perfanim.core.geometry import rotations as rot

FPS, JOINTS, JOINT = 60.0, 5, 3
POINTS = np.random.default_rng(0).normal(size=(9, 3))
PARENTS, CARRIERS = np.arange(JOINTS) - 1, np.full(9, JOINT)  # one limb, with all markers at its joint
LET_GO_DEG = 240.0 / FPS
LIMIT_DEG, LIMIT_AT_CHANGE_DEG = 8.0 + LET_GO_DEG, 5.0 + LET_GO_DEG


def turned(angles_deg: np.ndarray, joint: int = JOINT) -> np.ndarray:
    """Rotations (F, J, 4) in which one joint has these angles and the others turn slowly."""
    vectors = np.zeros((len(angles_deg), JOINTS, 3))
    vectors[:, :, 1] = np.radians(0.5) * np.arange(len(angles_deg))[:, None]
    vectors[:, joint] = np.radians(angles_deg)[:, None] * np.array([1.0, 0.0, 0.0])
    return rot.from_rotation_vector(vectors)


def eased(rotations: np.ndarray, points: list[np.ndarray] | None = None, held: range = range(0)) -> np.ndarray:
    easer = PoseEaser(PARENTS, CARRIERS)
    steps = enumerate(rotations)
    return np.array([easer.step(i / FPS, each, points[i] if points else POINTS, i in held) for i, each in steps])


def changes_deg(rotations: np.ndarray) -> np.ndarray:
    return np.degrees(rot.angle_between(rotations[:-1], rotations[1:]))


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


def test_two_jumps_in_a_row_are_eased() -> None:
    angles = np.concatenate((np.zeros(10), [25.0, 50.0], np.full(30, 50.0)))
    assert changes_deg(eased(turned(angles))).max() <= LIMIT_DEG


@pytest.mark.parametrize("joint", [JOINT, 0])
def test_a_movement_of_a_body_is_shown_as_it_is(joint: int) -> None:
    # 1,200 degrees a second after 0.1 s, as in a punch, and back to rest
    speed = np.concatenate((np.zeros(5), np.linspace(0.0, 20.0, 7), np.linspace(20.0, 0.0, 7), np.zeros(10)))
    solved = turned(np.cumsum(speed), joint)
    np.testing.assert_array_equal(eased(solved), solved)


def test_a_smaller_jump_is_eased_only_where_a_marker_comes() -> None:
    solved = turned(JUMP / 10.0)
    hidden = np.where(np.arange(9)[:, None] < 1, np.nan, POINTS)
    points = [POINTS if i >= 20 else hidden for i in range(60)]
    np.testing.assert_array_equal(eased(solved), solved)
    assert changes_deg(eased(solved, points)).max() < 3.0 < changes_deg(solved).max()


def test_the_root_is_not_eased() -> None:
    solved = turned(JUMP, joint=0)
    np.testing.assert_array_equal(eased(solved), solved)


def test_a_cut_is_shown_as_it_is() -> None:
    solved = turned(JUMP)
    points = [POINTS + (i >= 20) * np.array([0.3, 0.0, 0.0]) for i in range(len(solved))]
    np.testing.assert_array_equal(eased(solved, points), solved)


def test_a_marker_that_comes_back_is_no_cut() -> None:
    points = [POINTS if i >= 20 else np.where(np.arange(9)[:, None] < 1, np.nan, POINTS) for i in range(60)]
    assert changes_deg(eased(turned(JUMP), points)).max() <= LIMIT_AT_CHANGE_DEG


def test_exchanged_labels_are_no_cut() -> None:
    points = [POINTS if i >= 20 else POINTS[[1, 0, *range(2, 9)]] for i in range(60)]
    assert changes_deg(eased(turned(JUMP), points)).max() <= LIMIT_DEG


def test_markers_that_flicker_are_no_cut() -> None:
    points = [POINTS if i % 3 else np.where(np.arange(9)[:, None] < 3, np.nan, POINTS) for i in range(60)]
    assert changes_deg(eased(turned(JUMP), points)).max() <= LIMIT_DEG


def test_a_pose_after_a_gap_is_shown_as_it_is() -> None:
    easer, solved = PoseEaser(PARENTS, CARRIERS), turned(JUMP)
    easer.step(0.0, solved[0], POINTS)
    np.testing.assert_array_equal(easer.step(0.5, solved[40], POINTS), solved[40])


def test_held_joints_stay_and_are_let_go() -> None:
    solved = turned(3.0 * np.arange(60))
    shown = eased(solved, held=range(20, 26))
    np.testing.assert_allclose(rot.angle_between(shown[19:26], shown[19])[:, 1:], 0.0, atol=1e-6)
    assert changes_deg(shown).max() <= LIMIT_DEG
    assert np.degrees(rot.angle_between(shown[-1], solved[-1])).max() < 2.0
