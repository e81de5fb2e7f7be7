from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.motion import sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.errors import TakeError
from perfanim.core.markers.marker_take import MarkerTake, SingleViews
from perfanim.core.markers.subject import Subject
from perfanim.core.session.capture_setup import CaptureSetup
from perfanim.core.session.solve_take import solve_take
from perfanim.core.session.solved_take import SolvedTake
from perfanim.core.session.steady_motion import pose_clock, steady_motion
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings

from tests.helpers.irregular_takes import SKELETON, SUIT, random_series, scene_poses


@pytest.fixture(scope="module")
def take(truth, subject):
    return simulate_markers(truth, subject, noise_mm=2.0, dropout=0.05, seed=1)[0]


def test_a_take_becomes_motion_of_the_subject(take, subject, database, truth):
    told = []
    solved = solve_take(take, subject, database, SolveSettings(), lambda fraction, text: told.append((fraction, text)))
    motion = solved.motion
    assert (motion.name, motion.fps, motion.frames) == (take.name, take.fps, take.frames)
    assert motion.skeleton is subject.skeleton
    assert len(solved.poses) == len(solved.seconds) == take.frames
    report = evaluate(motion, truth)
    assert report["deg_per_joint"] < 7.0
    assert report["root_position_mm"] < 30.0
    assert told[0] == (0.0, f"solving {take.name}")
    assert [fraction for fraction, _ in told] == sorted(fraction for fraction, _ in told)


def test_summary(take, subject, database):
    solved = solve_take(take, subject, database, SolveSettings(method="lwr"), lambda fraction, text: None)
    summary = solved.summary()
    squares = [pose.marker_rms_m**2 for pose in solved.poses_of() if np.isfinite(pose.marker_rms_m)]
    assert summary["frames"] == take.frames
    assert summary["marker_rms_mm"] == pytest.approx(1e3 * np.sqrt(np.mean(squares)))
    assert 0.0 < summary["confidence"] < 1.0
    assert 0.0 < summary["ms_per_frame_median"] <= summary["ms_per_frame_p99"]
    assert solved.joint_errors_deg() == {}  # only "best" knows them


def test_take_with_empty_frames(take, subject, database):
    """Frames before the first marker wait in the T pose; a gap in the middle is bridged."""
    positions = take.positions_m[:20].copy()
    positions[:4] = np.nan
    positions[10:13] = np.nan
    gaps = MarkerTake("gaps", take.fps, take.names, positions)
    solved = solve_take(gaps, subject, database, SolveSettings(), lambda fraction, text: None)
    confidence = np.array([pose.confidence for pose in solved.poses_of()])
    np.testing.assert_array_equal(confidence[[0, 1, 2, 3, 10, 11, 12]], 0.0)
    assert np.all(confidence[4:10] > 0.3)
    assert np.isfinite(solved.motion.rotations).all()
    nothing = MarkerTake("nothing", take.fps, take.names, np.full((3, 8, 3), np.nan))
    summary = solve_take(nothing, subject, database, SolveSettings(), lambda fraction, text: None).summary()
    assert np.isnan(summary["marker_rms_mm"])
    assert summary["confidence"] == 0.0


def test_single_camera_markers_are_used(truth, subject, database, stage_rig):
    """A hand that one camera alone shows is nearer to the truth across its ray than one that is hidden."""
    whole = simulate_markers(sliced(truth, 0, 35), subject, noise_mm=2.0, seed=1)[0]
    hand = whole.names.index("LHAN")
    camera = stage_rig.cameras[0]
    local = camera.to_camera(whole.positions_m)
    positions = whole.positions_m.copy()
    positions[10:, hand] = np.nan
    cameras = np.where(np.isnan(positions[..., 0]), 0, -1)
    points = np.where((cameras >= 0)[..., None], local[..., :2] / local[..., 2:], np.nan)
    hidden = replace(whole, positions_m=positions)
    errors = []
    for take in (hidden, replace(hidden, single=SingleViews(stage_rig, cameras, points))):
        solved = solve_take(take, subject, database, SolveSettings(), lambda fraction, text: None)
        markers = np.array([camera.to_camera(pose.markers_m[hand]) for pose in solved.poses_of()])[10:]
        wanted = local[10:, hand, :2] / local[10:, hand, 2:]
        errors.append(np.median(np.linalg.norm(markers[:, :2] - wanted * markers[:, 2:], axis=1)))
    assert errors[1] < 0.5 * errors[0]


def test_wrong_marker_set_is_refused(take, subject, database):
    other = MarkerTake("other", 30.0, ("C7", "LSHO", "RSHO"), np.zeros((2, 3, 3)))
    with pytest.raises(TakeError, match="other: has fewer than three of the torso markers LSHO, RSHO, LWAI, RWAI"):
        solve_take(other, subject, database, SolveSettings(), lambda fraction, text: None)


@pytest.mark.parametrize("kept", [np.r_[0:15, 30:60], np.flatnonzero(np.random.default_rng(2).random(60) < 0.6)])
@pytest.mark.parametrize("causal", [True, False])
def test_motion_lasts_as_long_as_its_take(truth, subject, database, kept, causal):
    """Frames numbered without gaps, with times that have some."""
    whole = simulate_markers(sliced(truth, 0, 60), subject)[0]
    times_s = 2.0 + kept / truth.fps
    take = replace(
        whole, positions_m=whole.positions_m[kept], frame_numbers=np.arange(len(kept)), times_s=np.round(times_s, 3)
    )
    solved = solve_take(take, subject, database, SolveSettings(), lambda *_: None, causal=causal)
    assert len(solved.poses) == len(kept)
    assert solved.motion.fps == truth.fps
    assert solved.motion.duration_s == pytest.approx(times_s[-1] - times_s[0])
    assert "frames are missing" in solved.clock.sentences[0]
    assert solved.motions_at(12.0)[0].duration_s == pytest.approx(times_s[-1] - times_s[0], abs=1.0 / 12.0)
    shown = sliced(truth, int(kept[0]), int(kept[-1]) + 1)
    assert evaluate(solved.motion, shown)["root_position_mm"] < 30.0


@pytest.mark.parametrize("rate_hz", [10.0, 25.0, 60.0])
def test_a_finished_motion_is_laid_out_once(rate_hz, database):
    series, waver = random_series(1), Subject("waver", SKELETON, SUIT)
    poses = scene_poses(series)
    clock = pose_clock(poses, "a")
    motion = steady_motion([pose.performers[0] for pose in poses], waver, "a", clock)
    setup = CaptureSetup(None, (waver,), (), database, SolveSettings())
    seconds, finished_at = np.zeros(len(poses)), []

    def finish(motion):
        finished_at.append(motion.fps)
        return motion

    plain = SolvedTake(tuple(poses), (motion,), seconds, seconds > 0.0, clock, setup=setup)
    (found,), (expected,) = (each.motions_at(rate_hz) for each in (replace(plain, finish=finish), plain))
    assert (found.fps, found.frames) == (expected.fps, expected.frames)
    np.testing.assert_allclose(found.root_positions_m, expected.root_positions_m, atol=1e-9)
    np.testing.assert_allclose(found.rotations, expected.rotations, atol=1e-9)
    assert finished_at[0] >= clock.fps
