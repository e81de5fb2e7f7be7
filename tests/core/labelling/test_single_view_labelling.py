"""Blobs of one camera named by where markers moved in the image and where the last pose has them."""

import numpy as np
import pytest
from perfanim.core.geometry.camera import WORLD_FROM_CAMERA, Camera
from perfanim.core.labelling.single_view_labelling import SingleViewLabeller

STEP_S = 1.0 / 60.0
DEPTH_M = 4.0
UNLIKELY, RIVAL = 20.0, 12.0  # costs: of a blob or marker alone, and of an assignment above the best one's
IMAGE_M = 0.006  # standard deviations: of a marker that was seen just now,
BODY_M, HIDDEN_LONG_M, TORSO_HIDDEN_LONG_M = 0.05, 0.20, 0.06  # and of the pose's, at first and at most
MATRIX = np.array([[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]])
# level, 4 m before the markers
CAMERA = Camera("one", (640, 480), MATRIX, rotation=WORLD_FROM_CAMERA, translation_m=np.array([0.0, 1.0, DEPTH_M]))


def at(*places_m):
    """World positions (M, 3) of places across the camera's axis."""
    return np.array([[*place, 0.0] for place in places_m]) + np.array([0.0, 1.0, 0.0])


def image(points_m):
    """Normalised coordinates of world positions."""
    return CAMERA.undistort(CAMERA.project(points_m))


def seen(markers_m, torso=None, frames=3, velocity_m_s=(0.0, 0.0, 0.0)):
    """The labeller of markers that moved steadily to where they are now."""
    count = len(markers_m)
    labeller = SingleViewLabeller(CAMERA, np.zeros(count, dtype=bool) if torso is None else np.array(torso))
    for frame in range(frames):
        earlier = (frames - 1 - frame) * STEP_S * np.array(velocity_m_s)
        labeller = labeller.after(image(markers_m - earlier), np.arange(count), STEP_S if frame else 0.0)
    return labeller


def hidden(labeller, seconds):
    return labeller.after(np.empty((0, 2)), np.empty(0, dtype=np.int64), seconds)


def best(labeller, points_m, predicted_m, elapsed_s=STEP_S):
    return labeller.proposals(image(points_m), predicted_m, elapsed_s)[0]


def fresh_cost():
    """Cost of a blob exactly where a marker that was just seen should be."""
    here = at((0.0, 0.0))
    return best(seen(here), here, here)[0]


def test_crossing_markers_keep_their_labels():
    """By movement alone: the pose has both where they meet."""
    start, way = at((-0.1, 0.0), (0.1, 0.01)), np.array([[1.5, 0.0, 0.0], [-1.5, 0.0, 0.0]])
    labeller = seen(start, velocity_m_s=way)
    for frame in range(1, 10):
        points = start + frame * STEP_S * way
        order = [0, 1] if frame % 2 else [1, 0]
        _, labels = best(labeller, points[order], at((0.0, 0.0), (0.0, 0.0)))
        assert labels.tolist() == order
        labeller = labeller.after(image(points[order]), labels, STEP_S)


def test_briefly_hidden_marker_is_extrapolated_in_the_image():
    start, way = at((-0.2, 0.0), (0.4, 0.0)), np.array([[2.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    labeller = hidden(seen(start, velocity_m_s=way), 2.0 * STEP_S)
    there = start[:1] + 3.0 * STEP_S * way[:1]
    predicted = np.concatenate((there, start[1:]))
    cost, labels = best(labeller, there, predicted)
    assert labels.tolist() == [0]
    aside = STEP_S * way[:1]
    before, beyond = (best(labeller, there + moved, predicted)[0] for moved in (-aside, aside))
    assert before == pytest.approx(beyond) and cost < before
    # after it the velocity is that of the whole time in which it was hidden
    labeller = labeller.after(image(there), labels, STEP_S)
    further = start + 4.0 * STEP_S * way
    assert best(labeller, further[:1], further)[0] == pytest.approx(fresh_cost())
    assert best(labeller, further[:1] - STEP_S * way[:1], further)[0] > fresh_cost() + 2.0


def test_old_velocities_are_not_used():
    """Then the pose tells where a marker is, and seeing it once again tells no velocity."""
    start, way = at((-0.2, 0.0)), np.array([[2.0, 0.0, 0.0]])
    labeller = hidden(seen(start, velocity_m_s=way), 0.15)
    _, labels = best(labeller, start, start)
    assert labels.tolist() == [0]
    assert best(labeller, start + 0.3 * way, start)[1].tolist() == [-1]
    labeller = labeller.after(image(start), labels, STEP_S)
    assert best(labeller, start, start)[0] == pytest.approx(fresh_cost())


def costs_of_distance(labeller, count=1):
    """Standard deviation, metres, that the costs of a blob beside its marker speak of."""
    here = at(*[(0.0, 0.0)] * count)
    aside = here[:1] + np.array([0.03, 0.0, 0.0])
    return 0.03 / np.sqrt(best(labeller, aside, here)[0] - best(labeller, here[:1], here)[0])


def test_uncertainty_grows_while_a_marker_is_hidden():
    deviations = []
    for seconds in (0.0, 0.03, 0.06, 0.12, 0.2, 1.0):
        deviations.append(costs_of_distance(hidden(seen(at((0.0, 0.0))), seconds) if seconds else seen(at((0.0, 0.0)))))
    assert np.all(np.diff(deviations) > 0.0)
    assert IMAGE_M < deviations[0] < 2.0 * IMAGE_M < 4.0 * IMAGE_M < deviations[1]  # it may have sped up or stopped
    assert deviations[1] < BODY_M < deviations[3] < HIDDEN_LONG_M - 0.05  # the pose's alone, not yet the most
    assert deviations[-1] == pytest.approx(HIDDEN_LONG_M, rel=1e-6)
    assert costs_of_distance(hidden(seen(at((0.0, 0.0)), [True]), 1.0)) == pytest.approx(TORSO_HIDDEN_LONG_M, rel=1e-6)


def test_unseen_marker_is_near_the_pose():
    new = SingleViewLabeller(CAMERA, np.array([False]))
    assert costs_of_distance(new) == pytest.approx(HIDDEN_LONG_M, rel=1e-6)
    # of one that may be anywhere in 20 cm a blob says less than of one in 6 mm, by the logarithm of both variances
    here = at((0.0, 0.0))
    assert best(new, here, here)[0] == pytest.approx(2.0 * np.log((HIDDEN_LONG_M / IMAGE_M) ** 2))


def test_deviations_are_metres_at_the_markers_distance():
    new, far = SingleViewLabeller(CAMERA, np.array([True])), np.array([0.0, 0.0, -4.0])
    here = at((0.0, 0.0))
    aside = here + np.array([0.05, 0.0, 0.0])
    assert best(new, aside + far, here + far)[0] == pytest.approx(best(new, aside, here)[0])


def test_distant_blob_is_not_labelled():
    labeller = seen(at((0.0, 0.0), (0.5, 0.0)))
    points = at((0.0, 0.0), (0.5, 0.0), (0.25, 0.3))
    cost, labels = best(labeller, points, points[:2])
    assert labels.tolist() == [0, 1, -1]
    assert cost == pytest.approx(UNLIKELY + best(labeller, points[:2], points[:2])[0])
    assert best(labeller, np.empty((0, 3)), points[:2])[1].shape == (0,)


def test_long_hidden_marker_does_not_take_a_neighbours_blob():
    markers = at((0.0, 0.0), (0.03, 0.0))
    labeller = seen(markers)
    for _ in range(30):  # the second is hidden for half a second
        labeller = labeller.after(image(markers[:1]), np.array([0]), STEP_S)
    nearer_to_the_second = at((0.012, 0.0))
    predicted = markers - [0.018, 0.0, 0.0]  # the pose lags behind, so that the hidden one seems to be there
    assert best(labeller, nearer_to_the_second, predicted)[1].tolist() == [0]


def test_ambiguous_blob_has_two_proposals_likelier_first():
    labeller = hidden(seen(at((0.0, 0.0), (0.4, 0.0))), 0.3)
    predicted = at((0.0, 0.0), (0.4, 0.0))
    proposals = labeller.proposals(image(at((0.16, 0.0))), predicted, STEP_S)
    assert [labels.tolist() for _, labels in proposals] == [[0], [1]]
    assert proposals[0][0] < proposals[1][0] < proposals[0][0] + RIVAL
    assert proposals[1][0] - proposals[0][0] == pytest.approx((0.24**2 - 0.16**2) / HIDDEN_LONG_M**2, rel=1e-6)
    sure = seen(predicted)
    assert len(sure.proposals(image(predicted), predicted, STEP_S)) == 1  # nobody doubts what was seen just now
    far_apart = hidden(seen(at((0.0, 0.0), (1.0, 0.0))), 0.3)
    proposals = far_apart.proposals(image(at((0.05, 0.0))), at((0.0, 0.0), (1.0, 0.0)), STEP_S)
    assert [labels.tolist() for _, labels in proposals] == [[0], [-1]]  # or nobody's
    assert proposals[1][0] == UNLIKELY


def test_labeller_is_immutable():
    """Alternative labellings go on from one labeller."""
    here, way = at((0.0, 0.0)), np.array([[1.0, 0.0, 0.0]])
    labeller = seen(here, velocity_m_s=way)
    before = best(labeller, here, here)
    labeller.after(image(here + 0.3), np.array([0]), STEP_S)
    after = best(labeller, here, here)
    assert before[0] == after[0]


def test_pose_behind_the_camera_labels_nothing():
    labeller = SingleViewLabeller(CAMERA, np.array([False]))
    behind = at((0.0, 0.0)) + np.array([3.0, 0.0, DEPTH_M + 1.0])
    assert best(labeller, at((0.0, 0.0)), behind)[1].tolist() == [-1]
