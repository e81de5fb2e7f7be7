"""Markers and Jacobians by the kernel are NumPy's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from perfanim.core.body.skeleton import Skeleton
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.database.store import pose_from_rotations
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.solver.marker_kinematics import MarkerBody, posed_markers, posed_markers_and_jacobian
from two_bodies import assert_same, spoiled

SPECIAL = st.sampled_from([None, np.nan, np.inf, -np.inf, 1e300, -1e300, 1e-310])


def body_of(marker_set: str, seed: int) -> MarkerBody:
    skeleton, markers = default_skeleton(), load_marker_set(marker_set)
    reference = rot.from_rotation_vector(np.random.default_rng(seed).normal(size=(len(skeleton), 3)))
    return MarkerBody.of(skeleton, markers.joint_indices(skeleton), markers.offsets_m, reference)


@given(
    seed=st.integers(0, 2**32 - 1),
    marker_set=st.sampled_from(["boxing", "locomotion", "cmu-41"]),
    leading=st.sampled_from([(), (0,), (1,), (3,), (2, 2)]),
    scale=st.sampled_from([0.0, 1e-9, 1e-5, 0.5, 3.0, 1e4]),
    special=SPECIAL,
)
def test_any_pose(seed: int, marker_set: str, leading: tuple[int, ...], scale: float, special: float | None) -> None:
    generator = np.random.default_rng(seed)
    body, place = body_of(marker_set, seed), seed % 1000
    poses = spoiled(scale * generator.normal(size=(*leading, 28, 3)), special, place)
    matrices = rot.to_matrix(rot.from_rotation_vector(generator.normal(size=(*leading, 3))))
    positions_m = spoiled(generator.normal(size=(*leading, 3)), special if place % 3 == 0 else None, place)
    for stage in (posed_markers, posed_markers_and_jacobian):
        assert_same(stage, body, poses, matrices, positions_m)


def test_recorded_poses(model, truth, database):
    poses = pose_from_rotations(truth.rotations, database.mean_rotations)
    matrices = rot.to_matrix(truth.rotations[:, 0])
    assert_same(posed_markers_and_jacobian, model.body, poses, matrices, truth.root_positions_m)
    views = poses[::-2], matrices[::-2], truth.root_positions_m[::-2]  # not contiguous
    assert_same(posed_markers_and_jacobian, model.body, *views)


def test_one_root_for_several_poses(model, truth, database):
    poses = pose_from_rotations(truth.rotations[:4], database.mean_rotations)
    assert_same(posed_markers, model.body, poses, rot.to_matrix(truth.rotations[0, 0]), truth.root_positions_m[0])


def test_larger_bodies_are_refused():
    count = 70
    chain = Skeleton(
        tuple(map(str, range(count))), np.arange(-1, count - 1), np.full((count, 3), 0.1), np.zeros((count, 3))
    )
    body = MarkerBody.of(chain, np.array([count - 1]), np.zeros((1, 3)), rot.identity((count,)))
    with pytest.raises(IndexError):
        posed_markers.compiled_body(body, np.zeros((count - 1, 3)), np.eye(3), np.zeros(3))
