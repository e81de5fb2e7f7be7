"""Names of trajectories by the places of markers on standing bodies, and pairs of trajectories."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.calibration_poses import standing, t_pose
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import TakeError
from perfanim.core.geometry import rotations as rot
from perfanim.core.labelling.trajectory_naming import match_trajectories, misfit_of_names_m, name_trajectories
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.marker_take import MarkerTake, SingleViews
from perfanim.core.simulate.studio.studio_rig import default_rig

NOISE_M = 0.01


def take_of(marker_set, pose=standing, frames=2, scattered=()):
    """A person of 1.68 m in a pose, who sways, markers in random order; some frames show points all over the place."""
    generator = np.random.default_rng(0)
    skeleton = default_skeleton(1.68)
    root = np.array([0.3, 1.0, -3.0])
    row = marker_set.positions_on(skeleton, pose(skeleton), root)
    order = generator.permutation(len(row))
    sway = np.cumsum(generator.normal(scale=NOISE_M, size=(frames, 1, 3)), axis=0)
    positions = row[order] + sway + generator.normal(scale=NOISE_M, size=(frames, len(row), 3))
    for f in scattered:
        positions[f] = generator.uniform(-3.0, 3.0, (len(row), 3))
    return MarkerTake("stand", 30.0, tuple(f"M{i}" for i in range(len(row))), positions), order


@pytest.mark.parametrize("pose", [standing, t_pose])
@pytest.mark.parametrize("name", ["two-webcams", "locomotion", "boxing"])
def test_trajectories_are_named(name, pose):
    marker_set = load_marker_set(name)
    take, order = take_of(marker_set, pose)
    named = name_trajectories(take, marker_set)
    assert named.names == marker_set.names
    np.testing.assert_array_equal(named.positions_m, take.positions_m[:, np.argsort(order)])


def test_single_camera_trajectories_are_named():
    marker_set = load_marker_set("locomotion")
    take, order = take_of(marker_set)
    cameras = np.tile(np.arange(8) % 2, (2, 1))
    points = np.random.default_rng(1).uniform(size=(2, 8, 2))
    named = name_trajectories(replace(take, single=SingleViews(default_rig(), cameras, points)), marker_set)
    np.testing.assert_array_equal(named.single.cameras, cameras[:, np.argsort(order)])
    np.testing.assert_array_equal(named.single.points, points[:, np.argsort(order)])


def test_markers_hidden_in_some_frames_are_named():
    marker_set = load_marker_set("locomotion")
    take, order = take_of(marker_set, frames=4)
    positions = take.positions_m.copy()
    positions[:2, 2] = positions[1:, 5] = np.nan
    named = name_trajectories(replace(take, positions_m=positions), marker_set)
    np.testing.assert_array_equal(named.positions_m, positions[:, np.argsort(order)])


def test_fewest_frames_with_a_standing_body():
    marker_set = load_marker_set("locomotion")
    take, order = take_of(marker_set, frames=10, scattered=range(6))
    np.testing.assert_array_equal(
        name_trajectories(take, marker_set).positions_m, take.positions_m[:, np.argsort(order)]
    )
    with pytest.raises(TakeError, match="the markers' positions do not fit the marker set locomotion") as told:
        name_trajectories(take_of(marker_set, frames=10, scattered=range(8))[0], marker_set)
    assert told.value.where == "stand"


def test_a_take_with_another_number_of_markers_is_refused():
    take, _ = take_of(load_marker_set("two-webcams"))
    with pytest.raises(TakeError, match="has 12 markers, but the marker set locomotion has 8"):
        name_trajectories(take, load_marker_set("locomotion"))


def test_trajectories_are_matched_by_common_frames():
    generator = np.random.default_rng(1)
    points = np.tile(generator.uniform(-1.0, 1.0, (10, 3)), (30, 1, 1))
    order = generator.permutation(10)
    other = points[:, order] + generator.normal(scale=0.01, size=points.shape)
    other[:5, 3] = np.nan
    other[:10, 6] += 5.0  # for a third of the time it was something else
    points[20:, 7] = np.nan
    rows, columns = match_trajectories(points, other)
    np.testing.assert_array_equal(order[columns], rows)


def test_trajectories_without_common_frames_are_matched_last():
    near, far = np.zeros((4, 3)), np.full((4, 3), 100.0)
    hidden = np.full((4, 3), np.nan)
    rows, columns = match_trajectories(np.stack((near, hidden), axis=1), np.stack((hidden, far), axis=1))
    assert dict(zip(rows.tolist(), columns.tolist(), strict=True)) == {0: 1, 1: 0}


def test_turned_bodies_are_named():
    """Up to a good part of a right angle: one who faces away would be taken for one who faces the cameras."""
    marker_set = load_marker_set("boxing")
    take, order = take_of(marker_set)
    for heading in (-0.7, 0.7):
        turned = rot.rotate(rot.from_rotation_vector(np.array([0.0, heading, 0.0])), take.positions_m)
        named = name_trajectories(replace(take, positions_m=turned), marker_set)
        np.testing.assert_array_equal(named.positions_m, turned[:, np.argsort(order)])


@pytest.mark.parametrize("size", [0.8, 1.0, 1.3])
def test_misfit_of_right_names_is_the_noise(size):
    marker_set = load_marker_set("boxing")
    take, order = take_of(marker_set, frames=30)
    turn = rot.to_matrix(rot.from_rotation_vector(np.array([1.0, 2.0, -0.5])))
    named = replace(take, names=marker_set.names, positions_m=size * take.positions_m[:, np.argsort(order)] @ turn.T)
    # three coordinates a marker, of which turn, place and size of the whole take up seven of 27
    expected = size * NOISE_M * np.sqrt(3.0 * (27 - 7) / 27)
    assert misfit_of_names_m(named, marker_set) == pytest.approx(expected, rel=0.15)
    exchanged = named.positions_m.copy()
    exchanged[:, [0, 8]] = exchanged[:, [8, 0]]
    assert misfit_of_names_m(replace(named, positions_m=exchanged), marker_set) > 5.0 * expected


def test_misfit_needs_four_markers_at_once():
    marker_set = load_marker_set("boxing")
    positions = take_of(marker_set)[0].positions_m.copy()
    positions[:, 3:] = np.nan
    assert misfit_of_names_m(MarkerTake("few", 30.0, marker_set.names, positions), marker_set) == np.inf
