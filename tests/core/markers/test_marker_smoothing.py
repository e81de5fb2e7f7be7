import numpy as np
import pytest
from perfanim.core.markers.marker_set import PointKind
from perfanim.core.markers.marker_smoothing import MarkerSmoother, smooth_markers
from perfanim.core.markers.source_noise import noise_of

EXACT, KEYPOINTS = noise_of(PointKind.MARKERS), noise_of(PointKind.KEYPOINTS)
FPS = 60.0
TIMES_S = np.arange(240) / FPS
SETTLED = slice(30, None)
STILL, ARM, PUNCH = range(3)
PUNCHED_S, PUNCH_S = 2.0, 0.15


def moving() -> np.ndarray:
    """A marker that stands, one of an arm that swings, one of a fist (F, 3, 3)."""
    phase = 2.0 * np.pi * TIMES_S
    arm = 0.3 * np.stack((np.sin(phase), np.cos(phase), np.zeros_like(phase)), axis=-1)
    way = np.clip((TIMES_S - PUNCHED_S) / PUNCH_S, 0.0, 1.0)
    fist = np.stack((0.5 * way**3 * (10.0 - 15.0 * way + 6.0 * way**2), *np.zeros((2, len(way)))), axis=-1)
    return np.stack((np.broadcast_to([0.1, 1.0, 0.2], arm.shape), arm, fist), axis=1)


def noisy(noise_m: float, seed: int = 0) -> np.ndarray:
    return moving() + np.random.default_rng(seed).normal(0.0, noise_m, moving().shape)


def smoothed(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    smoother = MarkerSmoother(points.shape[1], EXACT)
    frames = [smoother.step(*frame) for frame in zip(TIMES_S, points, strict=True)]
    return np.array([frame[0] for frame in frames]), np.array([frame[1] for frame in frames])


def rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(values[SETTLED] ** 2, axis=(0, 2)))


def test_exact_markers_are_unchanged():
    errors = rms(smoothed(moving())[0] - moving())
    assert errors[:PUNCH].max() < 1e-4
    assert errors[PUNCH] < 6e-4  # it starts within a frame


@pytest.mark.parametrize("noise_m", [0.001, 0.003])
def test_noise_is_reduced_without_lag(noise_m):
    points = noisy(noise_m)
    found, deviations = smoothed(points)
    errors = rms(found - moving())
    assert errors[STILL] < 0.65 * noise_m
    assert np.all(errors < noise_m)
    steps = np.abs(np.diff(found, 3, axis=0)), np.abs(np.diff(points, 3, axis=0))
    assert steps[0][SETTLED, STILL].mean() < 0.3 * steps[1][SETTLED, STILL].mean()
    # the part of the error along the way, as a time
    velocity = np.gradient(moving()[:, ARM], 1.0 / FPS, axis=0)
    late_s = -np.sum((found - moving())[SETTLED, ARM] * velocity[SETTLED]) / np.sum(velocity[SETTLED] ** 2)
    assert abs(late_s) < 0.002
    np.testing.assert_allclose(np.median(deviations[SETTLED], axis=0)[:PUNCH], errors[:PUNCH], rtol=0.5)


def test_take_is_smoothed_in_both_directions():
    points = noisy(0.003)
    live, both = smoothed(points)[0], smooth_markers(TIMES_S, points, EXACT)[0]
    assert np.all(rms(both - moving())[:PUNCH] < 0.9 * rms(live - moving())[:PUNCH])
    assert rms(both - moving())[PUNCH] < rms(live - moving())[PUNCH]


def test_jumping_or_returning_marker_is_not_delayed():
    points = noisy(0.001)
    points[100:, STILL] += [0.4, 0.0, 0.0]
    points[60:120, ARM] = np.nan
    for found in (smoothed(points)[0], smooth_markers(TIMES_S, points, EXACT)[0]):
        assert not np.isnan(found[~np.isnan(points)]).any()
        assert np.isnan(found[75:105, ARM]).all()
        assert np.nanmax(np.abs(found[98:103, STILL] - points[98:103, STILL])) < 0.005
        assert np.abs(found[120:125, ARM] - points[120:125, ARM]).max() < 0.01
        away = np.linalg.norm(found - points, axis=-1)
        assert np.nanmax(away) < 0.02


def test_briefly_hidden_smoothed_marker_is_extrapolated():
    points = noisy(0.001)
    points[60:66, [STILL, ARM]] = np.nan
    (live, sigmas), (both, closer) = smoothed(points), smooth_markers(TIMES_S, points, EXACT)
    hidden = np.s_[60:66, [STILL, ARM]]
    for found, deviations in ((live, sigmas), (both, closer)):
        away = np.linalg.norm(found - moving(), axis=-1) / np.sqrt(3.0)
        assert np.all(away[hidden] < 3.0 * deviations[hidden])
        assert deviations[59, ARM] < deviations[61, ARM]
    assert np.all(np.diff(sigmas[59:66, ARM]) > 0.0)
    assert np.all(closer[hidden] < sigmas[hidden])
    off_live, off_both = (np.linalg.norm(found - moving(), axis=-1)[hidden].max() for found in (live, both))
    assert off_both < 0.7 * off_live
    points[60:90, ARM] = np.nan
    for found, deviations in (smoothed(points), smooth_markers(TIMES_S, points, EXACT)):
        known = np.isfinite(found[60:90, ARM, 0])
        assert known[0] and not known[15]
        assert deviations[60:90, ARM][known].max() < 0.1


def test_hidden_markers_are_dropped_after_a_cut():
    points = noisy(0.001)
    points[60:] += 1.0
    points[60:64, ARM] = np.nan
    live, (both, deviations) = smoothed(points)[0], smooth_markers(TIMES_S, points, EXACT)
    assert np.isnan(live[60:64, ARM]).all()
    away = np.linalg.norm(both - moving() - 1.0, axis=-1) / np.sqrt(3.0)  # it is known by what follows
    assert np.all(away[60:64, ARM] < 3.0 * deviations[60:64, ARM])
    for found in (live, both):
        np.testing.assert_allclose(found[60:64, STILL], points[60:64, STILL], atol=0.005)


def test_long_steps_and_empty_frames():
    smoother = MarkerSmoother(2, EXACT)
    for time_s in (1e6, 1e6 + 0.01, 1e9):
        found, deviations, _ = smoother.step(time_s, np.array([[1.0, 2.0, 3.0], [np.nan] * 3]))
        np.testing.assert_allclose(found[0], [1.0, 2.0, 3.0], atol=1e-6)
        assert np.all(np.isnan(found[1]))
        assert np.all(np.isfinite(deviations))


def test_lasting_errors_of_keypoints_stay_and_are_counted():
    points = np.add(noisy(0.012), [0.0, 0.03, 0.0])
    exact, (found, deviations) = smooth_markers(TIMES_S, points, EXACT)[0], smooth_markers(TIMES_S, points, KEYPOINTS)
    assert deviations.min() >= KEYPOINTS.lasting_m
    wanted = np.add(moving(), [0.0, 0.03, 0.0])
    assert rms(found - wanted)[STILL] < 0.8 * rms(exact - wanted)[STILL]  # their noise is above that of any marker
    np.testing.assert_allclose(found[SETTLED, STILL].mean(axis=0), wanted[0, STILL], atol=0.003)


@pytest.mark.parametrize("feet", [True, False])
def test_hidden_marker_of_a_standing_foot_stays(feet):
    points = noisy(0.001)
    points[100:114, [STILL, ARM]] = np.nan
    smoother = MarkerSmoother(points.shape[1], EXACT, feet=np.full(points.shape[1], feet))
    frames = [smoother.step(*frame) for frame in zip(TIMES_S, points, strict=True)]
    found, deviations = (np.array([frame[part] for frame in frames]) for part in (0, 1))
    assert np.isnan(found[113, ARM]).all()  # it moved when it was last seen
    if feet:
        assert np.abs(found[100:114, STILL] - moving()[100:114, STILL]).max() < 0.003
        assert deviations[100:114, STILL].max() < 0.01
    else:
        assert np.isnan(found[113, STILL]).all() or deviations[113, STILL] > 0.02


def test_foot_that_stays_hidden_is_given_up():
    points = np.broadcast_to([0.1, 0.05, 0.2], (240, 1, 3)).copy()
    points[100:] = np.nan
    smoother = MarkerSmoother(1, EXACT, feet=np.ones(1, dtype=bool))
    found = np.array([smoother.step(*frame).points_m for frame in zip(TIMES_S, points, strict=True)])
    assert np.isfinite(found[113]).all() and np.isnan(found[117]).all()
