import numpy as np
from perfanim.core.geometry import rotations as rot
from perfanim.core.session.pose_noise_filter import PoseNoiseFilter, without_noise

FPS = 60.0
TIMES_S = np.arange(240) / FPS
NOISE_RAD, NOISE_M = 0.01, 0.003
SETTLED = 60  # frames after which the noise is known


def filtered(rotations: np.ndarray, root_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    pose_filter = PoseNoiseFilter(rotations.shape[1])
    found = [pose_filter.step(time_s, *pose) for time_s, *pose in zip(TIMES_S, rotations, root_m, strict=True)]
    return np.array([pose[0] for pose in found]), np.array([pose[1] for pose in found])


def turning(angles_rad: np.ndarray) -> np.ndarray:
    """Return rotations (F, 2, 4) of a joint that turns about y, and one that stays."""
    vectors = np.zeros((len(angles_rad), 2, 3))
    vectors[:, 0, 1] = angles_rad
    return rot.from_rotation_vector(vectors)


def trembling(rotations: np.ndarray) -> float:
    """Return the mean third difference of a joint's rotations (F, 4), rad."""
    turned = rot.to_rotation_vector(rot.multiply(rot.conjugate(rotations[:-1]), rotations[1:]))
    return float(np.linalg.norm(np.diff(turned, 2, axis=0), axis=-1).mean())


def test_noise_of_a_still_body_is_taken_away() -> None:
    chance = np.random.default_rng(0)
    still = turning(np.full(len(TIMES_S), 0.7))
    noisy = rot.multiply(still, rot.from_rotation_vector(chance.normal(0.0, NOISE_RAD, (*still.shape[:2], 3))))
    places_m = chance.normal(0.0, NOISE_M, (len(TIMES_S), 3))
    shown, shown_m = filtered(noisy, places_m)
    assert trembling(shown[SETTLED:, 0]) < 0.3 * trembling(noisy[SETTLED:, 0])
    assert rot.angle_between(shown, still)[SETTLED:].mean() < 0.6 * rot.angle_between(noisy, still)[SETTLED:].mean()
    assert np.linalg.norm(shown_m[SETTLED:], axis=1).mean() < 0.6 * np.linalg.norm(places_m[SETTLED:], axis=1).mean()


def test_a_take_is_calmer_and_nearer_to_the_truth_than_live() -> None:
    chance = np.random.default_rng(1)
    truth = turning(np.sin(2.0 * np.pi * TIMES_S))
    place_m = 0.3 * np.sin(np.pi * TIMES_S)[:, None] * np.ones(3)
    noisy = rot.multiply(truth, rot.from_rotation_vector(chance.normal(0.0, NOISE_RAD, (*truth.shape[:2], 3))))
    noisy_m = place_m + chance.normal(0.0, NOISE_M, place_m.shape)
    (live, live_m), (shown, shown_m) = filtered(noisy, noisy_m), without_noise(TIMES_S, noisy, noisy_m)
    assert trembling(shown[SETTLED:, 0]) < 0.5 * trembling(live[SETTLED:, 0])
    assert rot.angle_between(shown, truth)[SETTLED:].mean() < 0.8 * rot.angle_between(live, truth)[SETTLED:].mean()
    assert np.linalg.norm((shown_m - place_m)[SETTLED:]) < 0.8 * np.linalg.norm((live_m - place_m)[SETTLED:])


def test_a_fast_motion_without_noise_is_not_late() -> None:
    """An arm that swings by a radian twice a second, and a body that turns round and round."""
    for angles_rad in (np.sin(2.0 * np.pi * 2.0 * TIMES_S), 8.0 * TIMES_S):
        truth = turning(angles_rad)
        place_m = np.stack((angles_rad, np.zeros_like(angles_rad), angles_rad), axis=1) * 0.1
        shown, shown_m = filtered(truth, place_m)
        assert np.degrees(rot.angle_between(shown, truth)).max() < 0.1
        assert np.linalg.norm(shown_m - place_m, axis=1).max() < 0.001


def test_a_sudden_turn_is_shown_at_once_and_not_overshot() -> None:
    truth = turning(np.where(TIMES_S < 2.0, 0.0, 0.6))
    place_m = np.where(TIMES_S < 2.0, 0.0, 0.5)[:, None] * np.ones(3)
    shown, shown_m = filtered(truth, place_m)
    np.testing.assert_allclose(np.abs(np.sum(shown * truth, axis=-1)), 1.0, atol=1e-6)
    np.testing.assert_allclose(shown_m, place_m, atol=1e-6)


def test_after_a_pause_it_starts_over() -> None:
    pose_filter, root_m = PoseNoiseFilter(1), np.zeros(3)
    for time_s, angle_rad in zip(TIMES_S, 2.0 * TIMES_S, strict=True):
        pose_filter.step(time_s, rot.from_rotation_vector(np.array([[0.0, angle_rad, 0.0]])), root_m)
    back = rot.from_rotation_vector(np.array([[0.0, 0.1 + 2.0 * TIMES_S[-1], 0.0]]))
    shown, _ = pose_filter.step(TIMES_S[-1] + 2.0, back, root_m)
    np.testing.assert_allclose(np.abs(np.sum(shown * back)), 1.0, atol=1e-9)
