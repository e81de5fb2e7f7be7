"""Faults put into clean motion are found where they are, and clean motion is left alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from perfanim.core.body.calibration_poses import t_pose
from perfanim.core.body.motion import Motion, resampled
from perfanim.core.body.motion_cleaning import CleanedMotion, clean_motion
from perfanim.core.body.standard_skeleton import JOINT_NAMES
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry import rotations as rot
from perfanim.core.system.assets import MOTION

RATES = (30.0, 60.0, 120.0)
AT = 42  # frame of the fault, in which the legs swing slowly: fast ones are cut a frame sooner or later


def cleaned(motion: Motion, jumps: tuple[int, ...] = ()) -> CleanedMotion:
    flags = np.zeros(motion.frames, dtype=bool)
    flags[list(jumps)] = True
    return clean_motion(motion, flags)


def rows(result: CleanedMotion) -> list[tuple[str, int, int, str]]:
    return [(defect.kind, defect.first, defect.last, defect.done) for defect in result.defects]


@pytest.fixture(scope="module", params=RATES)
def run(request: pytest.FixtureRequest) -> Motion:
    """The fastest of the shipped kinds of motion."""
    return resampled(read_motion(next(MOTION.glob("running-01*.bvh"))), request.param)


def turned(motion: Motion, joint: str, frames: slice, degrees: float) -> Motion:
    rotations = motion.rotations.copy()
    index = JOINT_NAMES.index(joint)
    turn = rot.from_rotation_vector(np.radians([0.0, degrees, 0.0]))
    rotations[frames, index] = rot.multiply(rotations[frames, index], turn)
    return replace(motion, rotations=rotations)


def moved(motion: Motion, frames: slice, metres: float) -> Motion:
    positions = motion.root_positions_m.copy()
    positions[frames] += [metres, 0.0, 0.0]
    return replace(motion, root_positions_m=positions)


def assert_parts(result: CleanedMotion, motion: Motion, ranges: list[tuple[int, int]]) -> None:
    assert [(first, first + part.frames) for first, part in result.parts] == ranges
    for first, part in result.parts:
        np.testing.assert_array_equal(part.rotations, motion.rotations[first : first + part.frames])


@pytest.mark.parametrize("rate", RATES)
def test_shipped_motion_has_no_defects(rate: float) -> None:
    for path in sorted(MOTION.glob("*.bvh"))[::4]:
        motion = resampled(read_motion(path), rate)
        result = cleaned(motion)
        assert rows(result) == [], path.stem
        assert_parts(result, motion, [(0, motion.frames)])


def test_a_root_jump_cuts_the_clip_and_loses_no_frame(run: Motion) -> None:
    result = cleaned(moved(run, slice(AT, None), 0.5))
    assert rows(result) == [("root jump", AT + 1, AT + 1, "cut, the rest is another clip")]
    assert_parts(result, run, [(0, AT), (AT, run.frames)])


def test_a_root_that_jumps_away_and_back_loses_those_frames(run: Motion) -> None:
    result = cleaned(moved(run, slice(AT, AT + 4), 0.5))
    assert rows(result) == [("root jump", AT + 1, AT + 4, "cut out")]
    assert_parts(result, run, [(0, AT), (AT + 4, run.frames)])


@pytest.mark.parametrize("joint", ["lhumerus", "rfemur", "rtibia", "head", "rfoot"])
@pytest.mark.parametrize("frames", [1, 4])
def test_a_limb_pop_is_cut_out(run: Motion, joint: str, frames: int) -> None:
    result = cleaned(turned(run, joint, slice(AT, AT + frames), 110.0))
    assert rows(result) == [(f"limb pop of {joint}", AT + 1, AT + frames, "cut out")]
    assert_parts(result, run, [(0, AT), (AT + frames, run.frames)])


def test_pops_at_the_ends_are_cut_off(run: Motion) -> None:
    broken = turned(turned(run, "lhumerus", slice(0, 3), 110.0), "lfemur", slice(run.frames - 2, None), 110.0)
    result = cleaned(broken)
    assert_parts(result, run, [(3, run.frames - 2)])
    assert [row[1:3] for row in rows(result)] == [(1, 3), (run.frames - 1, run.frames)]


def test_a_limb_that_stays_turned_cuts_the_clip(run: Motion) -> None:
    broken = turned(run, "rhumerus", slice(AT, None), 110.0)
    result = cleaned(broken)
    assert rows(result) == [("limb pop of rhumerus", AT + 1, AT + 1, "cut, the rest is another clip")]
    assert_parts(result, broken, [(0, AT), (AT, run.frames)])


@pytest.mark.parametrize("joint", ["lhand", "rthumb", "lfingers", "rtoes", "lwrist"])
def test_a_flip_at_an_end_is_bridged(run: Motion, joint: str) -> None:
    result = cleaned(turned(run, joint, slice(AT, AT + 4), 160.0))
    assert rows(result) == [(f"flip of {joint}", AT + 1, AT + 4, "rotation interpolated")]
    ((first, part),) = result.parts
    assert (first, part.frames) == (0, run.frames)
    index = JOINT_NAMES.index(joint)
    before, after = run.rotations[AT - 1, index], run.rotations[AT + 4, index]
    expected = run.rotations.copy()
    expected[AT : AT + 4, index] = [rot.slerp(before, after, share) for share in (0.2, 0.4, 0.6, 0.8)]
    assert rot.angle_between(part.rotations, expected).max() < 1e-6


def test_a_flip_in_the_first_frames_takes_the_first_good_rotation(run: Motion) -> None:
    result = cleaned(turned(run, "lhand", slice(0, 4), 160.0))
    assert rows(result) == [("flip of lhand", 1, 4, "rotation interpolated")]
    hand = result.parts[0][1].rotations[:, JOINT_NAMES.index("lhand")]
    np.testing.assert_array_equal(hand[:4], np.tile(run.rotations[4, JOINT_NAMES.index("lhand")], (4, 1)))


def test_flips_that_follow_each_other_are_bridged_one_by_one(run: Motion) -> None:
    """What lies between them is good."""
    broken = turned(turned(run, "lhand", slice(AT, AT + 2), 160.0), "lhand", slice(AT + 5, AT + 7), 160.0)
    result = cleaned(broken)
    done = "rotation interpolated"
    assert rows(result) == [("flip of lhand", AT + 1, AT + 2, done), ("flip of lhand", AT + 6, AT + 7, done)]
    hand = result.parts[0][1].rotations[:, JOINT_NAMES.index("lhand")]
    np.testing.assert_array_equal(hand[AT + 2 : AT + 5], run.rotations[AT + 2 : AT + 5, JOINT_NAMES.index("lhand")])


def test_a_flip_soon_after_the_start_is_the_shorter_piece(run: Motion) -> None:
    result = cleaned(turned(run, "rhand", slice(2, 5), 160.0))
    assert rows(result) == [("flip of rhand", 3, 5, "rotation interpolated")]


def test_a_long_flip_is_kept_and_named(run: Motion) -> None:
    stop = AT + int(0.4 * run.fps)
    broken = turned(run, "rhand", slice(AT, stop), 160.0)
    result = cleaned(broken)
    assert rows(result) == [("flip of rhand, too long to interpolate", AT + 1, stop + 1, "kept")]
    assert_parts(result, broken, [(0, run.frames)])


def test_angles_that_flip_without_the_rotation_are_kept_and_named(run: Motion) -> None:
    result = cleaned(run, (AT, AT + 20))
    assert rows(result) == [("Euler angles flip 2 times, but the rotation does not", AT + 1, AT + 21, "kept")]
    assert_parts(result, run, [(0, run.frames)])
    jumped = cleaned(turned(run, "lhumerus", slice(AT, None), 110.0), (AT,))
    assert [row[0] for row in rows(jumped)] == ["limb pop of lhumerus"]


def with_pose_before(motion: Motion, pose: np.ndarray, frames: int = 1) -> Motion:
    rotations = np.concatenate((np.tile(pose, (frames, 1, 1)), motion.rotations))
    positions = np.concatenate((np.tile([[0.0, 0.9, 0.0]], (frames, 1)), motion.root_positions_m))
    return replace(motion, rotations=rotations, root_positions_m=positions)


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("kind", ["walking-01*", "boxing-01*"])
@pytest.mark.parametrize("legs", ["rest", "calibration"])
def test_an_added_t_pose_is_cut_off(rate: float, kind: str, legs: str) -> None:
    motion = resampled(read_motion(next(MOTION.glob(f"{kind}.bvh"))), rate)
    pose = rot.identity((len(JOINT_NAMES),)) if legs == "rest" else t_pose(motion.skeleton)
    broken = with_pose_before(motion, pose)
    result = cleaned(broken)
    assert rows(result) == [("T pose added as first frame", 1, 1, "cut off")]
    assert_parts(result, broken, [(1, broken.frames)])


def test_a_performer_who_leaves_a_t_pose_is_kept(run: Motion) -> None:
    """Half a second from the T to hanging arms, from rest to rest."""
    frames = int(0.5 * run.fps) + 1
    share = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, frames))
    arms_down = np.repeat(run.rotations[:1], frames, axis=0)
    shares = np.repeat(share[:, None], len(JOINT_NAMES), axis=1)
    lowered = rot.slerp(rot.identity(shares.shape), arms_down, shares)
    motion = Motion("t", run.fps, run.skeleton, lowered, np.tile([[0.0, 0.9, 0.0]], (frames, 1)))
    assert rows(cleaned(motion)) == []


def test_short_motion_is_left_alone(run: Motion) -> None:
    for frames in (1, 2, 3):
        short = replace(run, rotations=run.rotations[:frames], root_positions_m=run.root_positions_m[:frames])
        assert_parts(cleaned(short), short, [(0, frames)])


@pytest.mark.parametrize("first", [0, pytest.param(60, marks=pytest.mark.long)])
def test_recorded_clips_without_defects_are_left_alone(bandai_dir: Path, first: int) -> None:
    """Clips of every kind, none of which has a jump for the eye: none may be cut."""
    paths = sorted(bandai_dir.rglob("*.bvh"))[first::120]
    assert len(paths) > 10
    for path in paths:
        motion = read_motion(path)
        assert rows(cleaned(motion)) == [], path.stem
        broken = cleaned(turned(motion, "lfemur", slice(10, 12), 120.0))
        assert rows(broken) == [("limb pop of lfemur", 11, 12, "cut out")], path.stem


def test_known_defects_of_recordings_are_found(cmu_dir: Path) -> None:
    """135_02's hands flip for four frames; in 16_16 the left hand does just after the start; 07_01 is clean."""
    found = {}
    for trial in ("135_02", "16_16", "07_01"):
        result = cleaned(read_motion(cmu_dir / trial[:-3] / f"{trial}.amc"))
        assert len(result.parts) == 1
        found[trial] = rows(result)
    assert ("flip of lhand", 558, 561, "rotation interpolated") in found["135_02"]
    assert found["16_16"] == [(f"flip of {name}", 4, 8, "rotation interpolated") for name in ("lhand", "lthumb")]
    assert found["07_01"] == []
