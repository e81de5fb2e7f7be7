"""Frames that no camera can have made, inserted at random: they change nothing after themselves."""

from cProfile import Profile
from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.pose_notes import NoteKind, PoseNote
from perfanim.core.body.scene_pose import ScenePose
from perfanim.core.labelling.initial_labelling import InitialLabeller
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.prop import load_prop
from perfanim.core.session.multi_target_session import MultiTargetSession
from perfanim.core.session.pose_filters import FilterSettings, PoseFilter
from perfanim.core.session.session import Session
from props import Film, held_poses, markers_of

FPS = 30.0
KNOWN = np.arange(8)
TAKES, FRAMES = 4, 25
POISONED = 0.2  # of the frames
NUMBERS = (np.nan, np.inf, -np.inf, 1e30, 1e160, 1e300)
WRONG_TIMES_S = (np.nan, np.inf, -np.inf, 1e18, -1e18, 3600.0, -3600.0, 0.0, -1 / FPS, -1.0)  # the last five: later


def mistimed(frame: MarkerFrame, last_s: float, generator: np.random.Generator) -> MarkerFrame:
    """The frame with a time that cannot be: by a wrong clock, repeated, or backward."""
    wrong_s = float(generator.choice(WRONG_TIMES_S))
    return replace(frame, time_s=last_s + wrong_s if abs(wrong_s) < 1e6 else wrong_s)


def spoiled(frame: MarkerFrame, generator: np.random.Generator) -> tuple[MarkerFrame, MarkerFrame]:
    """The frame with one impossible point or ray more or in place of another, and what is right in it."""
    row, value = int(generator.integers(len(frame.points_m))), float(generator.choice(NUMBERS))
    kept = np.arange(len(frame.points_m)) != row
    names = ("points_m", "covariances_m2", "labels", "point_blobs")
    right = replace(frame, **{name: getattr(frame, name)[kept] for name in names})
    bad = {name: np.array(getattr(frame, name)) for name in names}
    kind = generator.integers(4)
    if kind == 0:
        bad["points_m"][row, generator.integers(3)] = value
    elif kind == 1:
        bad["covariances_m2"][row] = generator.choice([value, -1e-6, 0.0])
    elif kind == 2:
        bad["labels"][row] = generator.choice([8, 1000, -5])
    else:
        rays = {"single_points": np.full((2, 2), value), "single_cameras": np.array([7, 0])}
        rays |= {"single_blobs": np.full(2, -1), "single_labels": np.array([3, 99])}
        return replace(frame, **rays), frame
    return replace(frame, **bad), right


def assert_same(pose, expected):
    np.testing.assert_array_equal(pose.rotations, expected.rotations)
    np.testing.assert_array_equal(pose.root_position_m, expected.root_position_m)
    np.testing.assert_array_equal(pose.observed_m, expected.observed_m)
    assert (pose.confidence, pose.time_s) == (expected.confidence, expected.time_s)


@pytest.fixture(scope="module", params=[KNOWN, None], ids=["labelled", "unlabelled"])
def clean(request, subject, database, record, true_markers):
    """Frames without faults, and the poses of a session that saw no others."""
    session = Session(subject, database)
    frames = [record(row, number, request.param) for number, row in enumerate(true_markers[:FRAMES])]
    return frames, [session.step(frame) for frame in frames]


@pytest.mark.parametrize("seed", range(TAKES))
def test_frames_with_impossible_times_have_no_effect(subject, database, clean, seed):
    generator = np.random.default_rng(seed)
    session = Session(subject, database)
    last = before = None
    for frame, expected in zip(*clean, strict=True):
        for _ in range(generator.binomial(2, POISONED) if last is not None else 0):  # three could agree
            pose = session.step(mistimed(frame if generator.random() < 0.5 else before, last.time_s, generator))
            np.testing.assert_array_equal(pose.rotations, last.rotations)
            assert (pose.confidence, pose.time_s, pose.notes) == (0.0, last.time_s, (PoseNote.of(NoteKind.REFUSED),))
        last, before = session.step(frame), frame
        assert_same(last, expected)


@pytest.mark.parametrize("labels", [KNOWN, None])
@pytest.mark.parametrize("seed", [0, *(pytest.param(each, marks=pytest.mark.long) for each in range(1, TAKES))])
def test_impossible_points_and_rays_have_no_effect(subject, database, record, true_markers, stage_rig, labels, seed):
    generator = np.random.default_rng(seed)
    session, clean = Session(subject, database, stage_rig), Session(subject, database, stage_rig)
    for number, row in enumerate(true_markers[:FRAMES]):
        frame = bad = record(row, number, labels)
        if generator.random() < POISONED:
            bad, frame = spoiled(frame, generator)
        pose = session.step(bad)
        assert_same(pose, clean.step(frame))
        assert any("impossible, left out" in note.text for note in pose.notes) == (bad is not frame)


def test_frame_with_only_impossible_markers_counts_as_empty(subject, database, record, true_markers):
    session, clean = Session(subject, database), Session(subject, database)
    for number, row in enumerate(true_markers[:20]):
        frame = bad = record(row, number, KNOWN)
        if number in (0, 9):
            frame, bad = MarkerFrame(number, number / FPS), record(np.full((8, 3), 1e30), number, KNOWN)
        assert_same(session.step(bad), clean.step(frame))


def test_session_restarts_after_an_hour(subject, database, record, true_markers):
    """No speed is taken over the gap, and wherever the performer is by now the markers are found."""
    session, fresh = Session(subject, database), Session(subject, database)
    for number in range(10):
        session.step(record(true_markers[number], number))
    poses = []
    for number in range(10, 40):
        frame = record(true_markers[number] + np.array([1.5, 0.0, -1.0]), number)
        poses.append(session.step(replace(frame, time_s=frame.time_s + 3600.0)))
        if number >= 12:  # the third that agrees
            assert_same(poses[-1], fresh.step(replace(frame, time_s=frame.time_s + 3600.0)))
    assert [pose.confidence for pose in poses[:2]] == [0.0, 0.0]


@pytest.mark.long
def test_performers_props_and_filters_ignore_impossible_frames(subject, database, record, truth, true_markers):
    sword = load_prop("sword")
    turns, places = held_poses(sword, truth)
    points = np.concatenate((true_markers, markers_of(sword, turns, places)), axis=1)
    points = np.concatenate((points, true_markers + np.array([2.0, 0.0, 0.0])), axis=1)
    film, generator = Film(record), np.random.default_rng(0)

    def chain():
        sessions = MultiTargetSession([Session(subject, database, film.rig) for _ in range(2)], [sword])
        return sessions, PoseFilter([subject] * 2, 0.0, FilterSettings(0.05, "auto"))

    (session, shaper), (clean, clean_shaper) = chain(), chain()
    refused, last = 0, None
    for number, row in enumerate(points[:30]):
        frame = film(row, number)
        if last is not None and generator.random() < POISONED:
            refused += 1
            shown = shaper.step(session.step(mistimed(frame, last.time_s, generator)))
            assert_bodies(shown, last, 0.0)
            assert not shown.props[0].found
        last = shaper.step(session.step(frame))
        expected = clean_shaper.step(clean.step(frame))
        assert_bodies(last, expected)
        np.testing.assert_array_equal(last.props[0].position_m, expected.props[0].position_m)
        assert last.props[0].found or number < 10
    assert refused > 3
    assert min(body.confidence for body in last.performers) > 0.3


def assert_bodies(scene: ScenePose, expected: ScenePose, confidence: float | None = None) -> None:
    for pose, other in zip(scene.performers, expected.performers, strict=True):
        np.testing.assert_array_equal(pose.rotations, other.rotations)
        assert pose.confidence == (other.confidence if confidence is None else confidence)


GHOSTS = 500
MOST_WORK = 7e6  # array elements that a search handles in a frame: its share, and the rest of its last piece
MOST_CALLS = 3  # times those without ghosts


def ghosts(number):
    return np.random.default_rng(number).uniform([-2.0, 0.0, -2.0], [2.0, 2.2, 2.0], (GHOSTS, 3))


def effort(session, frames, monkeypatch):
    """Return the array elements that searches handle, and the calls of functions, of each frame (F, 2)."""
    handled, rows = [], []

    def counted(self, points_m, search=InitialLabeller.search):
        pieces = search(self, points_m)
        while True:
            try:
                handled.append(next(pieces))
            except StopIteration as end:
                return end.value
            yield handled[-1]

    monkeypatch.setattr(InitialLabeller, "search", counted)
    for frame in frames:
        handled.clear()
        calls = Profile()
        calls.runcall(session.step, frame)
        rows.append((sum(handled), sum(function.callcount for function in calls.getstats())))
    monkeypatch.undo()
    return np.array(rows)


def test_search_work_per_frame_is_bounded_with_ghosts(subject, database, record, true_markers, monkeypatch):
    """With a body among the ghosts, and with ghosts alone."""
    rows, nobody = true_markers[:40], np.empty((40, 0, 3))
    usual = effort(Session(subject, database), map(record, rows, range(40)), monkeypatch)
    for bodies in (rows, nobody):
        frames = (record(np.concatenate((body, ghosts(number))), number) for number, body in enumerate(bodies))
        crowded = effort(Session(subject, database), frames, monkeypatch)
        assert crowded[:, 0].max() > usual[:, 0].max()  # there was something to search
        assert crowded[:, 0].max() < MOST_WORK
        assert crowded[:, 1].max() < MOST_CALLS * usual[:, 1].max()


@pytest.mark.long
def test_search_work_for_two_performers_and_a_prop_is_bounded(
    subject, database, record, truth, true_markers, monkeypatch
):
    sword = load_prop("sword")
    turns, places = held_poses(sword, truth)
    points = np.concatenate((true_markers, markers_of(sword, turns, places)), axis=1)
    points = np.concatenate((points, true_markers + np.array([2.0, 0.0, 0.0])), axis=1)
    rig = Film(record).rig

    def efforts(with_ghosts):
        session = MultiTargetSession([Session(subject, database, rig) for _ in range(2)], [sword])
        rows = (np.concatenate((row, ghosts(n))) if with_ghosts else row for n, row in enumerate(points[:40]))
        return effort(session, (record(row, number) for number, row in enumerate(rows)), monkeypatch)

    usual, crowded = efforts(False), efforts(True)
    # both bodies are looked for at once, ten times a second at most
    assert crowded[:, 0].max() < 10 * MOST_WORK
    assert np.sum(crowded[:, 0] > 2 * MOST_WORK) <= 40 / FPS / 0.1
    assert crowded[:, 1].max() < MOST_CALLS * usual[:, 1].max()
