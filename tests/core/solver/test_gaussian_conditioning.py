import numpy as np
import pytest
from perfanim.core.database.store import pose_from_rotations
from perfanim.core.geometry import rotations as rot
from perfanim.core.solver.gaussian_conditioning import (
    Expectation,
    Prior,
    continue_prior,
    fit_to_markers,
    widen_joints,
)
from perfanim.core.solver.neighbours_prior import gaussian_given
from perfanim.core.solver.observation import Observation
from perfanim.core.solver.subject_model import RootPose
from scipy.stats import multivariate_normal

NOISE_M = 0.002
EXPECTED_SIGMA_M = 0.01  # of a marker about the prior's
FLOOR = 0.03**2 * np.eye(84)
NO_PAST = (np.empty(0), np.empty(0))


def gaussian(seed, size=7):
    generator = np.random.default_rng(seed)
    poses = generator.normal(size=(40, size)) @ generator.normal(size=(size, size))
    weights = generator.uniform(0.1, 1.0, 40)
    return poses, weights / weights.sum()


def test_prior_is_the_weighted_mean_and_covariance():
    poses, weights = gaussian(0)
    floor = np.diag(np.linspace(0.01, 0.02, 7))
    prior = gaussian_given(poses, weights, floor, *NO_PAST)
    np.testing.assert_allclose(prior.mean, np.average(poses, axis=0, weights=weights))
    expected = np.cov(poses.T, aweights=weights, ddof=0) + floor
    np.testing.assert_allclose(prior.covariance, expected, atol=1e-12)


def test_continued_prior_is_the_product_of_gaussians():
    prior = gaussian_given(*gaussian(1), 0.01 * np.eye(7), *NO_PAST)
    generator = np.random.default_rng(2)
    expected, factor = generator.normal(size=7), generator.normal(size=(7, 7))
    change = factor @ factor.T + 0.1 * np.eye(7)
    result = continue_prior(prior, expected, change)
    covariance = np.linalg.inv(np.linalg.inv(prior.covariance) + np.linalg.inv(change))
    mean = covariance @ (np.linalg.solve(prior.covariance, prior.mean) + np.linalg.solve(change, expected))
    np.testing.assert_allclose(result.covariance, covariance, atol=1e-9)
    np.testing.assert_allclose(result.mean, mean, atol=1e-9)


def test_joints_are_widened_where_another_prior_is_far_away():
    first, second = (gaussian_given(*gaussian(seed, 9), 0.01 * np.eye(9), *NO_PAST) for seed in (4, 5))
    mean = first.mean.copy()
    variances = first.covariance.diagonal() + second.covariance.diagonal()
    mean[1] += np.sqrt(3.0 * variances[:3].sum())  # of the first joint: three times its variances
    mean[7] += 0.1 * np.sqrt(variances[6:].sum())  # of the last: much less than those
    widened = widen_joints(first, Prior(mean, second.covariance), np.array([5.0, 0.1, 4.0]), 0.4)
    factors = np.sqrt(np.repeat([5.0 * 0.4 * 5.0 * 3.0, 1.0, 4.0], 3))
    np.testing.assert_array_equal(widened.mean, first.mean)
    np.testing.assert_allclose(widened.covariance, first.covariance * np.outer(factors, factors), rtol=1e-12)


def test_prior_is_regressed_on_observations():
    samples, weights = gaussian(3)
    prior = gaussian_given(samples, weights, 0.01 * np.eye(7), *NO_PAST)
    observed = np.array([0.5, np.nan, -0.2])  # the last three entries, one of them unknown
    variances = np.array([0.05, 0.3, 0.01])
    result = gaussian_given(samples, weights, 0.01 * np.eye(7), observed, variances)
    seen, joint = [4, 6], prior.covariance
    gain = joint[:4, seen] @ np.linalg.inv(joint[np.ix_(seen, seen)] + np.diag(variances[[0, 2]]))
    np.testing.assert_allclose(result.mean, prior.mean[:4] + gain @ (observed[[0, 2]] - prior.mean[seen]), atol=1e-10)
    np.testing.assert_allclose(result.covariance, joint[:4, :4] - gain @ joint[seen, :4], atol=1e-10)


def test_prior_without_observations_is_unchanged():
    prior = gaussian_given(*gaussian(4), 0.01 * np.eye(7), *NO_PAST)
    result = gaussian_given(*gaussian(4), 0.01 * np.eye(7), np.full(3, np.nan), np.full(3, 0.05))
    np.testing.assert_allclose(result.mean, prior.mean[:4], atol=1e-12)
    np.testing.assert_allclose(result.covariance, prior.covariance[:4, :4], atol=1e-12)


@pytest.fixture(scope="module")
def frame(model, database, truth, true_markers):
    return frame_at(25, database, truth, true_markers)


def frame_at(at, database, truth, true_markers):
    """Prior about a frame of the clip left out, its noisy markers, and a root that is somewhat off."""
    poses = np.asarray(database.poses, dtype=np.float64).reshape(database.frames, -1)
    pose = pose_from_rotations(truth.rotations[at], database.mean_rotations).ravel()
    near = poses[np.argsort(np.linalg.norm(poses - pose, axis=1))[:100]]
    prior = gaussian_given(near, np.full(100, 0.01), FLOOR, *NO_PAST)
    root = RootPose(
        rot.multiply(truth.rotations[at, 0], rot.from_rotation_vector([0.03, -0.04, 0.02])),
        truth.root_positions_m[at] + np.array([0.01, -0.02, 0.01]),
    )
    return prior, pose, root, true_markers[at] + np.random.default_rng(6).normal(scale=NOISE_M, size=(8, 3))


def rms(a, b):
    return np.sqrt(np.mean(np.sum((a - b) ** 2, axis=1)))


UNLIMITED = np.array([[-np.inf], [np.inf]])


def fitted(model, frame, observation, steps=3):
    prior, _, root, _ = frame
    expectation = Expectation(prior, observation, root, (0.03, 0.1), UNLIMITED)
    return fit_to_markers(expectation, model, NOISE_M, steps)[:2]


def test_fitted_markers_are_within_their_noise(model, frame):
    prior, _, root, points = frame
    before = rms(model.markers(prior.mean.reshape(-1, 3), root), points)
    pose, found = fitted(model, frame, Observation.of_points(points))
    after = rms(model.markers(pose.reshape(-1, 3), found), points)
    assert before > 5.0 * np.sqrt(3.0) * NOISE_M
    assert after < np.sqrt(3.0) * NOISE_M  # more freedom than markers: below the noise


def test_fit_comes_closer_to_the_true_pose_than_the_prior(model, frame, database):
    _, true_pose, root, points = frame
    poses = np.asarray(database.poses[::10], dtype=np.float64).reshape(-1, 84)
    prior = gaussian_given(
        poses, np.full(len(poses), 1.0 / len(poses)), FLOOR, *NO_PAST
    )  # knows nothing of this moment
    expectation = Expectation(prior, Observation.of_points(points), root, (0.03, 0.1), UNLIMITED)
    pose, _, _ = fit_to_markers(expectation, model, NOISE_M, 5)
    assert np.linalg.norm(pose - true_pose) < 0.7 * np.linalg.norm(prior.mean - true_pose)


def test_likelihood_is_the_marker_density_under_the_prior(model, frame):
    prior, _, root, points = frame
    points = np.where(np.arange(8)[:, None] == 4, np.nan, points)
    observation = Observation.of_points(points)
    markers, jacobian = model.markers_and_jacobian(prior.mean.reshape(-1, 3), root)
    rows, off = jacobian[observation.located].reshape(-1, 90), (points - markers)[observation.located].ravel()
    covariance = rows[:, 6:] @ prior.covariance @ rows[:, 6:].T + EXPECTED_SIGMA_M**2 * np.eye(len(rows))
    covariance += rows[:, :6] @ np.diag(np.repeat([0.03, 0.1], 3) ** 2) @ rows[:, :6].T
    expected = -multivariate_normal(np.zeros(len(rows)), covariance).logpdf(off)
    found = Expectation(prior, observation, root, (0.03, 0.1), UNLIMITED).negative_log_likelihood(model)
    assert found == pytest.approx(expected, rel=1e-4, abs=1e-2)


def test_fit_minimises_its_cost(model, frame):
    prior, _, root, points = frame
    pose, found = fitted(model, frame, Observation.of_points(points), steps=8)

    def energy(pose, found):
        turn = rot.to_rotation_vector(rot.multiply(rot.conjugate(root.rotation), found.rotation)) / 0.1
        shift = (found.position_m - root.position_m) / 0.03
        control = (model.markers(pose.reshape(-1, 3), found) - points) / NOISE_M
        away = pose - prior.mean
        return np.sum(turn**2) + np.sum(shift**2) + np.sum(control**2) + away @ np.linalg.solve(prior.covariance, away)

    least = energy(pose, found)
    factor = np.linalg.cholesky(prior.covariance)
    generator = np.random.default_rng(7)
    for _ in range(30):
        turned = rot.multiply(found.rotation, rot.from_rotation_vector(generator.normal(scale=0.003, size=3)))
        other = RootPose(turned, found.position_m + generator.normal(scale=0.001, size=3))
        assert energy(pose + 0.03 * factor @ generator.normal(size=84), other) > least


def test_without_markers_the_prior_and_the_root_stay(model, frame):
    prior, _, root, _ = frame
    pose, found = fitted(model, frame, Observation.of_points(np.full((8, 3), np.nan)))
    np.testing.assert_allclose(pose, prior.mean)
    np.testing.assert_allclose(found.position_m, root.position_m)


def test_a_marker_on_a_ray_helps(model, database, truth, true_markers, stage_rig):
    """A hand that one camera sees comes closer to the truth than one that nobody sees, and lies on its ray."""
    hand, view, away = 4, stage_rig.cameras[1], []
    for at in range(5, 60, 5):
        frame = frame_at(at, database, truth, true_markers)
        _, _, _, points = frame
        without = points.copy()
        without[hand] = np.nan
        cameras, image_points = np.full(8, -1), np.full((8, 2), np.nan)
        cameras[hand], image_points[hand] = 1, view.undistort(view.project(points[hand]))
        blind = fitted(model, frame, Observation.of_points(without))
        seeing = fitted(model, frame, Observation(without, cameras, image_points, stage_rig.cameras))
        hands = [model.markers(pose.reshape(-1, 3), root)[hand] for pose, root in (blind, seeing)]
        away.append([np.linalg.norm(each - true_markers[at, hand]) for each in hands])
        local = view.to_camera(hands[1])
        assert np.linalg.norm(local[:2] / local[2] - image_points[hand]) * local[2] < 2.0 * NOISE_M
    blind_m, seeing_m = np.mean(away, axis=0)
    assert seeing_m < 0.8 * blind_m


def test_a_noisy_marker_counts_less(model, frame):
    *_, points = frame
    hand = 4
    pulled = points + np.where(np.arange(8) == hand, 0.03, 0.0)[:, None]
    away = []
    for noise_m in (np.zeros(8), np.where(np.arange(8) == hand, 0.05, 0.0)):
        pose, found = fitted(model, frame, Observation.of_points(pulled, noise_m))
        away.append(np.linalg.norm((model.markers(pose.reshape(-1, 3), found) - pulled)[hand]))
    assert away[1] > 2.0 * away[0]


def test_fit_converges_from_a_distant_prior(model, frame):
    """Full Gauss-Newton steps from a prior so far away wring the limbs and leave the markers."""
    prior, _, root, points = frame
    generator = np.random.default_rng(4)
    for _ in range(20):
        wrong = Prior(prior.mean + generator.normal(0.0, 0.8, len(prior.mean)), prior.covariance)
        start = rms(model.markers(wrong.mean.reshape(-1, 3), root), points)
        expectation = Expectation(wrong, Observation.of_points(points), root, (0.03, 0.1), UNLIMITED)
        pose, found, _ = fit_to_markers(expectation, model, NOISE_M, 8)
        assert rms(model.markers(pose.reshape(-1, 3), found), points) <= start


def test_fit_respects_joint_limits(model, frame):
    prior, _, root, points = frame
    limits = np.array([prior.mean - 0.05, prior.mean + 0.05])
    far = points + np.array([0.0, 0.5, 0.0]) * (np.arange(len(points)) % 2)[:, None]
    expectation = Expectation(prior, Observation.of_points(far), root, (0.03, 0.1), limits)
    free = Expectation(prior, Observation.of_points(far), root, (0.03, 0.1), UNLIMITED)
    beyond = [
        np.abs(pose - np.clip(pose, *limits)).max()
        for pose, _, _ in (fit_to_markers(wanted, model, 0.02, 8) for wanted in (expectation, free))
    ]
    assert beyond[0] < 0.05 < 0.1 < beyond[1]  # 0.02 is the standard deviation beyond a limit
