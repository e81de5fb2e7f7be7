import numpy as np
import pytest
from perfanim.core.geometry import rotations as rot
from perfanim.core.solver.observation import Observation
from perfanim.core.solver.root import root_from_torso
from perfanim.core.solver.subject_model import RootPose


@pytest.fixture
def case(model, truth):
    """Markers of a pose in the root's frame, and a root somewhere."""
    pose = np.random.default_rng(0).normal(scale=0.2, size=(28, 3))
    root = RootPose(rot.from_rotation_vector([0.3, 2.5, -0.2]), np.array([1.0, 0.9, -3.0]))
    return model.markers(pose), root


def assert_same(found, expected):
    assert rot.angle_between(found.rotation, expected.rotation) < 1e-7
    np.testing.assert_allclose(found.position_m, expected.position_m, atol=1e-9)


@pytest.mark.parametrize("hidden", [(), (0,), (3,), (4, 5, 6, 7)])
def test_exact_on_a_noise_free_torso(model, case, hidden):
    local, root = case
    points = root.to_world(local)
    points[4:] += 0.3  # hands and feet are elsewhere: they do not count
    points[list(hidden)] = np.nan
    assert_same(root_from_torso(Observation.of_points(points), local, model, None), root)


def test_pelvis_markers_have_more_weight(model, case):
    local, root = case
    points = root.to_world(local)
    points[:2] += np.array([0.0, 0.0, 0.04])  # the shoulders, which the back carries, lean
    found = root_from_torso(Observation.of_points(points), local, model, None)
    waist = np.flatnonzero(model.torso & (model.joints == 0))
    errors = np.linalg.norm(found.to_world(local) - points, axis=1)
    assert errors[waist].max() < errors[:2].min()


def test_last_root_is_shifted_with_too_few_torso_markers(model, case):
    local, root = case
    shift = np.array([0.02, -0.01, 0.03])
    points = root.to_world(local) + shift
    points[[0, 3]] = np.nan
    found = root_from_torso(Observation.of_points(points), local, model, root)
    assert_same(found, RootPose(root.rotation, root.position_m + shift))
    assert root_from_torso(Observation.of_points(points), local, model, None) is None


def test_root_is_kept_without_markers(model, case):
    local, root = case
    nothing = Observation.of_points(np.full((8, 3), np.nan))
    assert root_from_torso(nothing, local, model, root) is root
    assert root_from_torso(nothing, local, model, None) is None
