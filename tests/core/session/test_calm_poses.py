"""Poses of noisy markers with gaps: no joint jumps."""

import numpy as np
import pytest
from perfanim.core.body.motion import resampled, sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers import marker_smoothing
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.marker_smoothing import SmoothingSettings
from perfanim.core.markers.subject import Subject
from perfanim.core.session.solve_take import solve_take
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.system.assets import MOTION

FPS = 60.0
JUMP_DEG = 10.0  # change of a joint between two frames beyond the truth's own


@pytest.fixture(scope="module")
def truth():
    return sliced(resampled(read_motion(MOTION / "jumping-05-tired.bvh"), FPS), 60, 180)


@pytest.fixture(scope="module")
def subject(truth):
    return Subject("jumper", truth.skeleton, load_marker_set("locomotion"))


def test_no_joint_jumps_with_noise_and_gaps(truth, subject, database):
    take, _ = simulate_markers(truth, subject, noise_mm=3.0, dropout=0.1, seed=1)
    solved = solve_take(take, subject, database, SolveSettings(), lambda fraction, text: None).motion
    beyond = changes_deg(solved.rotations) - changes_deg(truth.rotations)
    assert beyond.max() <= JUMP_DEG


@pytest.mark.parametrize("causal", [True, pytest.param(False, marks=pytest.mark.long)], ids=["live", "offline"])
def test_extrapolated_hidden_markers_reduce_errors(truth, subject, database, monkeypatch, causal):
    take, _ = simulate_markers(truth, subject, noise_mm=1.0, dropout=0.2, seed=2)

    def errors() -> dict:
        solved = solve_take(take, subject, database, SolveSettings(), lambda fraction, text: None, causal=causal)
        first = next(frame for frame, pose in enumerate(solved.poses_of()) if pose.confidence > 0.0)
        return evaluate(*(sliced(motion, first, truth.frames) for motion in (solved.motion, truth)))

    going_on = errors()
    monkeypatch.setattr(marker_smoothing, "_S", SmoothingSettings(known_m=0.0))
    nowhere = errors()
    assert going_on["mpjpe_mm"] < 0.9 * nowhere["mpjpe_mm"]
    assert going_on["jitter_ratio"] < 0.9 * nowhere["jitter_ratio"]
    assert going_on["deg_per_joint"] < nowhere["deg_per_joint"]


def changes_deg(rotations):
    """Turns (F - 1, J - 1) of the joints but the root between two frames."""
    return np.degrees(rot.angle_between(rotations[:-1, 1:], rotations[1:, 1:]))
