"""Signals of a performer's hands, and none from ordinary motion."""

from collections.abc import Iterator

import numpy as np
import pytest
from perfanim.core.body.motion import Motion
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.geometry import rotations as rot
from perfanim.core.session.gestures import GESTURES, Gesture, GestureWatch
from perfanim.core.simulate.shipped_performance import BEHAVIOURS, performance
from solved_poses import performer_pose

SKELETON, FPS = default_skeleton(), 60


def signals(watch: GestureWatch, poses: Iterator[np.ndarray], confidence: float = 0.9) -> list[int]:
    """Return the frames in which a signal is given."""
    found = []
    for number, rotations in enumerate(poses):
        if watch.step(performer_pose(number, rotations, (0.0, 1.0, 0.0), confidence)):
            found.append(number)
    return found


def arms(left_deg: float, forward_deg: float = 0.0) -> np.ndarray:
    """Return a T pose with the left arm raised, and both arms turned forward."""
    result = rot.identity((len(SKELETON),))
    up = rot.from_rotation_vector(np.array([0.0, 0.0, np.radians(left_deg)]))
    for side, sign in (("l", 1.0), ("r", -1.0)):
        forward = rot.from_rotation_vector(np.array([0.0, -sign * np.radians(forward_deg), 0.0]))
        result[SKELETON.index(f"{side}humerus")] = rot.multiply(forward, up) if side == "l" else forward
    return result


def raised(times: int, held_s: float, right_rad: float = 1.3) -> Iterator[np.ndarray]:
    for _ in range(times):
        for count, angle in ((30, -60.0), (round(held_s * FPS), 85.0), (30, -60.0)):
            for _ in range(count):
                pose = arms(angle)
                pose[SKELETON.index("rhumerus")] = rot.from_rotation_vector(np.array([0.0, 0.0, right_rad]))
                yield pose


def clapping(times: int, pause_s: float) -> Iterator[np.ndarray]:
    for _ in range(times):
        for count, angle in ((round(0.5 * pause_s * FPS), 20.0), (4, 107.0), (round(0.5 * pause_s * FPS), 20.0)):
            for _ in range(count):
                yield arms(0.0, angle)


def test_a_hand_that_stays_raised_is_one_signal() -> None:
    watch = GestureWatch(SKELETON, Gesture.RAISED_HAND)
    found = signals(watch, raised(2, 2.0))
    seen_after = 30 + round(GESTURES.raised_s * FPS)
    assert found == pytest.approx([seen_after, 180 + seen_after], abs=1)
    assert signals(GestureWatch(SKELETON, Gesture.RAISED_HAND), raised(3, 0.8)) == []
    assert signals(GestureWatch(SKELETON, Gesture.RAISED_HAND), raised(1, 2.0), confidence=0.1) == []
    assert signals(GestureWatch(SKELETON, Gesture.RAISED_HAND), raised(1, 2.0, right_rad=-1.3)) == []  # both hands


def test_two_claps_are_a_signal_and_one_is_not() -> None:
    assert len(signals(GestureWatch(SKELETON, Gesture.CLAPS), clapping(2, 0.5))) == 1
    assert len(signals(GestureWatch(SKELETON, Gesture.CLAPS), clapping(4, 0.5))) == 2
    assert signals(GestureWatch(SKELETON, Gesture.CLAPS), clapping(1, 0.5)) == []
    assert signals(GestureWatch(SKELETON, Gesture.CLAPS), clapping(3, 1.5)) == []


@pytest.mark.parametrize("behaviour", BEHAVIOURS)
def test_ordinary_motion_gives_no_signal(behaviour: str) -> None:
    motion: Motion = performance(behaviour, at_once=True)
    for gesture in Gesture:
        assert signals(GestureWatch(motion.skeleton, gesture), iter(motion.rotations)) == []
