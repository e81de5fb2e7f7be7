import numpy as np
from perfanim.core.body.standard_skeleton import JOINT_NAMES
from perfanim.core.geometry import rotations as rot
from perfanim.core.session.pose_noise_filter import PoseNoiseFilter

FPS = 60.0
TIMES_S = np.arange(240) / FPS
NOISE_RAD, NOISE_M = 0.01, 0.003
ARM, SHIN = JOINT_NAMES.index("lhumerus"), JOINT_NAMES.index("ltibia")
SETTLED = 60  # frames after which the noise is known


def filtered(rotations: np.ndarray, root_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    pose_filter = PoseNoiseFilter()
    found = [pose_filter.step(time_s, *pose) for time_s, *pose in zip(TIMES_S, rotations, root_m, strict=True)]
    return np.array([pose[0] for pose in found]), np.array([pose[1] for pose in found])


def turning(angles_rad: np.ndarray) -> np.ndarray:
    """Return rotations (F, J, 4) of a body with one arm that turns about y."""
    vectors = np.zeros((len(angles_rad), len(JOINT_NAMES), 3))
    vectors[:, ARM, 1] = angles_rad
    return rot.from_rotation_vector(vectors)


def trembling(rotations: np.ndarray) -> float:
    """Return the mean third difference of a joint's rotations (F, 4), rad."""
    turned = rot.to_rotation_vector(rot.multiply(rot.conjugate(rotations[:-1]), rotations[1:]))
    return float(np.linalg.norm(np.diff(turned, 2, axis=0), axis=-1).mean())


def test_jitter_of_a_still_body_is_removed() -> None:
    chance = np.random.default_rng(0)
    still = turning(np.full(len(TIMES_S), 0.7))
    noisy = rot.multiply(still, rot.from_rotation_vector(chance.normal(0.0, NOISE_RAD, (*still.shape[:2], 3))))
    places_m = chance.normal(0.0, NOISE_M, (len(TIMES_S), 3))
    shown, shown_m = filtered(noisy, places_m)
    arm, shin = (trembling(shown[SETTLED:, joint]) / trembling(noisy[SETTLED:, joint]) for joint in (ARM, SHIN))
    assert arm < 0.3
    assert arm < shin < 0.6  # a leg that is held as closely slides where it lands
    assert rot.angle_between(shown, still)[SETTLED:].mean() < 0.7 * rot.angle_between(noisy, still)[SETTLED:].mean()
    assert np.linalg.norm(shown_m[SETTLED:], axis=1).mean() < 0.7 * np.linalg.norm(places_m[SETTLED:], axis=1).mean()


def test_fast_motion_without_noise_is_not_delayed() -> None:
    """An arm that swings by a radian twice a second, and a body that turns round and round."""
    for angles_rad in (np.sin(2.0 * np.pi * 2.0 * TIMES_S), 8.0 * TIMES_S):
        truth = turning(angles_rad)
        place_m = np.stack((angles_rad, np.zeros_like(angles_rad), angles_rad), axis=1) * 0.1
        shown, shown_m = filtered(truth, place_m)
        assert np.degrees(rot.angle_between(shown, truth)).max() < 0.1
        assert np.linalg.norm(shown_m - place_m, axis=1).max() < 0.001


def test_sudden_turn_has_no_delay_and_no_overshoot() -> None:
    truth = turning(np.where(TIMES_S < 2.0, 0.0, 0.6))
    place_m = np.where(TIMES_S < 2.0, 0.0, 0.5)[:, None] * np.ones(3)
    shown, shown_m = filtered(truth, place_m)
    np.testing.assert_allclose(np.abs(np.sum(shown * truth, axis=-1)), 1.0, atol=1e-6)
    np.testing.assert_allclose(shown_m, place_m, atol=1e-6)


def test_filter_restarts_after_a_pause() -> None:
    pose_filter, root_m = PoseNoiseFilter(), np.zeros(3)
    for time_s, rotations in zip(TIMES_S, turning(2.0 * TIMES_S), strict=True):
        pose_filter.step(time_s, rotations, root_m)
    back = turning(np.array([0.1 + 2.0 * TIMES_S[-1]]))[0]
    shown, _ = pose_filter.step(TIMES_S[-1] + 2.0, back, root_m)
    np.testing.assert_allclose(np.abs(np.sum(shown * back, axis=-1)), 1.0, atol=1e-9)


def test_filter_does_not_increase_rotation_rates() -> None:
    """A limb in trembling poses that begins to turn at the greatest speed at once, as limited poses do."""
    chance = np.random.default_rng(1)
    most = np.radians(9.0)
    turns = np.clip(np.where((TIMES_S % 1.0) < 0.15, 1.0, chance.normal(0.0, 0.3, len(TIMES_S))), -1.0, 1.0) * most
    truth = turning(np.cumsum(turns))
    shown, _ = filtered(truth, np.zeros((len(TIMES_S), 3)))
    turned = rot.angle_between(shown[:-1, ARM], shown[1:, ARM])
    assert np.all(turned <= np.maximum(np.abs(turns[1:]), np.radians(2.1)) + 1e-9)
