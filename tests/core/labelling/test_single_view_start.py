"""One camera alone: who stands before it is recognised by a calibration pose, and followed by rays from then on."""

from dataclasses import replace

import numpy as np
import pytest
from motion_synthesis.performance import performance
from perfanim.core.body.calibration_poses import standing, t_pose
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.labelling.single_view_labelling import SingleViewLabeller
from perfanim.core.labelling.single_view_start import label_near, label_single_view
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.markers.take_frames import take_frames
from perfanim.core.session.session import Session
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.vision.tracked_take import image_take

FPS = 60.0
PIXEL = 0.1 / 600.0


@pytest.fixture(scope="module")
def person(subject):
    return Subject("one", subject.skeleton, load_marker_set("one-camera"))


@pytest.fixture(scope="module")
def camera():
    return default_rig().cameras[0]


def posed(person, pose):
    """Markers of the person in a pose, with the root at the origin."""
    skeleton, markers = person.skeleton, person.marker_set
    return markers.positions_on(skeleton, pose(skeleton))


@pytest.mark.parametrize(("turn", "hidden"), [(0.0, ()), (0.3, (2, 9)), (-0.3, (0, 7))])
def test_calibration_pose_is_labelled_at_any_place(person, camera, turn, hidden):
    poses = [posed(person, pose) for pose in (t_pose, standing)]
    generator = np.random.default_rng(int(10 * turn) + 5)
    for pose in poses:
        place = np.array([generator.uniform(-0.4, 0.4), 0.02 - pose[:, 1].min(), generator.uniform(-0.5, 0.5)])
        world = rot.rotate(rot.from_rotation_vector([0.0, turn, 0.0]), pose) + place
        seen = np.setdiff1d(np.arange(len(world)), hidden)
        points = camera.undistort(camera.project(world[seen])) + generator.normal(scale=PIXEL, size=(len(seen), 2))
        far_off = np.array([[0.5, 0.4], [-0.5, 0.35]])
        order = generator.permutation(len(points) + 2)
        start = label_single_view(np.concatenate((points, far_off))[order], camera, poses)
        assert start is not None
        np.testing.assert_array_equal(start.labels, np.concatenate((seen, [-1, -1]))[order])
        # a tenth of a pixel of noise is a millimetre across the ray; the depth follows from the body's size
        assert np.linalg.norm(start.markers_m - world, axis=1).max() < 0.02


@pytest.mark.parametrize(
    ("place", "turn"), [((-0.9, 1.5), 0.8), ((1.5, -2.5), -0.9), ((0.0, 1.9), 0.0), ((-3.0, -4.5), 0.5)]
)
def test_exact_blobs_give_the_exact_place(person, camera, place, turn):
    """Near or far, aside, and turned: the body is the assumed one, so that all but rounding is known."""
    facing = np.arctan2(*-camera.rotation[2][[0, 2]])
    for pose in (t_pose, standing):
        body = posed(person, pose)
        world = rot.rotate(rot.from_rotation_vector([0.0, facing + turn, 0.0]), body)
        world = world + np.array([place[0], 1.0, place[1]])
        order = np.random.default_rng(2).permutation(len(world))
        start = label_single_view(camera.undistort(camera.project(world[order])), camera, [posed(person, pose)])
        np.testing.assert_array_equal(start.labels, order)
        np.testing.assert_allclose(start.markers_m, world, atol=1e-3)


def test_few_markers_may_be_hidden(person, camera):
    pose = posed(person, standing)
    world = pose + np.array([0.1, 1.0, 0.0])
    points, needed = camera.undistort(camera.project(world)), int(np.ceil(0.7 * len(world)))
    shown = np.random.default_rng(3).permutation(len(world))
    start = label_single_view(points[shown[:needed]], camera, [pose])
    np.testing.assert_array_equal(start.labels, shown[:needed])
    assert label_single_view(points[shown[: needed - 1]], camera, [pose]) is None
    # as many blobs, but of these too few the markers'
    false = points[shown[:needed]].copy()
    false[:2] = [[0.55, 0.4], [-0.55, 0.4]]
    assert label_single_view(false, camera, [pose]) is None


def test_right_one_of_two_poses_is_found(person, camera):
    poses = [posed(person, pose) for pose in (t_pose, standing)]
    for taken in (0, 1):
        world = poses[taken] + [0.1, 1.0, 0.2]
        start = label_single_view(camera.undistort(camera.project(world)), camera, poses)
        np.testing.assert_allclose(start.markers_m, world, atol=1e-3)


def test_labellings_are_unique_and_likeliest_first(person, camera):
    """One of thirty stands as the performer does, a hand's breadth away; the others elsewhere or otherwise."""
    generator = np.random.default_rng(4)
    standing_m, other_m = (
        posed(person, standing) + np.array([0.2, 1.0, 0.1]),
        posed(person, t_pose) + np.array([0.2, 1.0, 0.1]),
    )
    elsewhere = [place * np.array([1.0, 0.3, 1.0]) for place in generator.uniform(0.4, 0.9, (14, 3))]
    expected = np.stack([*(standing_m + place for place in elsewhere), *(other_m - place for place in elsewhere),
                         other_m, standing_m + np.array([0.05, 0.03, -0.06])])  # fmt: skip
    order = generator.permutation(len(standing_m))
    points = camera.undistort(camera.project(standing_m[order]))
    for count in (1, 3):
        starts = label_near(points, camera, expected, count)
        assert 1 <= len(starts) <= count
        np.testing.assert_array_equal(starts[0].labels, order)
        np.testing.assert_allclose(starts[0].markers_m, standing_m, atol=2e-3)
        assert len({tuple(start.labels) for start in starts}) == len(starts)
    assert len(starts) == 3


def test_body_is_fitted_to_the_other_markers_if_a_hand_is_elsewhere(person, camera):
    """One marker half a metre off its place is nobody's, and pulls nothing."""
    world = posed(person, standing) + np.array([0.1, 1.0, 0.0])
    seen = world.copy()
    seen[0] += [0.0, 0.6, 0.0]
    starts = label_near(camera.undistort(camera.project(seen)), camera, (world + np.array([0.06, 0.0, 0.05]))[None], 1)
    assert starts[0].labels[0] == -1
    np.testing.assert_array_equal(starts[0].labels[1:], np.arange(1, len(world)))
    np.testing.assert_allclose(starts[0].markers_m, world, atol=2e-3)


def test_blobs_unlike_a_body_are_not_labelled(person, camera):
    points = np.random.default_rng(1).uniform(-0.4, 0.4, (14, 2))
    assert label_single_view(points, camera, [posed(person, t_pose)]) is None
    assert label_single_view(points[:5], camera, [posed(person, t_pose)]) is None
    assert label_single_view(np.empty((0, 2)), camera, [posed(person, t_pose)]) is None


def test_body_in_any_pose_is_labelled_near_its_place(person, camera, database):
    skeleton, markers = person.skeleton, person.marker_set
    motion = performance([("boxing", 3.0)], 20.0, skeleton, seed=1_000_007)
    rows = markers.positions_on(skeleton, motion.rotations, motion.root_positions_m)
    examples = rows[::3]  # poses like the true one, not it, and laid with the root elsewhere
    generator = np.random.default_rng(3)
    right = total = 0
    for row in rows[61:100:6]:
        hidden = generator.choice(len(row), 2, replace=False)
        seen = generator.permutation(np.setdiff1d(np.arange(len(row)), hidden))
        points = camera.undistort(camera.project(row[seen])) + generator.normal(scale=PIXEL, size=(len(seen), 2))
        starts = label_near(points, camera, examples + generator.normal(scale=0.05, size=3), 2)
        assert not np.array_equal(starts[0].labels, starts[-1].labels) or len(starts) == 1
        right += max(int(np.sum(start.labels == seen)) for start in starts)
        total += len(seen)
    assert right > 0.9 * total


def test_returning_blob_has_both_labels_proposed(camera):
    # across the image, 3 m away: a torso, a hand beside it, and an elbow 0.15 m from the hand
    at = np.array([[0.0, 1.0, 0.0], [0.3, 1.0, 0.0], [0.45, 1.0, 0.0]])
    image = camera.undistort(camera.project(at))
    labeller = SingleViewLabeller(camera, np.array([True, False, False]))
    labeller = labeller.after(image[:1], np.array([0]), 0.0)
    for _ in range(60):  # a second in which only the torso is seen
        labeller = labeller.after(image[:1], np.array([0]), 1.0 / FPS)
    (_, labels), *others = labeller.proposals(image[:1], at + np.array([0.02, 0.0, 0.0]), 1.0 / FPS)
    assert labels.tolist() == [0]
    assert not others
    between = camera.undistort(camera.project(np.array([[0.39, 1.0, 0.0]])))
    found = [labels.tolist() for _, labels in labeller.proposals(np.concatenate((image[:1], between)), at, 1.0 / FPS)]
    assert found[0] == [0, 2]  # it is nearer to the elbow,
    assert [0, 1] in found  # but may as well be the hand


def without_depth(frame, camera):
    """The frame with its first camera's blobs only."""
    points = camera.undistort(frame.blobs[0][:, :2].astype(np.float64))
    alone = np.zeros(len(points), dtype=np.int64)
    return MarkerFrame(
        frame.number,
        frame.time_s,
        blobs=frame.blobs[:1],
        single_cameras=alone,
        single_blobs=np.arange(len(points)),
        single_points=points,
    )


@pytest.mark.long
def test_one_camera_tracks_a_walk(person, database, record):
    motion = performance([("walking", 2.0)], FPS, person.skeleton, seed=1_000_003)
    markers = person.marker_set
    rows = markers.positions_on(person.skeleton, motion.rotations, motion.root_positions_m)
    both = default_rig()
    errors, away = {}, {}
    for rig in (CameraRig(both.cameras[:1]), both):
        session, film = Session(person, database, rig), replace(record, rig=rig)
        frames = [film(row, number, cameras=True, fps=FPS) for number, row in enumerate(rows)]
        if len(rig) == 1:  # by way of a take
            frames = [without_depth(frame, rig.cameras[0]) for frame in frames]
            frames = take_frames(image_take(frames, rig, "walk", FPS), markers)
        poses = [session.step(frame) for frame in frames]
        found = np.array([pose.rotations for pose in poses])
        angles = np.degrees(rot.angle_between(found, motion.rotations))[:, 1:]
        errors[len(rig)] = float(angles.mean())
        solved = np.array([pose.markers_m for pose in poses])
        # in the image every marker is where it is seen: none was taken for another
        pixels = np.linalg.norm(rig.cameras[0].project(solved) - rig.cameras[0].project(rows), axis=2)
        assert pixels.max() < 10.0
        roots = np.array([pose.root_position_m for pose in poses])
        away[len(rig)] = float(np.linalg.norm(roots - motion.root_positions_m, axis=1).max())
    assert away[1] < 0.1
    assert errors[1] < 1.6 * errors[2]  # 5.7 and 3.7 degrees
