"""Performers side by side before the same cameras: each is followed as if alone."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.errors import SettingsError
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.prop import load_prop
from perfanim.core.markers.subject import Subject
from perfanim.core.session.multi_target_session import MultiTargetSession
from perfanim.core.session.session import Session
from performers import APART_M, side_by_side
from props import Film, held_poses, markers_of

LABEL_M = 0.03  # labels that are right are nearer than this: five times what the blobs' noise makes of a point
FRAMES = 20


@pytest.fixture(scope="module")
def pair(true_markers):
    return side_by_side(true_markers)


def ensemble_of(subjects, database, rig, props=()):
    return MultiTargetSession([Session(subject, database, rig) for subject in subjects], props)


def everybody(pose):
    return pose.performers


def count_wrong(pose, truth):
    """How many markers of each performer are labelled, and how many of these wrongly."""
    return [
        (int(seen.sum()), int(np.sum(np.linalg.norm(one.observed_m - true, axis=1)[seen] > LABEL_M)))
        for one, true in zip(everybody(pose), truth, strict=True)
        for seen in [np.isfinite(one.observed_m[:, 0])]
    ]


@pytest.mark.parametrize("images", [True, False])
def test_performers_keep_their_own_markers(subject, database, record, pair, images):
    """Two markers are hidden in every frame."""
    film = Film(record)
    ensemble = ensemble_of([subject, subject], database, film.rig if images else None)
    generator = np.random.default_rng(3)
    located = 0
    for number in range(FRAMES):
        points = np.concatenate([markers[number] for markers in pair])
        hidden = tuple((int(row), -1) for row in generator.choice(16, 2)) if number > 5 else ()
        frame = film(points, number, hidden, images=images)
        pose = ensemble.step(frame)
        counts = count_wrong(pose, [markers[number] for markers in pair])
        assert [wrong for _, wrong in counts] == [0, 0], number
        located += sum(seen for seen, _ in counts)
        assert [one.marker_rms_m < LABEL_M for one in everybody(pose)] == [True, True], number
    assert located > 0.9 * (16 - 2) * FRAMES
    assert {one.number for one in pose.performers} == {pose.number}
    assert pose.props == ()


def test_first_performer_stands_on_the_left(subject, database, record, pair):
    ensemble = ensemble_of([subject, subject], database, None)
    right_first = np.concatenate((pair[1][0], pair[0][0]))
    pose = ensemble.step(record(right_first))
    left, right = pose.performers
    assert left.root_position_m[0] < right.root_position_m[0] - 0.5 * APART_M


def test_marker_positions_identify_performers(truth, database, record, true_markers, subject):
    """The boxer is listed first and stands on the right."""
    boxer = Subject("boxer", truth.skeleton, load_marker_set("boxing"))
    place_m = truth.root_positions_m + np.array([0.5 * APART_M, 0.0, 0.0])
    markers = boxer.marker_set.positions_on(truth.skeleton, truth.rotations, place_m)
    walker = true_markers - np.array([0.5 * APART_M, 0.0, 0.0])
    ensemble = ensemble_of([boxer, subject], database, None)
    for number in range(5):  # for a second, as somebody else might still come
        frame = record(np.concatenate((walker[0], markers[0])), number)
        pose = ensemble.step(replace(frame, time_s=0.25 * number))
    assert [one.confidence > 0.5 for one in everybody(pose)] == [True, True]
    right, left = pose.performers
    assert right.root_position_m[0] > left.root_position_m[0] + 0.5 * APART_M


def test_performer_who_comes_later_is_found(subject, database, record, pair):
    """Until then the first goes on alone, and keeps what is his when the other is beside him."""
    film = Film(record)
    ensemble = ensemble_of([subject, subject], database, film.rig)
    for number in range(36):
        points = np.concatenate([markers[number] for markers in pair])
        late = tuple((row, -1) for row in range(8, 16)) if number < 30 else ()
        pose = ensemble.step(replace(film(points, number, late), time_s=number / 15.0))
        counts = count_wrong(pose, [markers[number] for markers in pair])
        assert number < 17 or pose.performers[0].confidence > 0.0, number  # a second and a tenth have passed
        assert number >= 15 or pose.performers[0].confidence == 0.0, number
        assert (pose.performers[1].confidence > 0.0) == (number >= 30), number
        assert number < 19 or counts[0] == (8, 0), number
        assert number < 32 or counts[1] == (8, 0), number
        told = [note.text for note in pose.notes]
        assert (f"{subject.name}: waiting for the markers of the torso" in told) == (number < 30)


def test_a_hidden_marker_is_not_taken_from_the_other(subject, database, record, true_markers):
    """They stand so near that one's left hand is beside the other's right one, which is hidden for a while."""
    left, right = side_by_side(true_markers, 0.75)
    names = subject.marker_set.names
    hand = names.index("LHAN"), names.index("RHAN")
    film = Film(record)
    ensemble = ensemble_of([subject, subject], database, film.rig)
    nearest = np.inf
    for number in range(FRAMES):
        is_hidden = number > 8 and number // 8 % 2 == 1
        points = np.concatenate((left[number], right[number]))
        pose = ensemble.step(film(points, number, ((hand[0], -1),) if is_hidden else ()))
        assert [wrong for _, wrong in count_wrong(pose, (left[number], right[number]))] == [0, 0], number
        assert np.isnan(pose.performers[0].observed_m[hand[0], 0]) or not is_hidden
        nearest = min(nearest, float(np.linalg.norm(left[number, hand[0]] - right[number, hand[1]])))
    assert nearest < 0.3  # they do come near


def test_props_and_performers_together(subject, database, record, truth, pair):
    sword = load_prop("sword")
    turns, places = held_poses(sword, truth)
    aside = np.array([0.5 * APART_M, 0.0, 0.0])
    film = Film(record)
    ensemble = ensemble_of([subject, subject], database, film.rig, [sword])
    for number in range(FRAMES):
        blade = markers_of(sword, turns[number : number + 1], places[number : number + 1] - aside)[0]
        pose = ensemble.step(film(np.concatenate((pair[0][number], pair[1][number], blade)), number))
        assert [wrong for _, wrong in count_wrong(pose, [markers[number] for markers in pair])] == [0, 0], number
        assert pose.props[0].seen == 5
    assert [one.confidence > 0.5 for one in everybody(pose)] == [True, True]


def test_source_labels_belong_to_the_first_performer(subject, database, record, true_markers):
    ensemble = ensemble_of([subject, subject], database, None)
    pose = ensemble.step(record(true_markers[0], labels=np.arange(8)))
    assert np.isfinite(pose.performers[0].observed_m).all()
    assert pose.performers[1].confidence == 0.0


def test_one_camera_with_two_performers_is_refused(subject, database, stage_rig):
    with pytest.raises(SettingsError, match="use two cameras"):
        ensemble_of([subject, subject], database, CameraRig(stage_rig.cameras[:1]))
