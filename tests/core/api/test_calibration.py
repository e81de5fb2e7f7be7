"""Performers and cameras calibrated as scripts do it."""

from dataclasses import replace

import numpy as np
import perfanim
import pytest
from perfanim.core.body.calibration_poses import t_pose
from perfanim.core.body.motion import Motion
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.simulate.simulated_markers import simulate_markers

from tests.helpers.exchanged_sides import sides_exchanged


def test_performer_who_holds_a_pose_is_measured(subject):
    rotations, root_m = t_pose(subject.skeleton), np.array([0.0, 1.0, 0.0])
    held = Motion("pose", 30.0, subject.skeleton, np.tile(rotations, (60, 1, 1)), np.tile(root_m, (60, 1)))
    take = simulate_markers(held, subject, noise_mm=0.5, seed=4)[0]
    found = perfanim.calibrate_subject(take, name="walker")
    assert (found.subject.name, found.subject.marker_set.name) == ("walker", "locomotion")
    assert found.subject.residual_m < 0.01
    again = perfanim.calibrate_subject(take, "locomotion", ["t"], known=found.subject)
    np.testing.assert_array_equal(again.subject.skeleton.offsets_m, found.subject.skeleton.offsets_m)


def test_exchanged_sides_do_not_change_the_measured_body(subject):
    worn = replace(subject, marker_set=load_marker_set("cmu-41"))
    rotations, root_m = t_pose(subject.skeleton), np.array([0.0, 1.0, 0.0])
    held = Motion("pose", 30.0, subject.skeleton, np.tile(rotations, (60, 1, 1)), np.tile(root_m, (60, 1)))
    take = simulate_markers(held, worn, noise_mm=0.5, seed=4)[0]
    found, expected = (perfanim.calibrate_subject(each, "cmu-41").subject for each in (sides_exchanged(take), take))
    np.testing.assert_array_equal(found.skeleton.offsets_m, expected.skeleton.offsets_m)


def test_performer_is_measured_by_motion_alone(truth, subject, database):
    take = simulate_markers(truth, subject, noise_mm=1.0, seed=4)[0]
    found = perfanim.fit_subject(take, database, height_m=1.8, name="walker")
    assert found.name == "walker" and found.residual_m < 0.01


def test_cameras_need_pictures_of_one_kind(tmp_path):
    (tmp_path / "left.mp4").write_bytes(b"")
    (tmp_path / "right").mkdir()
    sources = {"left": tmp_path / "left.mp4", "right": tmp_path / "right"}
    with pytest.raises(perfanim.PerfanimError, match="left is a video, but right is not; give a video for"):
        perfanim.calibrate_cameras(sources, "chessboard:9x6:25mm")
