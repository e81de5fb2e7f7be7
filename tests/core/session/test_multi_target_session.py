"""A performer with a prop in the hand: each keeps what is its own."""

import numpy as np
import pytest
from perfanim.core.body.pose_notes import PoseNote
from perfanim.core.errors import PropError
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.prop import load_prop
from perfanim.core.session.multi_target_session import MultiTargetSession
from perfanim.core.session.session import Session
from props import Film, held_poses, markers_of

MARKER_M = 0.02  # labels that are right are nearer than this: five times what the blobs' noise makes of a point


@pytest.mark.parametrize("images", [True, False])
def test_performer_and_prop_keep_their_own_markers(subject, database, record, truth, true_markers, images):
    """The hand that holds the sword is hidden half of the time: its marker must not become the sword's hilt."""
    sword = load_prop("sword")
    turns, places = held_poses(sword, truth)
    points = np.concatenate((true_markers, markers_of(sword, turns, places)), axis=1)
    film, hand = Film(record), subject.marker_set.names.index("RHAN")
    ensemble = MultiTargetSession([Session(subject, database, film.rig if images else None)], [sword])
    for number, row in enumerate(points[:45]):
        is_hidden = number > 15 and number // 10 % 2 == 1
        pose = ensemble.step(film(row, number, ((hand, -1),) if is_hidden else (), images=images))
        (carried,) = pose.props
        assert carried.seen == 5
        assert np.linalg.norm(carried.position_m - places[number]) < MARKER_M
        assert np.degrees(rot.angle_between(carried.rotation, turns[number])) < 5.0
        (body,) = pose.performers
        seen = np.isfinite(body.observed_m[:, 0])
        assert np.linalg.norm(body.observed_m - true_markers[number], axis=1)[seen].max() < MARKER_M
        assert number < 15 or seen.sum() == 8 - is_hidden
    assert PoseNote.hidden(["sword"]) not in pose.notes


def test_hidden_prop_is_noted(subject, database, record, true_markers):
    ensemble = MultiTargetSession([Session(subject, database)], [load_prop("sword")])
    pose = ensemble.step(record(true_markers[0]))
    assert [note for note in pose.notes if not note.is_decision] == [PoseNote.hidden(["sword"])]
    assert not pose.props[0].found
    assert ensemble.subjects == (subject,)


def test_pose_without_props_equals_that_of_a_single_session(subject, database, record, true_markers):
    alone, session = Session(subject, database), MultiTargetSession([Session(subject, database)])
    for number in range(3):
        pose, frame = session.step(record(true_markers[number], number)), record(true_markers[number], number)
        expected = alone.step(frame)
        np.testing.assert_array_equal(pose.performers[0].rotations, expected.rotations)
        assert (len(pose.performers), pose.props, pose.notes) == (1, (), expected.notes)
    with pytest.raises(PropError, match="same name"):
        MultiTargetSession([alone], [load_prop("sword")] * 2)
