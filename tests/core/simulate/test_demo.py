"""The whole chain on the embedded default, shortened: what it writes and how far it is from the simulated truth."""

import json
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.cli.main import main
from perfanim.core.formats.motion.bvh import read_bvh
from perfanim.core.retarget.to_standard_skeleton import to_standard_skeleton
from perfanim.core.simulate import run_demo
from perfanim.core.simulate.calibrated_studio import calibrate_studio


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    out = tmp_path_factory.mktemp("demo")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run_demo, "calibrate_studio", partial(calibrate_studio, pictures=10))
        assert main(["demo", "--out", str(out), "--seconds", "5"]) == 0
    return json.loads((out / "report.json").read_text())


def test_writes_what_it_says(report):
    for name, path in report["outputs"].items():
        assert Path(path).stat().st_size > 1000 or name == "report", name
    video = cv2.VideoCapture(report["outputs"]["video"])
    assert int(video.get(cv2.CAP_PROP_FRAME_COUNT)) == (report["frames"] + 1) // 2


def test_is_near_the_truth(report):
    # nearest embedded poses are 2.3 degrees a joint from the demo's even with the true pose to search by
    assert report["deg_per_joint"] < 4.0
    # a marker is off by about a millimetre through calibrated cameras; the body's size is known to about a centimetre
    assert report["mpjpe_mm"] < 20.0
    assert report["mpjpe_absolute_mm"] < 25.0
    assert report["confidence"] > 0.8


def test_limbs_bend_the_right_way_and_feet_stay_at_the_floor(report):
    motion = to_standard_skeleton(read_bvh(Path(report["outputs"]["motion"])))
    positions, _ = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    index = motion.skeleton.index
    for side in "lr":
        hip, knee, ankle = (positions[:, index(side + name)] for name in ("femur", "tibia", "foot"))
        toes = positions[:, index(side + "toes")]
        forward = toes - ankle
        forward[:, 1] = 0.0
        forward /= np.linalg.norm(forward, axis=1, keepdims=True)
        straight = np.linalg.norm(knee - hip, axis=1) + np.linalg.norm(ankle - knee, axis=1)
        bent = straight - np.linalg.norm(ankle - hip, axis=1) > 0.01
        ahead = np.sum((knee - 0.5 * (hip + ankle)) * forward, axis=1)
        assert np.mean(ahead[bent] > 0.0) > 0.98, side
        # the ankle joint of a person lies 5 to 12 cm above the sole; calibration adds a centimetre or two
        assert -0.02 < np.percentile(toes[:, 1], 1) < 0.08, side
    assert np.max(np.abs(np.diff(positions, axis=0))) < 0.2  # 12 m/s: nothing flips
