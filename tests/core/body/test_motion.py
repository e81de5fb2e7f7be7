from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.motion import Motion, resampled, sliced
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import FormatError
from perfanim.core.geometry import rotations as rot


def steady_turn(frames: int = 31, fps: float = 30.0) -> Motion:
    """All joints turn at 2 rad/s about y while the root goes along x at 1 m/s."""
    skeleton = default_skeleton()
    time = np.arange(frames) / fps
    turn = rot.from_rotation_vector(2.0 * time[:, None] * np.array([0.0, 1.0, 0.0]))
    rotations = np.repeat(turn[:, None], len(skeleton), axis=1)
    return Motion("turn", fps, skeleton, rotations, time[:, None] * np.array([1.0, 0.0, 0.0]))


@pytest.mark.parametrize("fps", [60.0, 120.0, 10.0, 24.0, 47.3])
def test_resampling_a_steady_motion_is_exact(fps: float) -> None:
    motion = resampled(steady_turn(), fps)
    time = np.arange(motion.frames) / fps
    assert motion.fps == fps
    assert time[-1] <= 1.0 + 1e-6 < time[-1] + 1.0 / fps + 1e-6
    expected = rot.from_rotation_vector(2.0 * time[:, None] * np.array([0.0, 1.0, 0.0]))
    assert rot.angle_between(motion.rotations[:, 5], expected).max() < 1e-7
    np.testing.assert_allclose(motion.root_positions_m[:, 0], time, atol=1e-9)


def test_whole_ratio_picks_frames() -> None:
    motion = steady_turn(61, 60.0)
    np.testing.assert_array_equal(resampled(motion, 20.0).rotations, motion.rotations[::3])
    np.testing.assert_array_equal(resampled(motion, 60.0).rotations, motion.rotations)


def test_a_single_frame_has_no_duration() -> None:
    one = sliced(steady_turn(), 3, 4)
    assert (one.frames, one.duration_s) == (1, 0.0)
    assert resampled(one, 90.0).frames == 1
    assert steady_turn().duration_s == pytest.approx(1.0)


def test_slice() -> None:
    part = sliced(steady_turn(), 5, 9)
    np.testing.assert_array_equal(part.root_positions_m, steady_turn().root_positions_m[5:9])
    with pytest.raises(FormatError, match="turn: a motion of 29 joints cannot"):
        sliced(steady_turn(), 9, 9)


def test_inconsistent_motion_is_refused() -> None:
    motion = steady_turn()
    with pytest.raises(FormatError, match="shapes"):
        Motion("a", 30.0, motion.skeleton, motion.rotations[:, :5], motion.root_positions_m)
    with pytest.raises(FormatError, match="shapes"):
        Motion("a", 30.0, motion.skeleton, motion.rotations, motion.root_positions_m[:-1])
    for fps in (0.0, -1.0, float("nan"), 0.9, 2001.0, 1e9):
        with pytest.raises(FormatError, match=r"a: frame rate .* is not 1 to 2000"):
            Motion("a", fps, motion.skeleton, motion.rotations, motion.root_positions_m)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf"), 1e30, -1e30])
def test_numbers_out_of_range_are_refused(value: float) -> None:
    motion = steady_turn()
    roots, rotations = motion.root_positions_m.copy(), motion.rotations.copy()
    roots[7, 1] = value
    with pytest.raises(FormatError, match="turn: the root is more than 10000 m from the origin; check the unit"):
        replace(motion, root_positions_m=roots)
    rotations[7, 3, 2] = value
    with pytest.raises(FormatError, match="turn: a joint's rotation is not a unit quaternion"):
        replace(motion, rotations=rotations)
    with pytest.raises(FormatError, match="not a unit quaternion"):
        replace(motion, rotations=0.99 * motion.rotations)
    assert replace(motion, rotations=motion.rotations.astype(np.float32)).frames == 31
