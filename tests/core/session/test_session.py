"""A session fed with what cameras and takes would give of a clip that is not in the database."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.calibration_poses import standing, t_pose
from perfanim.core.body.pose_notes import NoteKind, PoseNote, source_notes
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.session.session import Session
from perfanim.core.solver.settings import METHODS, SolveSettings
from scipy.interpolate import CubicSpline

FPS = 30.0
NOISE_M = 0.002
KNOWN = np.arange(8)


@pytest.fixture(scope="module")
def noisy(true_markers):
    return true_markers + np.random.default_rng(0).normal(scale=NOISE_M, size=true_markers.shape)


@pytest.fixture(scope="module")
def opening(subject, truth, true_markers):
    """Markers (F, M, 3) of the person who stands in the T pose for a third of a second and lowers the arms and goes."""
    skeleton = truth.skeleton
    start = t_pose(skeleton)
    start[0] = truth.rotations[0, 0]
    share = np.clip((np.arange(40) - 10) / 30.0, 0.0, 1.0)
    share = 3.0 * share**2 - 2.0 * share**3
    rotations = rot.slerp(np.broadcast_to(start, (40, 29, 4)), truth.rotations[0], np.tile(share[:, None], (1, 29)))
    moving = subject.marker_set.positions_on(skeleton, rotations, truth.root_positions_m[0])
    return np.concatenate((moving, true_markers))


def degrees(poses, truth, start=0):
    found = np.array([pose.rotations for pose in poses])
    return float(np.degrees(rot.angle_between(found, truth.rotations[start : start + len(poses)]))[:, 1:].mean())


def test_known_labels_are_solved(subject, database, record, noisy, truth):
    session = Session(subject, database)
    poses = [session.step(record(row, number, KNOWN)) for number, row in enumerate(noisy)]
    assert degrees(poses, truth) < 6.0
    for number, pose in enumerate(poses):
        assert (pose.number, pose.time_s) == (number, number / FPS)
        assert pose.marker_rms_m < 3.0 * np.sqrt(3.0) * NOISE_M
        assert pose.confidence > 0.7
        assert pose.notes == ()
        np.testing.assert_array_equal(pose.observed_m, noisy[number])
    assert np.linalg.norm(np.array([p.root_position_m for p in poses]) - truth.root_positions_m, axis=1).max() < 0.05


def test_hidden_marker_is_noted_and_lowers_confidence(subject, database, record, noisy):
    session, other = Session(subject, database), Session(subject, database)
    points = noisy.copy()
    points[10:, [4, 6]] = np.nan
    for number in range(25):
        pose = session.step(record(points[number], number, KNOWN))
        whole = other.step(record(noisy[number], number, KNOWN))
        if number == 10:
            assert pose.notes == (PoseNote.hidden(["left hand", "left foot"]),)
    assert pose.confidence < whole.confidence
    assert np.isfinite(pose.markers_m).all()
    np.testing.assert_array_equal(np.isnan(pose.observed_m[:, 0]), [0, 0, 0, 0, 1, 0, 1, 0])


def test_a_frozen_hand_is_left_out_and_its_arm_doubtful(subject, database, record, noisy):
    session, hand = Session(subject, database), subject.marker_set.names.index("LHAN")
    points = noisy[:40].copy()
    points[15:, hand] = points[15, hand]
    poses = [session.step(record(row, number, KNOWN)) for number, row in enumerate(points)]
    assert PoseNote.frozen(["left hand"]) in poses[30].notes
    assert not any("frozen" in note.text for pose in poses[:15] for note in pose.notes)
    assert "left arm" in poses[30].doubtful_parts and "right arm" not in poses[30].doubtful_parts
    assert np.isnan(poses[30].observed_m[hand]).all()


def test_a_limb_without_markers_becomes_doubtful(subject, database, record, noisy):
    session, hand = Session(subject, database), subject.marker_set.names.index("LHAN")
    points = noisy[:50].copy()
    points[5:, hand] = np.nan
    poses = [session.step(record(row, number, KNOWN)) for number, row in enumerate(points)]
    assert "left arm" not in poses[10].doubtful_parts and "left arm" in poses[-1].doubtful_parts


def test_a_lying_walk_is_doubtful(subject, database, record, noisy):
    upright, lying = Session(subject, database), Session(subject, database)
    turned = noisy[..., [0, 2, 1]] * [1.0, 1.0, -1.0]  # z is up
    for number, (row, other) in enumerate(zip(noisy[:10], turned[:10], strict=True)):
        good, bad = upright.step(record(row, number, KNOWN)), lying.step(record(other, number, KNOWN))
    assert bad.marker_rms_m == pytest.approx(good.marker_rms_m, abs=1e-3)  # only the direction of up is wrong
    assert not good.doubtful
    assert bad.doubtful


@pytest.mark.parametrize("fps", [60.0, 240.0])
def test_markers_worn_elsewhere_do_not_jump(subject, database, record, true_markers, fps):
    """The body carries a marker from where it was seen, not from where its set puts it; most so in short steps."""
    seconds = np.arange(0.0, 0.5, 1.0 / fps)
    rows = CubicSpline(np.arange(len(true_markers)) / 30.0, true_markers)(seconds)
    rows += 0.03 * np.random.default_rng(4).normal(size=rows[0].shape)
    session = Session(subject, database)
    poses = [session.step(record(row, number, KNOWN, fps=fps)) for number, row in enumerate(rows)]
    assert not [note for pose in poses for note in pose.notes if note.kind is NoteKind.JUMPED]


def test_source_notes_are_passed_on(subject, database, record, noisy):
    session = Session(subject, database)
    frame = replace(record(noisy[0], 0, KNOWN), notes=("right camera frozen",))
    assert session.step(frame).notes == source_notes(["right camera frozen"])


def test_labelled_single_camera_marker_is_used(subject, database, record, noisy, stage_rig):
    """Rays count with the rig; without it the marker is hidden."""
    sessions = [Session(subject, database, rig) for rig in (None, stage_rig)]
    for number, row in enumerate(noisy[:12]):
        frame = record(row, number, KNOWN, hidden=((4, 1),) if number else ())
        poses = [session.step(frame) for session in sessions]
    blind, seeing = poses
    assert (seeing.single_cameras[4], blind.single_cameras[4]) == (0, -1)
    assert np.isnan(seeing.observed_m[4]).all()
    away_m = [np.linalg.norm(pose.markers_m[4] - noisy[11][4]) for pose in poses]
    assert away_m[1] < 0.5 * away_m[0]
    view = stage_rig.cameras[0]
    # 3 px at 4 m and 620 px focal length are 2 cm
    assert np.linalg.norm(view.project(seeing.markers_m[4]) - view.project(noisy[11][4])) < 3.0


def shuffled(points, seed):
    """The points in another order with a ghost, and which marker each is."""
    rng = np.random.default_rng(seed)
    ghost = points.mean(axis=0) + rng.uniform(0.8, 1.5, 3) * rng.choice([-1.0, 1.0], 3)
    order = rng.permutation(len(points) + 1)
    return np.concatenate((points, ghost[None]))[order], np.append(np.arange(len(points)), -1)[order]


def assert_labelled(pose, row, tolerance_m=1e-9):
    seen = np.isfinite(pose.observed_m[:, 0])
    np.testing.assert_allclose(pose.observed_m[seen], row[seen], atol=tolerance_m)
    assert seen.sum() >= 7


@pytest.mark.parametrize("turn_deg", [0.0, 35.0])
def test_unlabelled_points_are_labelled_and_tracked(subject, database, record, opening, turn_deg):
    """Only points, in another order every frame, with a ghost among them, from the T pose into walking."""
    session = Session(subject, database)
    turn = rot.from_rotation_vector([0.0, np.radians(turn_deg), 0.0])
    for number, row in enumerate(rot.rotate(turn, opening)):
        points, _ = shuffled(row, number)
        pose = session.step(record(points, number))
        assert_labelled(pose, row)
        assert pose.confidence > 0.0


def test_blobs_are_enough(subject, database, record, opening, stage_rig):
    """Blobs in two distorted images, unlabelled, a hand hidden from the right camera during half a second."""
    session = Session(subject, database, stage_rig)
    alone = []
    for number, row in enumerate(opening[:70]):
        hidden = ((4, 1),) if 45 <= number < 60 else ()
        pose = session.step(record(row, number, hidden=hidden, cameras=True))
        assert_labelled(pose, row, 1e-3)  # float32 pixels
        alone.append(pose.single_cameras[4])
    np.testing.assert_array_equal(alone, np.where((np.arange(70) >= 45) & (np.arange(70) < 60), 0, -1))


def test_t_pose_is_shown_until_the_torso_is_seen(subject, database, record, opening):
    session = Session(subject, database)
    few = opening[0].copy()
    few[[0, 1, 2, 6]] = np.nan
    pose = session.step(record(few, 0))
    assert pose.confidence == 0.0
    assert pose.notes == (PoseNote.of(NoteKind.WAITING),)
    np.testing.assert_array_equal(pose.rotations, t_pose(subject.skeleton))
    assert pose.markers_m[:, 1].min() == pytest.approx(0.0)  # it stands on the floor
    assert np.isnan(pose.marker_rms_m)
    pose = session.step(MarkerFrame(1, 1 / FPS))
    assert pose.confidence == 0.0
    undelayed = Session(subject, database)
    for number in range(2, 6):
        pose, as_if_never = (each.step(record(opening[number], number)) for each in (session, undelayed))
    assert_labelled(pose, opening[5])
    assert 0.0 < as_if_never.confidence == pytest.approx(pose.confidence)


def test_short_loss_keeps_the_last_pose_with_low_confidence(subject, database, record, noisy):
    session = Session(subject, database)
    for number in range(5):
        before = session.step(record(noisy[number], number, KNOWN))
    pose = session.step(MarkerFrame(5, 5 / FPS))
    assert pose.confidence == 0.0
    assert np.isfinite(pose.rotations).all()
    assert np.linalg.norm(pose.root_position_m - before.root_position_m) < 0.1
    after = session.step(record(noisy[6], 6, KNOWN))
    assert after.confidence > 0.7


def test_labelling_restarts_after_a_long_loss(subject, database, record, opening):
    """The performer leaves for two seconds and stands in the T pose elsewhere, turned: still found."""
    session = Session(subject, database)
    for number in range(5):
        session.step(record(opening[number], number))
    for number in range(5, 65):
        pose = session.step(MarkerFrame(number, number / FPS))
    assert pose.confidence == 0.0
    turn, shift = rot.from_rotation_vector([0.0, 0.5, 0.0]), np.array([1.5, 0.0, -1.0])
    elsewhere = rot.rotate(turn, opening) + shift
    for number in range(65, 75):
        points, _ = shuffled(elsewhere[0], number)
        pose = session.step(record(points, number))
    assert_labelled(pose, elsewhere[0])
    assert pose.confidence > 0.1


def test_wrong_labels_do_not_last(subject, database, record, opening):
    """Left and right mixed up by the source of the first half second: seen by the error, and labelled afresh."""
    session = Session(subject, database)
    swapped = np.array([7, 1, 2, 5, 4, 3, 6, 0])
    for number in range(25):
        pose = session.step(record(opening[0], number, swapped))
    assert pose.marker_rms_m > 0.1
    assert pose.confidence < 0.05
    for number in range(25, 60):  # a second without the torso
        pose = session.step(record(opening[0], number))
    assert_labelled(pose, opening[0])
    assert pose.marker_rms_m < 0.05


def test_reset_is_a_new_session(subject, database, record, noisy):
    session = Session(subject, database)
    first = [session.step(record(row, number, KNOWN)) for number, row in enumerate(noisy[:4])]
    session.step(record(noisy[50], 4, KNOWN))
    session.reset()
    again = [session.step(record(row, number, KNOWN)) for number, row in enumerate(noisy[:4])]
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a.rotations, b.rotations)


def test_motion_unlike_the_database_is_noted(subject, database, record, true_markers):
    """Both hands a metre above the head, which no walker, runner, jumper or boxer does."""
    points = true_markers[0].copy()
    points[[4, 5]] = points[[0, 1]] + np.array([0.0, 0.7, 0.0])
    points[[6, 7]] += np.array([[0.5, 0.6, 0.3], [-0.5, 0.6, 0.3]])
    pose = Session(subject, database).step(record(points, 0, KNOWN))
    assert PoseNote.of(NoteKind.UNFAMILIAR) in pose.notes
    assert pose.confidence < 0.3


@pytest.mark.parametrize("name", ["locomotion", "boxing", "kendo", "one-camera"])
def test_every_shipped_marker_set_is_solved_by_every_method(truth, database, record, name):
    """Markers, the sword's too, come near where they were seen; fitted to them, poses are better than a mean pose."""
    subject = Subject("b", truth.skeleton, load_marker_set(name))
    markers = subject.marker_set.positions_on(truth.skeleton, truth.rotations, truth.root_positions_m)
    guessed = rot.angle_between(database.mean_rotations, truth.rotations[:3])[:, 1:]
    for method in METHODS:
        session = Session(subject, database, settings=SolveSettings(method=method))
        frames = [record(markers[number], number, np.arange(len(subject.marker_set))) for number in range(3)]
        poses = [session.step(frame) for frame in frames]
        if method in ("best", "local-pca"):
            assert degrees(poses, truth) < np.degrees(guessed.mean())
        for pose, row in zip(poses, markers, strict=False):
            assert np.linalg.norm(pose.markers_m - row, axis=1).max() < 0.15
            assert pose.confidence > 0.0


@pytest.mark.parametrize("hidden", [(), (2,), (5, 7)])
def test_start_with_hanging_arms_and_hidden_markers_is_labelled(subject, database, hidden):
    """The T pose explains as many points there, but worse; what it made of them must not linger."""
    skeleton = subject.skeleton
    markers = subject.marker_set.positions_on(skeleton, standing(skeleton), (0.3, 0.9, 0.2))
    generator = np.random.default_rng(0)
    session = Session(subject, database)
    for number in range(10):
        kept = [m for m in generator.permutation(len(markers)) if number > 0 or m not in hidden]
        points = markers[kept] + generator.normal(scale=NOISE_M, size=(len(kept), 3))
        covariances = np.tile(NOISE_M**2 * np.eye(3), (len(kept), 1, 1))
        pose = session.step(MarkerFrame(number, number / FPS, points, covariances))
        found = np.all(np.isfinite(pose.observed_m), axis=1)
        assert set(np.flatnonzero(~found)) == (set(hidden) if number == 0 else set())
        assert np.linalg.norm(pose.observed_m - markers, axis=1)[found].max() < 5.0 * np.sqrt(3.0) * NOISE_M


def test_markers_do_not_jump_after_lost_frames(subject, database, record, true_markers):
    session = Session(subject, database)
    shown = [number for number in range(len(true_markers)) if not 20 <= number < 35]
    poses = [session.step(record(true_markers[number], number, KNOWN)) for number in shown]
    assert not [note for pose in poses for note in pose.notes if note.kind is NoteKind.JUMPED]
