"""Live capture does without SciPy, which is slow to load and the only package bound to one version of Python."""

import os
import subprocess
import sys

import numpy as np
import pytest
from perfanim.core.markers.subject import save_subject

CODE = """
import sys

import numpy as np

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] == "scipy":
            raise ImportError(f"{name} is blocked")

sys.meta_path.insert(0, Blocked())
try:
    import scipy
except ImportError:
    print("blocked")
import perfanim.core.session.capture_setup, perfanim.core.session.multi_target_session
import perfanim.core.vision.live_frames, perfanim.core.vision.pipeline
import perfanim.core.worker.jobs.capture_stages, perfanim.core.worker.jobs.run_capture
from perfanim.core.database.store import open_database
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.subject import load_subject
from perfanim.core.session.session import Session

markers = np.load(sys.argv[1])
session = Session(load_subject(sys.argv[2]), open_database(sys.argv[3]))
for number, points in enumerate(markers):
    frame = MarkerFrame(number, number / 30.0, points[::-1], np.tile(1e-6 * np.eye(3), (len(points), 1, 1)))
    pose = session.step(frame)
print(session.is_tracking, np.abs(pose.markers_m - markers[-1]).max() < 0.03)
"""


@pytest.mark.parametrize("kernel", ["", "off"])
def test_a_capture_without_labels_is_solved(kernel, subject, database, true_markers, tmp_path):
    np.save(tmp_path / "markers.npy", true_markers[:20])
    save_subject(subject, tmp_path / "subject.toml")
    files = [str(tmp_path / "markers.npy"), str(tmp_path / "subject.toml"), str(database.path)]
    environment = os.environ | {"PERFANIM_KERNEL": kernel}
    command = [sys.executable, "-c", CODE, *files]
    done = subprocess.run(command, capture_output=True, text=True, cwd="/", env=environment, check=False)
    assert done.stdout.splitlines() == ["blocked", "True True"], done.stderr
