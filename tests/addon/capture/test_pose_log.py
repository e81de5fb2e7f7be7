"""Poses of a capture come back from the disk as they came."""

from typing import Any

import numpy as np
import pytest
from perfanim.core.body.scene_pose import PerformerPose, ScenePose
from perfanim.core.formats.take_file.pose_codec import TimedPose, pack_solved
from perfanim.perfanim_addon.capture import pose_log

COUNT, IN_MEMORY = 23, 10


def pose(number: int) -> ScenePose:
    none, single = np.full((number % 4, 3), np.nan), np.full(number % 4, -1)  # of different lengths
    rotations = np.full((3, 4), 0.1 * number)
    return ScenePose((PerformerPose(number, number / 60, rotations, np.zeros(3), 0.9, none, none, single, 0.01),))


def filled() -> pose_log.PoseLog:
    log = pose_log.PoseLog(IN_MEMORY)
    for number in range(COUNT):
        log.append(pack_solved(TimedPose(pose(number), 0.0)), pose(number))
        assert log[-1].number == number
    return log


def check(log: pose_log.PoseLog) -> None:
    assert [each.number for each in log] == list(range(COUNT))
    assert [each.number for each in log[-5:]] == list(range(COUNT - 5, COUNT))
    for number in (0, IN_MEMORY - 1, IN_MEMORY, COUNT - 1):
        np.testing.assert_array_equal(log[number].performers[0].rotations, pose(number).performers[0].rotations)
    with pytest.raises(IndexError):
        log[COUNT]


def test_poses_are_kept_in_their_order() -> None:
    log = filled()
    check(log)
    assert len(log._recent) == COUNT % IN_MEMORY


def test_poses_stay_in_memory_on_a_full_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(**_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(pose_log.tempfile, "TemporaryFile", full)
    log = filled()
    check(log)
    assert len(log._recent) == COUNT
