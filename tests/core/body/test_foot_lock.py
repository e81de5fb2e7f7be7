"""Feet that stand are held, those that move are left alone."""

from dataclasses import replace

import numpy as np
import pytest
from motion_synthesis import perform
from perfanim.core.body.foot_lock import FootLock, floor_of, hold_feet
from perfanim.core.body.motion import Motion
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.errors import SettingsError
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.simulate.studio.studio_rig import default_rig

SWAY_M = 0.02


@pytest.fixture(scope="module")
def walk() -> Motion:
    return perform("walking", 4.0)


@pytest.fixture(scope="module")
def swaying(walk: Motion) -> Motion:
    """The walk with hips that sway slowly, as solved ones do where nothing shows them better."""
    seconds = np.arange(walk.frames) / walk.fps
    sway = SWAY_M * np.stack((np.sin(2.6 * seconds), np.zeros_like(seconds), np.cos(2.2 * seconds)), axis=1)
    return replace(walk, root_positions_m=walk.root_positions_m + sway)


def balls(motion: Motion) -> np.ndarray:
    joints = [motion.skeleton.index(name) for name in ("ltoes", "rtoes")]
    return forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)[0][:, joints]


def test_standing_feet_stay_and_the_body_hardly_changes(walk: Motion, swaying: Motion) -> None:
    before = evaluate(swaying, walk)
    for floor_m in (0.0, None):
        held = hold_feet(swaying, "auto", floor_m)
        after = evaluate(held, walk)
        # a sway of 2 cm at 2.4 rad/s is 5 cm/s
        assert before["foot_skate_cm_s"] > 3.0
        assert after["foot_skate_cm_s"] < 0.3 * before["foot_skate_cm_s"]
        assert after["deg_per_joint"] < 1.0
        np.testing.assert_array_equal(held.root_positions_m, swaying.root_positions_m)
        legs = [walk.skeleton.index(side + name) for side in "lr" for name in ("femur", "tibia", "foot")]
        others = np.setdiff1d(np.arange(len(walk.skeleton)), legs)
        np.testing.assert_array_equal(held.rotations[:, others], swaying.rotations[:, others])
        # the foot keeps its direction in the room
        feet = [walk.skeleton.index(name) for name in ("lfoot", "rfoot")]
        turned = [forward_kinematics(m.skeleton, m.rotations, m.root_positions_m)[1][:, feet] for m in (held, swaying)]
        assert np.degrees(rot.angle_between(*turned)).max() < 1e-3


def test_without_a_floor_the_lowest_foot_tells_it(walk: Motion, swaying: Motion) -> None:
    high = replace(swaying, root_positions_m=swaying.root_positions_m + np.array([0.0, 0.7, 0.0]))  # a camera's world
    known, guessed = (FootLock(walk.skeleton, "auto", floor_m) for floor_m in (0.7, None))
    planted = np.zeros((2, walk.frames, 2), dtype=bool)
    for frame, (rotations, root) in enumerate(zip(high.rotations, high.root_positions_m, strict=True)):
        for row, lock in enumerate((known, guessed)):
            lock.step(frame / walk.fps, rotations, root)
            planted[row, frame] = [foot.anchor_m is not None for foot in lock._feet]
    assert planted[0].mean() > 0.3
    assert np.mean(planted[0] == planted[1]) > 0.9


def test_nothing_jumps_when_a_foot_is_held_or_let_go(walk: Motion, swaying: Motion) -> None:
    held = hold_feet(swaying, "auto", 0.0)
    # what is added to the ball of the foot changes by what the ball moves while held, at most 0.4 m/s, and when it is
    # let go by 5 cm that fade out in 0.12 s, at most 0.42 m/s
    added = balls(held) - balls(swaying)
    assert np.linalg.norm(np.diff(added, axis=0), axis=-1).max() <= 0.45 / walk.fps
    assert np.linalg.norm(added, axis=-1).max() <= 0.05 + 1e-9
    assert np.linalg.norm(added, axis=-1).max() > 0.005


def knees_deg(motion: Motion) -> np.ndarray:
    positions = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)[0]
    found = []
    for side in "lr":
        hip, knee, ankle = (positions[:, motion.skeleton.index(side + name)] for name in ("femur", "tibia", "foot"))
        thigh, shank = (knee - hip, ankle - knee)
        lengths = np.linalg.norm(thigh, axis=-1) * np.linalg.norm(shank, axis=-1)
        found.append(np.degrees(np.arccos(np.clip(np.sum(thigh * shank, axis=-1) / lengths, -1.0, 1.0))))
    return np.array(found)


def test_a_knee_is_not_pulled_straight(walk: Motion, swaying: Motion) -> None:
    before, after = knees_deg(swaying), knees_deg(hold_feet(swaying, "always", 0.0))
    # a leg stretched to 0.995 of its length has a knee of 11.5 degrees; one that was straighter may be so still
    assert np.all(after >= np.minimum(before, 11.0) - 1e-6)
    assert np.any(np.abs(after - before) > 1.0)


def test_a_gliding_foot_is_held_only_always(walk: Motion) -> None:
    frame = 10  # one foot is lower: which of two equal ones is held is a matter of rounding
    still = replace(
        walk,
        rotations=np.repeat(walk.rotations[frame : frame + 1], 60, axis=0),
        root_positions_m=walk.root_positions_m[frame] + np.arange(60)[:, None] / 60 * [0.0, 0.0, 0.25],
    )  # 0.25 m/s: too fast to stand
    speeds = {}
    for mode in ("auto", "always"):
        path = balls(hold_feet(still, mode, 0.0))
        speeds[mode] = np.linalg.norm(np.diff(path, axis=0), axis=-1).min(axis=1)[:10].mean() * 60
    assert speeds["auto"] == pytest.approx(0.25, abs=1e-6)
    assert speeds["always"] < 0.01


def test_off_is_nothing_at_all_and_other_words_are_refused(walk: Motion) -> None:
    assert hold_feet(walk, "off", 0.0) is walk
    pose = walk.rotations[0]
    assert FootLock(walk.skeleton, "off").step(0.0, pose, walk.root_positions_m[0]) is pose
    with pytest.raises(SettingsError, match="off, auto, always"):
        FootLock(walk.skeleton, "sometimes")


def test_the_floor_is_the_calibrations() -> None:
    rig = default_rig()
    assert floor_of(CameraRig(rig.cameras, {"floor": "y = 0"})) == 0.0
    assert floor_of(CameraRig(rig.cameras, {})) is None
    assert floor_of(None) is None
