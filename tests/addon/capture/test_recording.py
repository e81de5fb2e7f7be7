"""The countdown to a recording and its length, without Blender."""

import numpy as np
import pytest
from perfanim.core.body.scene_pose import PerformerPose, ScenePose
from perfanim.perfanim_addon.capture.capture_recording import Cue, Recording


class Clock:
    """A clock that the test moves."""

    now = 50.0

    def __call__(self) -> float:
        return self.now


def poses(count: int) -> list[ScenePose]:
    nowhere, none = np.empty((0, 3)), np.empty(0, dtype=np.int64)
    return [
        ScenePose((PerformerPose(n, n / 60, np.zeros((29, 4)), np.zeros(3), 0.5, nowhere, nowhere, none, 0.0),))
        for n in range(count)
    ]


def test_without_a_countdown_everything_is_recorded() -> None:
    recording, all_poses = Recording(), poses(90)
    assert recording.advance([]) is None
    assert not recording.begun
    assert recording.advance(all_poses[:3]) is None  # the first three came at once
    assert recording.begun
    assert recording.advance(all_poses) is None
    assert not recording.over
    assert recording.recorded(all_poses) == all_poses


def test_the_countdown_beeps_and_what_comes_before_its_end_is_left_out() -> None:
    clock, all_poses = Clock(), poses(240)
    recording = Recording(countdown_s=2.0, clock=clock)
    heard, left = [], []
    for number in range(1, len(all_poses) + 1):
        clock.now = 50.0 + number / 60
        cue = recording.advance(all_poses[:number])
        heard += [(cue, number)] if cue else []
        left.append(recording.seconds_left)
    assert [cue for cue, _ in heard] == [Cue.COUNT, Cue.COUNT, Cue.BEGIN]
    assert [number for _, number in heard] == pytest.approx([1, 61, 121], abs=1)
    assert left[5] == 2 and left[90] == 1 and left[-1] == 0
    begun = heard[-1][1]
    assert recording.recorded(all_poses) == all_poses[begun:]


def test_it_ends_by_itself_to_the_frame() -> None:
    clock, all_poses = Clock(), poses(240)
    recording = Recording(length_s=1.5, clock=clock)
    cues = [recording.advance(all_poses[:number]) for number in range(0, 241, 7)]  # seven come at once
    assert cues.count(Cue.END) == 1
    assert recording.over
    assert [pose.number for pose in recording.recorded(all_poses)] == list(range(91))


def test_a_capture_that_is_stopped_in_the_countdown_records_nothing() -> None:
    recording = Recording(countdown_s=5.0, clock=Clock())
    assert recording.advance(poses(10)) is Cue.COUNT
    assert recording.recorded(poses(10)) == []


def test_what_is_asked_for_later_begins_then_and_ends_when_told() -> None:
    all_poses = poses(60)
    recording = Recording(later=True, clock=Clock())
    assert recording.advance(all_poses[:20]) is Cue.BEGIN
    assert recording.advance(all_poses[:40]) is None
    recording.end(all_poses[:40])
    assert recording.over
    assert recording.advance(all_poses) is None
    assert recording.recorded(all_poses) == all_poses[20:40]


def test_what_is_ended_in_its_countdown_records_nothing() -> None:
    recording = Recording(countdown_s=3.0, later=True, clock=Clock())
    assert recording.advance(poses(10)) is Cue.COUNT
    recording.end(poses(12))
    assert recording.seconds_left == 0
    assert recording.recorded(poses(60)) == []
