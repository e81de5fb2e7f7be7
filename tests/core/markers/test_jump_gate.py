"""Doubt about markers that jump, in the smoother of live markers."""

import numpy as np
import pytest
from perfanim.core.markers.jump_gate import Carried
from perfanim.core.markers.marker_set import PointKind
from perfanim.core.markers.marker_smoothing import MarkerSmoother
from perfanim.core.markers.source_noise import noise_of

FPS, MARKERS = 60.0, 5
WALK_M = 1.2 / FPS * np.arange(90)[:, None, None] * np.array([1.0, 0.0, 0.0])
UNKNOWN = np.full((MARKERS, 3), np.nan)


def walking(noise_m: float = 0.001) -> np.ndarray:
    """Markers (F, M, 3) of a body that walks, a metre apart."""
    apart = np.arange(MARKERS)[:, None] * np.array([0.0, 1.0, 0.0])
    return apart + WALK_M + np.random.default_rng(1).normal(0.0, noise_m, (90, MARKERS, 3))


def passed(points: np.ndarray, carried_m: np.ndarray = UNKNOWN) -> tuple[np.ndarray, np.ndarray]:
    """Return smoothed markers (F, M, 3) and the doubted ones (F, M)."""
    smoother = MarkerSmoother(MARKERS, noise_of(PointKind.MARKERS))
    frames = [smoother.step(number / FPS, row, Carried(carried_m)) for number, row in enumerate(points)]
    return np.array([frame.points_m for frame in frames]), np.array([frame.believed.doubted for frame in frames])


@pytest.mark.parametrize("away_m", [0.05, 0.17])
def test_a_wild_point_of_one_frame_moves_nothing(away_m: float) -> None:
    points = walking()
    points[40, 2] += [0.0, 0.0, away_m]
    found, doubted = passed(points)
    assert np.argwhere(doubted).tolist() == [[40, 2]]
    assert np.linalg.norm(found[38:44] - walking()[38:44], axis=-1).max() < 0.01


def test_a_jump_that_lasts_is_believed_in_the_next_frame() -> None:
    points = walking()
    points[40:, 2] += [0.0, 0.0, 0.2]
    found, doubted = passed(points)
    assert np.argwhere(doubted).tolist() == [[40, 2]]
    assert np.linalg.norm(found[41:, 2] - points[41:, 2], axis=-1).max() < 0.01


def test_a_cut_is_believed_at_once() -> None:
    points = walking()
    points[40:] += [0.5, 0.0, 0.0]
    found, doubted = passed(points)
    assert not doubted.any()
    assert np.linalg.norm(found[40:] - points[40:], axis=-1).max() < 0.02


def test_noise_is_not_doubted() -> None:
    assert not passed(walking(0.003))[1].any()


def test_torso_marker_is_doubted_where_the_body_cannot_carry_it() -> None:
    """A marker without a motion of its own, because it was hidden for long, returns 15 cm off."""
    points = walking()
    points[20:60, 2] = np.nan
    points[60, 2] += [0.0, 0.0, 0.15]
    carried = UNKNOWN.copy()
    carried[2] = walking(0.0)[60, 2]
    assert not passed(points)[1].any()
    smoother = MarkerSmoother(MARKERS, noise_of(PointKind.MARKERS))
    for number in range(60):
        smoother.step(number / FPS, points[number], Carried(UNKNOWN))
    assert smoother.step(60 / FPS, points[60], Carried(carried)).believed.doubted.tolist() == [
        False,
        False,
        True,
        False,
        False,
    ]


@pytest.mark.parametrize("frames", [1, 15])
def test_exchanged_labels_are_put_back(frames: int) -> None:
    points = walking()
    points[40 : 40 + frames, [1, 3]] = points[40 : 40 + frames, [3, 1]]
    found, doubted = passed(points)
    assert not doubted.any()
    assert np.linalg.norm(found - walking(), axis=-1).max() < 0.01


@pytest.mark.parametrize(("nearness", "believed"), [(np.nan, True), (0.9, True), (1.1, False)])
def test_labels_that_stay_exchanged_are_believed_unless_they_contradict_the_body(
    nearness: float, believed: bool
) -> None:
    """The first ones may have been wrong."""
    points = walking()
    points[30:, [1, 3]] = points[30:, [3, 1]]
    smoother, carried = MarkerSmoother(MARKERS, noise_of(PointKind.MARKERS)), Carried(UNKNOWN, lambda *_: nearness)
    found = np.array([smoother.step(number / FPS, row, carried).points_m for number, row in enumerate(points)])
    true = points if believed else walking()
    assert np.linalg.norm(found[62:] - true[62:], axis=-1).max() < 0.01


def test_sides_are_put_back_and_a_performer_elsewhere_is_not() -> None:
    points = walking()
    points[40:50] = points[40:50][:, [3, 4, 2, 0, 1]]
    found, doubted = passed(points)
    assert not doubted.any()
    assert np.linalg.norm(found - walking(), axis=-1).max() < 0.01


def test_two_wild_points_in_a_row_move_nothing() -> None:
    points = walking()
    points[40, 2] += [0.0, 0.0, 0.15]
    points[41, 2] += [0.12, 0.0, -0.05]
    found, doubted = passed(points)
    assert np.argwhere(doubted).tolist() == [[40, 2], [41, 2]]
    assert np.linalg.norm(found - walking(), axis=-1).max() < 0.01


def test_a_marker_that_keeps_jumping_is_believed_after_some_frames() -> None:
    points, generator = walking(), np.random.default_rng(3)
    points[40:, 2] += generator.uniform(-0.3, 0.3, (50, 3))
    assert 3 <= passed(points)[1][40:, 2].sum() < 40


def test_an_exchange_of_noisy_points_is_corrected_while_it_lasts() -> None:
    """The markers turn round meanwhile, so their predictions miss now and then."""
    times = np.arange(90)[:, None] / FPS
    points = walking(0.006)
    points[:, [1, 3], 2] += 0.3 * np.sin(2.0 * np.pi * 2.0 * times)
    true = points.copy()
    points[40:60, [1, 3]] = points[40:60, [3, 1]]
    found, _ = passed(points)
    assert np.linalg.norm(found - true, axis=-1)[40:60].max() < 0.05


def test_labels_that_look_like_a_body_only_as_given_are_kept() -> None:
    points = walking()
    points[:40, [1, 3]] = points[:40, [3, 1]]
    smoother, asked = MarkerSmoother(MARKERS, noise_of(PointKind.MARKERS)), []

    def as_given(given_m: np.ndarray, corrected_m: np.ndarray) -> float:
        asked.append((given_m, corrected_m.copy()))
        return 0.5

    frames = [smoother.step(number / FPS, row, Carried(UNKNOWN, as_given)) for number, row in enumerate(points)]
    assert not any(frame.believed.exchanged.any() for frame in frames)
    assert np.linalg.norm(frames[42].points_m - points[42], axis=-1).max() < 0.01
    np.testing.assert_array_equal(asked[0][0], points[40])
    np.testing.assert_array_equal(asked[0][1], points[40][[0, 3, 2, 1, 4]])
