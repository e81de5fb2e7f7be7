"""A session through changes of behaviour, losses of all markers and wrong labels, which it should survive."""

from dataclasses import replace

import numpy as np
import pytest
from motion_synthesis.performance import performance
from perfanim.core.body.calibration_poses import t_pose
from perfanim.core.body.motion import resampled
from perfanim.core.body.pose_notes import NoteKind
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.session.session import Session
from perfanim.core.simulate.studio.cones import visible
from perfanim.core.simulate.studio.filmed_motion import make_performance
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.system.assets import MOTION

FPS = 30.0
NOISE_M = 0.002
TOLERANCE_M = 5.0 * np.sqrt(3.0) * NOISE_M


def markers_of(subject, motion):
    """Markers (F, M, 3) of the subject who moves like that."""
    return subject.marker_set.positions_on(subject.skeleton, motion.rotations, motion.root_positions_m)


def points(record, row, number, generator, labels=None):
    """The frame of a row with noise, in another order each time, with a ghost."""
    ghost = np.nanmean(row, axis=0) + generator.choice([-1.0, 1.0], 3) * generator.uniform(0.8, 1.5, 3)
    noisy = row + generator.normal(scale=NOISE_M, size=row.shape)
    if labels is not None:
        return record(noisy, number, labels)
    return record(generator.permutation(np.concatenate((noisy, ghost[None]))), number)


def labelled_right(pose, row):
    seen = np.isfinite(pose.observed_m[:, 0])
    return bool(seen.all() and np.linalg.norm(pose.observed_m - row, axis=1).max() < TOLERANCE_M)


@pytest.mark.parametrize(("clip", "turn"), [("walking-02-energetic", 1.3), ("boxing-06-energetic", -0.5),
                                            ("running-05-proud", 1.0), ("jumping-05-tired", -0.9)])  # fmt: skip
def test_performer_who_returns_elsewhere_in_another_pose_is_found_at_once(
    subject, database, record, true_markers, clip, turn
):
    """Gone for two and a half seconds, back two metres off and turned, in the middle of a clip out of the database."""
    session, generator = Session(subject, database), np.random.default_rng(0)
    for number in range(5):
        session.step(points(record, true_markers[number], number, generator))
    for number in range(5, 80):
        pose = session.step(MarkerFrame(number, number / FPS))
    assert pose.confidence == 0.0
    rows = markers_of(subject, resampled(read_motion(MOTION / f"{clip}.bvh"), FPS))[40:60]
    rows = rot.rotate(rot.from_rotation_vector([0.0, turn, 0.0]), rows) + np.array([1.5, 0.0, -1.5])
    poses = [session.step(points(record, row, 80 + i, generator)) for i, row in enumerate(rows)]
    right = [labelled_right(pose, row) for pose, row in zip(poses, rows, strict=True)]
    found = next(pose for pose in poses if pose.confidence > 0.0)
    assert {NoteKind.TORSO_LOST, NoteKind.LABELLED} <= {note.kind for note in found.notes}
    assert all(right[3:])  # a lost marker is labelled again within three frames
    assert min(pose.confidence for pose in poses[3:]) > 0.1


def test_wrong_initial_labels_are_corrected(subject, database, record, true_markers):
    """Left and right mixed up by the source, which then gives no labels: the session goes on with what it believes."""
    session, generator = Session(subject, database), np.random.default_rng(1)
    swapped = np.array([1, 0, 3, 2, 5, 4, 7, 6])
    for number in range(4):
        session.step(points(record, true_markers[number], number, generator, swapped))
    right, kinds = [], set()
    for number in range(4, 34):
        pose = session.step(points(record, true_markers[number], number, generator))
        right.append(labelled_right(pose, true_markers[number]))
        kinds |= {note.kind for note in pose.notes}
    assert NoteKind.RELABELLED in kinds
    assert not right[0]
    assert all(right[15:])  # half a second


@pytest.mark.parametrize("swapped", [(0, 1), (2, 3), (4, 5), (6, 7)])
def test_one_wrong_pair_of_labels_is_corrected(subject, database, record, true_markers, swapped):
    order = np.arange(true_markers.shape[1])
    order[list(swapped)] = swapped[::-1]
    session, generator = Session(subject, database), np.random.default_rng(3)
    for number in range(3):
        session.step(points(record, true_markers[number], number, generator, order))
    poses = [session.step(points(record, true_markers[number], number, generator)) for number in range(3, 60)]
    right = [labelled_right(pose, row) for pose, row in zip(poses, true_markers[3:60], strict=True)]
    assert all(right[15:])  # half a second


@pytest.mark.long
def test_right_initial_labels_are_kept(subject, database_of, record, tmp_path):
    """In a database that is dense in such poses a new start is always nearer to some of them, with the same labels."""
    plan = [("rest", 3.0)]
    others = [performance(plan, FPS, subject.skeleton, seed=seed, name=f"rest-{seed}") for seed in range(1, 9)]
    dense = database_of(tmp_path / "rest.pfdb", others)
    rows = markers_of(subject, performance(plan, FPS, subject.skeleton, seed=100))[:120]  # until a second of rest
    for seed in range(3):
        session, generator = Session(subject, dense), np.random.default_rng(seed)
        poses = [session.step(points(record, row, i, generator)) for i, row in enumerate(rows)]
        assert all(labelled_right(pose, row) for pose, row in zip(poses, rows, strict=True))
        assert session.labellings == 1


@pytest.mark.long
def test_cut_between_behaviours_recovers(subject, database, record):
    """From walking into running in one take: the running is solved as if it had been alone."""
    motion = performance([("walking", 2.0), ("running", 2.0)], FPS, subject.skeleton, seed=1_000_007)
    walking, start = round(2.9 * FPS), round((2.9 + 2.0) * FPS)  # after T pose and arms down, and after walking
    rows, generator = markers_of(subject, motion), np.random.default_rng(2)
    frames = [points(record, row, number, generator) for number, row in enumerate(rows)]
    errors = []
    for first in (walking, start):
        session = Session(subject, database)
        poses = [session.step(frame) for frame in frames[first:]]
        assert all(labelled_right(pose, row) for pose, row in zip(poses, rows[first:], strict=True))
        found = np.array([pose.rotations for pose in poses[start - first :]])
        angles = rot.angle_between(found, motion.rotations[start:])
        errors.append(float(np.degrees(angles)[:, 1:].mean()))
    followed, alone = errors
    assert followed < 1.1 * alone


@pytest.mark.long
def test_performer_who_turns_away_and_back_is_tracked(subject, database, record):
    """The body hides its own markers from cameras in front; back in view all are known, and the root never was lost."""
    still = performance([("rest", 3.0)], FPS, subject.skeleton)
    share = np.clip((np.arange(still.frames) / FPS - 3.0) / 1.2, 0.0, 1.0)  # after the arms have come down
    share -= np.clip((np.arange(still.frames) / FPS - 4.5) / 1.2, 0.0, 1.0)
    vectors = np.outer(np.radians(100.0) * (3.0 * share**2 - 2.0 * share**3), (0.0, 1.0, 0.0))
    rotations = still.rotations.copy()
    rotations[:, 0] = rot.multiply(rot.from_rotation_vector(vectors), rotations[:, 0])
    motion = replace(still, rotations=rotations)
    marker_set = subject.marker_set
    joints = marker_set.joint_indices(motion.skeleton)
    shown = make_performance(motion, marker_set.names, joints, marker_set.offsets_m)
    rig = default_rig()
    session, film, generator = Session(subject, database, rig), replace(record, rig=rig), np.random.default_rng(4)
    lost, turned, right = [], [], []
    for number, row in enumerate(shown.markers_m):
        body = shown.cones_at(number / FPS)
        seen = [visible(camera.centre_m, row, body, 0.006) for camera in rig.cameras]
        hidden = tuple((marker, i) for i, each in enumerate(seen) for marker in np.flatnonzero(~each))
        noisy = row + generator.normal(scale=NOISE_M, size=row.shape)
        pose = session.step(film(noisy, number, hidden=hidden, cameras=True))
        lost.append(int(np.sum(~np.all(seen, axis=0))))
        turned.append(float(np.degrees(rot.angle_between(pose.rotations[0], motion.rotations[number, 0]))))
        right.append(labelled_right(pose, row))
    assert max(lost) >= 3
    assert max(turned) < 20.0
    assert all(right[-15:])


@pytest.mark.parametrize("blobs", [True, False])
def test_hand_that_returns_far_from_its_predicted_position_is_labelled_within_three_frames(
    subject, database, record, blobs
):
    """Both hands hidden while the arms are raised from the sides of the body into the T pose."""
    motion = performance([("rest", 3.0)], FPS, subject.skeleton)
    rows = markers_of(subject, motion)[::-1]
    hands = [index for index, name in enumerate(subject.marker_set.names) if name.endswith("HAN")]
    raised = rows[:, hands, 1].mean(axis=1)
    hidden = np.flatnonzero(raised > raised.min() + 0.02)
    back = int(np.flatnonzero(raised > raised.max() - 0.02)[0])
    session, generator = Session(subject, database, record.rig if blobs else None), np.random.default_rng(3)
    poses = []
    for number, row in enumerate(rows[: back + 3]):
        noisy = row + generator.normal(scale=NOISE_M, size=row.shape)
        if hidden[0] <= number < back:
            noisy[hands] = np.nan
        poses.append(session.step(record(noisy, number, cameras=blobs)))
    away = [np.linalg.norm(poses[i].markers_m[hands] - rows[i, hands], axis=1) for i in (back - 1, back + 2)]
    assert away[0].min() > 0.4
    assert labelled_right(poses[-1], rows[back + 2])
    assert away[1].max() < TOLERANCE_M


def test_body_bent_by_wrong_markers_recovers_at_once(subject, database, record, truth, true_markers):
    """For two thirds of a second the source exchanges hands and feet: what it shows is a body in knots."""
    right = np.arange(len(subject.marker_set))
    crossed = right.copy()
    hands_and_feet = [subject.marker_set.names.index(name) for name in ("LHAN", "RHAN", "RFOO", "LFOO")]
    crossed[hands_and_feet] = hands_and_feet[::-1]
    errors = []
    for wrong_until in (0, 20):
        session, generator = Session(subject, database), np.random.default_rng(5)
        for number, row in enumerate(true_markers[:40]):
            labels = crossed if number < wrong_until else right
            pose = session.step(points(record, row, number, generator, labels))
            errors.append(float(np.degrees(rot.angle_between(pose.rotations, truth.rotations[number])).mean()))
    undisturbed, wrung = np.reshape(errors, (2, -1))
    assert np.all(wrung[10:20] > 3.0 * undisturbed[10:20])
    assert wrung[25:].mean() < 1.5 * undisturbed[25:].mean()


@pytest.mark.parametrize("clip", ["boxing-06-energetic", "running-05-proud", "jumping-05-tired"])
def test_cut_from_a_t_pose_recovers(subject, database, record, clip):
    """Recordings begin in a T pose; the pose that follows is not near it."""
    motion = resampled(read_motion(MOTION / f"{clip}.bvh"), FPS)
    rows, labels = markers_of(subject, motion)[40:55], np.arange(len(subject.marker_set))
    t_rows = markers_of(subject, replace(motion, rotations=np.repeat(t_pose(subject.skeleton)[None], motion.frames, 0)))
    errors = []
    for before in (np.empty((0, *rows.shape[1:])), t_rows[25:40]):
        session = Session(subject, database)
        poses = [session.step(record(row, number, labels)) for number, row in enumerate((*before, *rows))]
        away = [
            rot.angle_between(pose.rotations, truth)[1:].mean()
            for pose, truth in zip(poses[len(before) :], motion.rotations[40:55], strict=True)
        ]
        errors.append(np.array(away))
    assert errors[1].mean() < 1.3 * errors[0].mean()
    assert errors[1].max() < 1.3 * errors[0].max()
