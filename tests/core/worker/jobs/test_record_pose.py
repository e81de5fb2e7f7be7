"""Recording the performer in calibration poses, by the real worker."""

from pathlib import Path

import numpy as np
from jobs_played import outcome, played, said
from perfanim.core.body.calibration_poses import INSTRUCTIONS
from perfanim.core.formats.markers.marker_files import read_take
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.subjects.pose_calibration import pose_points


def test_the_performer_is_told_each_pose_and_recorded_in_it(tmp_path: Path) -> None:
    request = {
        "job": "record pose",
        "source": {"kind": "simulated", "marker_set": "boxing", "fps": 30},
        "marker_set": "boxing",
        "poses": ["t", "hanging"],
        "countdown_s": 9.0,
        "between_s": 9.0,
        "seconds": 1.25,
        "out": str(tmp_path / "poses.take.npz"),
    }
    messages = played(request)
    poses = [line for line in dict.fromkeys(said(messages)) if any(words in line for words in INSTRUCTIONS.values())]
    # the simulated performer needs a second from one pose to the next, and is ready for the first
    assert poses == [
        "hold still: " + INSTRUCTIONS["t"],
        "1: " + INSTRUCTIONS["hanging"],
        "hold still: " + INSTRUCTIONS["hanging"],
    ]
    result = outcome(messages).json()
    take, worn = read_take(result["out"]), load_marker_set("boxing")
    assert take.frames == result["frames"] >= 3.4 * 30
    points = pose_points(take, worn, request["poses"])
    hands = [worn.names.index(name) for name in ("LHAN", "RHAN")]
    across = np.linalg.norm(points[:, hands[0]] - points[:, hands[1]], axis=-1)
    assert across[0] > 2.0 * across[1]  # arms out, then down
