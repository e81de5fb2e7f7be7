from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.motion import sliced
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import SubjectError, TakeError
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.session.solve_take import solve_take
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.subjects.from_motion import frames_of, subject_from_motion

LEGS = ("lfemur", "ltibia", "rfemur", "rtibia")


def explained(take, subject, database):
    """Share of the take's frames that the subject's body explains, as the fit asks of frames to learn from."""
    poses = solve_take(take, subject, database, SolveSettings(), lambda fraction, text: None).poses_of()
    away = [np.nanmedian(np.linalg.norm(pose.markers_m - pose.observed_m, axis=1)) for pose in poses]
    return np.mean([distance_m < 0.06 for distance_m in away])


def bones(skeleton, names=LEGS):
    return np.array([np.linalg.norm(skeleton.tips_m[skeleton.index(name)]) for name in names])


@pytest.fixture(scope="module")
def worn():
    """The marker set as it was really put on: every marker up to 15 mm off its usual place."""
    usual = load_marker_set("two-webcams")
    off = np.random.default_rng(3).uniform(-0.015, 0.015, (len(usual), 3))
    return usual.with_offsets(usual.offsets_m + off)


@pytest.fixture(scope="module")
def take(embedded_motion, worn):
    return simulate_markers(sliced(embedded_motion["walking-02-energetic"], 0, 90), worn, noise_mm=2.0, seed=5)[0]


@pytest.fixture(scope="module")
def wrong_start():
    """A first guess far from the person."""
    return Subject("walker", default_skeleton(1.9), load_marker_set("two-webcams"))


@pytest.mark.long
def test_body_and_offsets_come_closer_to_the_truth(embedded_motion, take, worn, wrong_start, database):
    truth = embedded_motion["walking-02-energetic"].skeleton
    fit = subject_from_motion(take, wrong_start, database)
    before, after = (np.abs(bones(skeleton) - bones(truth)) for skeleton in (wrong_start.skeleton, fit.skeleton))
    assert before.mean() > 0.02  # the test would show nothing otherwise
    assert after.mean() < 0.5 * before.mean()
    sides = bones(fit.skeleton).reshape(2, 2)
    np.testing.assert_allclose(sides[0], sides[1], rtol=0.05)  # both legs alike
    assert fit.residual_m < 0.01
    off = np.linalg.norm(fit.marker_set.offsets_m - worn.offsets_m, axis=1)
    assert np.median(off) < 0.025
    assert explained(frames_of(take, slice(0, 50)), fit, database) > 0.8
    assert fit.marker_set.names == take.names


@pytest.mark.long
def test_frames_are_chosen_over_the_whole_take_and_hidden_markers_left_out(take, wrong_start, database):
    short = frames_of(take, slice(0, 40))
    gaps = short.positions_m.copy()
    gaps[:20, take.names.index("R.E")] = np.nan
    short = replace(short, positions_m=gaps)
    empty = np.full((305, *take.positions_m.shape[1:]), np.nan)
    late = replace(
        short,
        positions_m=np.concatenate((empty, short.positions_m)),
        frame_numbers=np.arange(345),
        times_s=np.arange(345) / take.fps,
    )
    fit = subject_from_motion(late, wrong_start, database)
    assert fit.residual_m < 0.01
    alone = subject_from_motion(short, wrong_start, database)
    np.testing.assert_allclose(bones(fit.skeleton), bones(alone.skeleton), atol=1e-3)


@pytest.mark.long
def test_markers_on_wands_are_found_where_they_are(embedded_motion, database):
    """Clinical suits have some a hand's breadth and more beside thigh and shank, where no usual place is."""
    suit = load_marker_set("plug-in-gait")
    hips, limbs = ("LASI", "RASI", "LPSI", "RPSI"), ("THI", "KNE", "TIB", "ANK", "HEE", "TOE")
    suit = suit.subset((*hips, *(side + name for side in "LR" for name in limbs)))
    offsets = suit.offsets_m.copy()
    wands = [suit.names.index(name) for name in ("LTHI", "LTIB", "RTHI", "RTIB")]
    offsets[wands] += [[0.15, 0.0, 0.0], [0.15, 0.0, 0.0], [-0.15, 0.0, 0.0], [-0.15, 0.0, 0.0]]
    motion = sliced(embedded_motion["walking-02-energetic"], 0, 60)
    take = simulate_markers(motion, suit.with_offsets(offsets), noise_mm=2.0, seed=5)[0]
    fit = subject_from_motion(take, Subject("walker", motion.skeleton, suit), database)
    assert explained(take, fit, database) > 0.8
    assert fit.residual_m < 0.01
    off = np.linalg.norm(fit.marker_set.offsets_m - offsets, axis=1)
    assert np.max(off[wands]) < 0.5 * 0.15  # drawn to the usual place, but less than halfway


def test_takes_that_show_no_body_are_refused(take, wrong_start, database):
    with pytest.raises(SubjectError, match="only 5 of 5 frames show 3 torso markers"):
        subject_from_motion(frames_of(take, slice(0, 5)), wrong_start, database)
    unseen = replace(take, positions_m=np.full_like(take.positions_m, np.nan))
    with pytest.raises(SubjectError, match=r"only 0 of \d+ frames show 3 torso markers, but at least 20 are"):
        subject_from_motion(unseen, wrong_start, database)
    with pytest.raises(TakeError, match="torso markers"):
        subject_from_motion(replace(take, names=tuple(f"X{i}" for i in range(len(take.names)))), wrong_start, database)
