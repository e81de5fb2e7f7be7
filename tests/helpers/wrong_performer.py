"""A walk recorded with a performer whose bones are 10 % too long."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
from perfanim.core.body.motion import resampled
from perfanim.core.cli.main import main
from perfanim.core.formats.markers.marker_files import write_take
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject, save_subject
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.subjects.body_change import PARTS, sized
from perfanim.core.system.assets import MOTION


def record_walk_of_a_wrong_performer(folder: Path) -> SimpleNamespace:
    """Write walk.take.npz, walk.pfdb and anna.toml; return the folder, the right performer and the wrong one."""
    motion = resampled(read_motion(MOTION / "walking-02-energetic.bvh"), 30.0)
    write_bvh(motion, folder / "walk.bvh")
    assert main(["database", "build", str(folder / "walk.bvh"), "--fps", "30", "--out", str(folder / "walk.pfdb")]) == 0
    right = Subject("Anna", motion.skeleton, load_marker_set("locomotion"))
    wrong = Subject("Anna", sized(right.skeleton, np.full(len(PARTS), 0.1)), right.marker_set)
    save_subject(wrong, folder / "anna.toml")
    write_take(simulate_markers(motion, right, 1.0, seed=1)[0], folder / "walk.take.npz")
    return SimpleNamespace(folder=folder, right=right, wrong=wrong)
