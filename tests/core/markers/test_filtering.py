import numpy as np
import pytest
from perfanim.core.body.motion import Motion
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import SettingsError
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.filtering import smooth_motion, smooth_take
from perfanim.core.markers.marker_take import MarkerTake

FPS = 60.0
TIMES = np.arange(240) / FPS


def wave(hertz: float) -> np.ndarray:
    """A marker (F, 1, 3) that swings along x."""
    result = np.zeros((len(TIMES), 1, 3))
    result[:, 0, 0] = np.sin(2.0 * np.pi * hertz * TIMES)
    return result


def amplitude(take: MarkerTake) -> float:
    """Half the swing along x away from the ends."""
    return float(np.ptp(take.positions_m[60:180, 0, 0]) / 2.0)


def test_low_pass_removes_noise_without_lag():
    slow = smooth_take(MarkerTake("slow", FPS, ("A",), wave(1.0)), 6.0)
    np.testing.assert_allclose(slow.positions_m[30:-30], wave(1.0)[30:-30], atol=0.002)
    assert amplitude(smooth_take(MarkerTake("edge", FPS, ("A",), wave(6.0)), 6.0)) == pytest.approx(
        np.sqrt(0.5), abs=0.02
    )
    assert amplitude(smooth_take(MarkerTake("fast", FPS, ("A",), wave(20.0)), 6.0)) < 0.01


def test_gaps_and_short_stretches_are_unchanged():
    positions = wave(20.0)
    positions[100:110] = np.nan
    positions[115:] = np.nan  # five frames stand alone
    result = smooth_take(MarkerTake("gaps", FPS, ("A",), positions), 6.0).positions_m
    np.testing.assert_array_equal(np.isnan(result), np.isnan(positions))
    np.testing.assert_array_equal(result[110:115], positions[110:115])
    assert np.ptp(result[30:70, 0, 0]) < 0.1


def test_frequencies_above_nyquist_are_refused():
    take = MarkerTake("take", FPS, ("A",), wave(1.0))
    for cutoff in (0.0, -1.0, 30.0, float("nan")):
        with pytest.raises(SettingsError, match="out of range"):
            smooth_take(take, cutoff)
    assert smooth_take(take, 29.0) is not None  # above what the filter's single pass can do: left alone


def test_motion_is_smoothed_for_any_quaternion_signs():
    skeleton = default_skeleton()
    generator = np.random.default_rng(1)
    turn = np.zeros((len(TIMES), len(skeleton), 3))
    turn[..., 0] = 1.2 * np.sin(2.0 * np.pi * 0.5 * TIMES)[:, None]
    clean = rot.from_rotation_vector(turn)
    noisy = rot.multiply(clean, rot.from_rotation_vector(generator.normal(0.0, 0.05, turn.shape)))
    noisy *= np.where(generator.random(noisy.shape[:2]) < 0.5, -1.0, 1.0)[..., None]
    motion = Motion("noisy", FPS, skeleton, noisy, np.zeros((len(TIMES), 3)))
    result = smooth_motion(motion, 5.0)
    before = rot.angle_between(noisy, clean)[30:-30].mean()
    after = rot.angle_between(result.rotations, clean)[30:-30].mean()
    assert after < 0.55 * before  # white noise at 30 Hz bandwidth cut to about 6 Hz: sqrt(6 / 30) = 0.45
    np.testing.assert_allclose(np.linalg.norm(result.rotations, axis=-1), 1.0, atol=1e-12)


@pytest.mark.parametrize(("frames", "fps", "cutoff_hz"), [(10, 60.0, 8.0), (300, 120.0, 6.0), (240, 60.0, 16.0)])
def test_the_filter_is_scipys_butterworth_run_both_ways(frames: int, fps: float, cutoff_hz: float):
    from scipy.signal import butter, sosfiltfilt  # a second to import, in every process that collects tests

    path = 50.0 + np.cumsum(np.random.default_rng(0).standard_normal((frames, 2, 3)), axis=0)
    # half the power after two passes
    sections = butter(2, cutoff_hz / (np.sqrt(2.0) - 1.0) ** 0.25, fs=fps, output="sos")
    result = smooth_take(MarkerTake("path", fps, ("A", "B"), path), cutoff_hz).positions_m
    np.testing.assert_allclose(result, sosfiltfilt(sections, path, axis=0), atol=1e-10)
