"""Recorded takes of a person without markers: solved again from the points in the pictures."""

from dataclasses import replace

import numpy as np
import pytest
from filmed_people import OTHERS, POINTS, keypoints, moments, networks
from perfanim.core.api.solving import RecordingChanges, SolveRequest, solve_recording
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.database.store import identity
from perfanim.core.errors import TakeError
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.formats.take_file.take_setup import TakeSetup
from perfanim.core.formats.take_file.take_writer import record_frames
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.markers.subject import Subject
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.vision.people.people_pipeline import PeoplePipeline

COUNT, EXCHANGED = 30, 4
LEGS = [i for i, marker in enumerate(POINTS.markers) if marker.joint[1:] in ("femur", "tibia", "foot", "toes")]
RIG = default_rig()


@pytest.fixture(scope="module")
def take(truth, database, tmp_path_factory):
    """A capture that began while both cameras exchanged the legs, which no past could tell."""
    points_m = keypoints(truth)[:COUNT]
    nets = networks(RIG, points_m, 2.0)
    for n in range(EXCHANGED):
        for c in range(2):
            nets[c].pixels[10 * n + c][LEGS] = nets[c].pixels[10 * n + c][OTHERS[LEGS]]
    pipeline = PeoplePipeline(RIG, nets)
    subject = Subject("Anna", truth.skeleton, POINTS)
    setup = TakeSetup.of(RIG, (subject,), {}, identity(database), {"people": "network"})
    path = tmp_path_factory.mktemp("people") / "walk.perftake"
    written = record_frames(path, setup, map(pipeline.process, moments(RIG, COUNT)), keep_cut=False)
    return read_take_file(written)


def legs_apart_m(solved, truth):
    """Return how far (F,) knees and ankles are from the true ones."""
    motion = solved.motion
    names = [side + joint for side in "lr" for joint in ("tibia", "foot")]
    placed = [
        forward_kinematics(each.skeleton, each.rotations[:COUNT], each.root_positions_m[:COUNT])[0]
        for each in (motion, truth)
    ]
    at = [motion.skeleton.index(name) for name in names]
    return np.linalg.norm(placed[0][:, at] - placed[1][:, at], axis=-1).mean(axis=1)


def test_later_frames_tell_left_from_right(take, truth, database):
    live = legs_apart_m(solve_recording(take, SolveRequest(causal=True), database=database), truth)
    again = legs_apart_m(solve_recording(take, database=database), truth)
    assert live[:EXCHANGED].min() > 0.1
    assert again.max() < 0.06


def test_another_calibration_moves_the_person(take, truth, database):
    shifted = CameraRig(
        tuple(replace(c, translation_m=c.translation_m - c.rotation @ np.array((0.5, 0.0, 0.0))) for c in RIG.cameras)
    )
    here, there = (
        solve_recording(take, changes=changes, database=database).motion.root_positions_m
        for changes in (RecordingChanges(), RecordingChanges(rig=shifted))
    )
    np.testing.assert_allclose(there - here, np.broadcast_to((0.5, 0.0, 0.0), here.shape), atol=0.01)


def test_a_calibration_of_three_cameras_is_refused(take, database):
    with pytest.raises(TakeError, match="was recorded by 2 cameras, but the calibration has 3"):
        solve_recording(take, changes=RecordingChanges(rig=default_rig(3)), database=database)
