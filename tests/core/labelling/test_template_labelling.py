"""Points in a calibration pose named by a template: any place, heading and size, among false points, some hidden."""

import numpy as np
import pytest
from perfanim.core.body.calibration_poses import standing, t_pose
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.geometry import rotations as rot
from perfanim.core.labelling.template_labelling import label_by_template
from perfanim.core.markers.marker_set import load_marker_set

SET = load_marker_set("boxing")
COUNT = len(SET.names)
NOISE_M = 0.01
GATE_M = 0.30  # a marker further off than this from where the pose has it is not that marker
NEEDED = 6  # of nine, 60 percent


def template(pose=t_pose):
    skeleton = default_skeleton()
    return SET.positions_on(skeleton, pose(skeleton))


def laid(markers, heading=0.0, size=1.0, place=(0.4, 0.9, -3.0)):
    return size * rot.rotate(rot.from_rotation_vector(np.array([0.0, heading, 0.0])), markers) + np.array(place)


@pytest.mark.parametrize("pose", [t_pose, standing])
@pytest.mark.parametrize("heading", [-1.0, 0.0, 1.0])
@pytest.mark.parametrize("size", [0.85, 1.0, 1.2])
def test_bodies_of_any_size_and_heading_are_labelled(pose, heading, size):
    generator = np.random.default_rng(1)
    order = generator.permutation(COUNT)
    points = laid(template(pose), heading, size)[order] + generator.normal(scale=NOISE_M, size=(COUNT, 3))
    np.testing.assert_array_equal(label_by_template(points, template(pose)), order)


@pytest.mark.parametrize("hidden", [(0, 5), (3, 8), (2, 6, 7)])
def test_hidden_markers_and_ghosts_leave_other_labels(hidden):
    generator = np.random.default_rng(sum(hidden))
    shown = np.setdiff1d(np.arange(COUNT), hidden)
    markers = laid(template(), 0.5)
    ghosts = generator.uniform([-1.5, 0.0, -4.5], [2.3, 2.2, -1.5], (200, 3))
    ghosts = ghosts[np.linalg.norm(ghosts[:, None] - markers, axis=2).min(axis=1) > 1.2 * GATE_M][:5]
    points = np.concatenate((markers[shown] + generator.normal(scale=NOISE_M, size=(len(shown), 3)), ghosts))
    order = generator.permutation(len(points))
    names = np.append(shown, np.full(len(ghosts), -1))
    np.testing.assert_array_equal(label_by_template(points[order], template()), names[order])


def test_marker_far_from_the_template_is_not_labelled():
    for away_m, name in ((0.8 * GATE_M, 4), (2.0 * GATE_M, -1)):
        points = laid(template())
        points[4] += [0.0, away_m, 0.0]
        labels = label_by_template(points, template())
        assert labels[4] == name
        np.testing.assert_array_equal(np.delete(labels, 4), np.delete(np.arange(COUNT), 4))


def test_bodies_out_of_the_size_range_are_not_labelled():
    for size in (0.5, 1.9):
        assert np.any(label_by_template(laid(template(), size=size), template()) != np.arange(COUNT))


def test_symmetric_pose_is_assumed_to_face_the_cameras():
    """Of two placements that fit as well the one that is turned less is meant."""
    flat, other_side = template() * [1.0, 1.0, 0.0], np.array([0, 2, 1, 4, 3, 6, 5, 8, 7])
    generator = np.random.default_rng(2)
    for heading in (-1.2, -0.2, 0.2, 1.2):
        order = generator.permutation(COUNT)  # which placement is tried first depends on it
        np.testing.assert_array_equal(label_by_template(laid(flat, heading)[order], flat), order)
        labels = label_by_template(laid(flat, np.pi + heading)[order], flat)
        np.testing.assert_array_equal(labels, other_side[order])


def test_too_few_points_for_the_template_are_not_labelled():
    points = laid(template())
    shown = [0, 1, 2, 4, 6, 8]
    np.testing.assert_array_equal(label_by_template(points[shown[:NEEDED]], template()), shown)
    assert np.all(label_by_template(points[shown[: NEEDED - 1]], template()) == -1)
    for five in ((0, 1, 2, 3, 7), (0, 1, 2, 4, 7)):  # which would fit
        assert np.all(label_by_template(laid(template(), 0.7)[list(five)], template()) == -1)
    # so many points, but too few of them where the markers are
    false = points[shown].copy()
    false[4:] += [[0.0, 5.0, 0.0], [5.0, 0.0, 0.0]]
    assert np.all(label_by_template(false, template()) == -1)
    assert label_by_template(np.empty((0, 3)), template()).shape == (0,)


def test_template_of_three_markers():
    three = template()[[0, 1, 4]]
    labels = label_by_template(laid(three, 0.5)[[2, 0, 1]], three)
    np.testing.assert_array_equal(labels, [2, 0, 1])
