"""Figures that need no truth."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.motion import Motion
from perfanim.core.body.scene_pose import PerformerPose, ScenePose
from perfanim.core.cli.batch.quality import foot_skate_cm_s, quality_figures, why_doubtful
from perfanim.core.session.solved_take import SolvedTake

FPS = 50.0


def standing(skeleton, positions):
    rotations = np.tile([1.0, 0.0, 0.0, 0.0], (len(positions), len(skeleton), 1))
    return Motion("stand", FPS, skeleton, rotations, np.asarray(positions, dtype=float))


def test_feet_that_slide_at_a_known_speed(truth):
    """A body that is pushed along at 50 cm/s slides at that; lifted by half the height that counts, at less."""
    along = np.linspace([0.0, 1.0, 0.0], [0.6, 1.0, 0.8], 101)  # a metre in two seconds
    assert foot_skate_cm_s(standing(truth.skeleton, along)) == pytest.approx(50.0)
    assert foot_skate_cm_s(standing(truth.skeleton, np.tile([0.0, 1.0, 0.0], (20, 1)))) == 0.0
    lifted = along.copy()
    lifted[10:, 1] += 0.0125
    slower = (9 + 91 * (2.0 - np.sqrt(2.0))) / 100  # between the two the height is halfway, up to a frame
    assert foot_skate_cm_s(standing(truth.skeleton, lifted)) == pytest.approx(50.0 * slower, abs=0.5)
    flying = along.copy()
    flying[10:, 1] += 1.0
    assert foot_skate_cm_s(standing(truth.skeleton, flying)) == pytest.approx(50.0)
    assert np.isnan(foot_skate_cm_s(standing(truth.skeleton, along[:1])))


def solved(truth, confidence, rms_m, hidden=()):
    """Return a take of poses of some confidence and error; hidden are (frame, marker)."""
    poses = []
    for frame, (sure, off) in enumerate(zip(confidence, rms_m, strict=True)):
        seen = np.zeros((4, 3))
        seen[[marker for f, marker in hidden if f == frame]] = np.nan
        alone = np.full(4, -1)
        root = np.array([0.0, 1.0, 0.0])
        pose = PerformerPose(frame, frame / FPS, truth.rotations[0], root, sure, seen, seen, alone, off)
        poses.append(ScenePose((pose,)))
    motion = standing(truth.skeleton, np.tile([0.0, 1.0, 0.0], (len(poses), 1)))
    return SolvedTake(tuple(poses), (motion,), np.zeros(len(poses)), np.zeros(len(poses), dtype=bool))


def test_figures_of_known_poses(truth):
    take = solved(truth, [0.9, 0.8, 0.7, 0.0], [0.003, 0.004, 0.0, np.nan], [(1, 2), (2, 2), (3, 2), (3, 0)])
    figures = quality_figures(take)
    assert figures["frames"] == 4
    assert figures["duration_s"] == pytest.approx(3 / FPS)
    assert figures["marker_rms_mm"] == pytest.approx(np.sqrt(25.0 / 3.0), abs=1e-3)
    assert (figures["marker_median_mm"], figures["marker_worst_mm"]) == (3.0, 4.0)
    assert figures["confidence"] == pytest.approx(0.6)
    assert figures["hidden"] == 4 / 16
    assert figures["longest_gap_s"] == pytest.approx(3 / FPS)
    assert figures["unsolved"] == 0.25
    assert figures["foot_skate_cm_s"] == 0.0
    (one,) = take.poses[3].performers
    by_one_camera = ScenePose((replace(one, single_cameras=np.array([0, -1, -1, -1])),))
    assert quality_figures(replace(take, poses=(*take.poses[:3], by_one_camera)))["hidden"] == 3 / 16


def test_doubtful_and_good(truth):
    nothing = quality_figures(solved(truth, [0.0] * 3, [np.nan] * 3))
    assert nothing["marker_rms_mm"] is None
    good = quality_figures(solved(truth, [0.9] * 3, [0.002] * 3))
    assert why_doubtful(good) == []
    for figure, value, said in (
        ("confidence", 0.3, "confidence is 30%"),
        ("hidden", 0.25, "25% of the markers"),
        ("longest_gap_s", 1.5, "hidden for 1.5 s"),
        ("foot_skate_cm_s", 80.0, "feet slide at 80 cm/s"),
        ("marker_rms_mm", 45.0, "45 mm off"),
    ):
        (reason,) = why_doubtful(good | {figure: value})
        assert said in reason
