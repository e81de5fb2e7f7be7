import numpy as np
import pytest
from perfanim.core.errors import CalibrationError
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.vision.calibration.floor_watch import FLOOR, FloorWatch, scaled_to

NOISE_M = 0.001
FPS = 20.0
FLOOR_M = np.array([[-0.5, 0.0, 0.8], [0.5, 0.0, 0.9], [0.4, 0.0, 0.2], [-0.4, 0.0, 0.1]])


def watched(moments):
    watch, advice = FloorWatch(), []
    for number, points in enumerate(moments):
        watch.see(number / FPS, np.asarray(points, dtype=np.float64).reshape(-1, 3))
        advice.append(watch.advice)
        if watch.points_m is not None:
            break
    return watch, advice


def lying(points, seconds, generator):
    for _ in range(round(seconds * FPS)):
        noisy = points + generator.normal(scale=NOISE_M, size=points.shape)
        yield generator.permutation(noisy)


def test_still_markers_are_averaged_in_any_order():
    watch, advice = watched(lying(FLOOR_M, 2.0, np.random.default_rng(0)))
    assert advice[0] == advice[-2] == "let them lie still"
    assert len(advice) / FPS == pytest.approx(FLOOR.still_s, abs=2.0 / FPS)
    nearest = np.linalg.norm(watch.points_m[:, None] - FLOOR_M, axis=2)
    assert sorted(nearest.argmin(axis=1)) == [0, 1, 2, 3]
    assert nearest.min(axis=1).max() < 5.0 * NOISE_M / np.sqrt(FLOOR.still_s * FPS)


def test_advice_names_missing_markers_and_motion():
    generator = np.random.default_rng(1)
    carried = [FLOOR_M + np.array([0.0, 0.5 - 0.02 * step, 0.0]) for step in range(25)]
    moments = [FLOOR_M[:0], FLOOR_M[:2], *carried, *lying(FLOOR_M, 2.0, generator)]
    watch, advice = watched(moments)
    assert advice[0].startswith("lay 3 or more markers on the floor")
    assert advice[1].endswith("2 located")
    assert set(advice[3:27]) == {"let them lie still"}
    assert np.abs(watch.points_m[:, 1]).max() < 5.0 * NOISE_M  # nothing of the way down is in the mean


@pytest.mark.parametrize("points", [FLOOR_M * 0.1, FLOOR_M * [1.0, 0.0, 0.05]])
def test_markers_in_one_place_or_on_a_line_are_refused(points):
    watch, advice = watched(lying(points, 3.0, np.random.default_rng(2)))
    assert watch.points_m is None
    assert "lay them further apart, not on one line" in advice


def test_rig_is_scaled_to_a_measured_distance():
    rig = default_rig()
    longest_m = float(np.linalg.norm(FLOOR_M[1] - FLOOR_M[3]))
    scaled, points, factor = scaled_to(rig, FLOOR_M, 2.0 * longest_m)
    assert factor == pytest.approx(2.0)
    assert scaled.baseline_m(0, 1) == pytest.approx(2.0 * rig.baseline_m(0, 1))
    assert scaled.metadata == rig.metadata
    pixels = [each.cameras[0].project(where) for each, where in ((rig, FLOOR_M), (scaled, points))]
    np.testing.assert_allclose(*pixels, atol=1e-6)


@pytest.mark.parametrize("longest_m", [0.0, -1.0, float("nan"), float("inf")])
def test_impossible_distance_is_refused(longest_m):
    with pytest.raises(CalibrationError, match=r"markers cannot be .* m apart"):
        scaled_to(CameraRig(default_rig().cameras), FLOOR_M, longest_m)
