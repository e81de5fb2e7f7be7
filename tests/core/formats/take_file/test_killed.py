"""Processes that write takes, killed at random moments."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from perfanim.core.formats.take_file.pose_codec import pack_solved
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.formats.take_file.take_recovery import recover
from perfanim.core.markers.marker_frame_codec import pack_stamped
from perfanim.core.system.lock import is_locked
from records import frame_record, pose_record

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="the program forks")
PROGRAM = Path(__file__).with_name("write_until_killed.py")
KILLS = 20
MOST_LOST = 15  # frames: a quarter of a second


@pytest.mark.skipif(not hasattr(os, "fork"), reason="starts its processes by fork")
def test_a_killed_writer_loses_a_quarter_of_a_second_at_most(tmp_path: Path) -> None:
    rng = np.random.default_rng()  # other moments at every run; what is promised holds at all of them
    moments = [f"{seconds:.4f}" for seconds in rng.uniform(0.2, 2.0, KILLS)]
    done = subprocess.run([sys.executable, str(PROGRAM), str(tmp_path), *moments], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    handed_over = [int(line) for line in done.stdout.split()]
    assert len(handed_over) == KILLS
    assert max(handed_over) > MOST_LOST
    for number, count in enumerate(handed_over):
        if not count:  # killed before it began
            continue
        path = tmp_path / f"{number}.perftake"
        take = read_take_file(path)
        assert not is_locked(path)
        assert not take.complete
        assert all(fault.cut for fault in take.faults)
        frames = [pack_stamped(stamp_s, frame) for stamp_s, frame in take.stamped_frames]
        poses = [pack_solved(pose) for pose in take.poses]
        assert frames == [frame_record(i) for i in range(len(frames))]
        assert poses == [pose_record(i) for i in range(len(poses))]
        assert min(len(frames), len(poses)) >= count - MOST_LOST, f"killed after {moments[number]} s"
        recover(take, tmp_path / "whole.perftake")
        assert read_take_file(tmp_path / "whole.perftake").complete
