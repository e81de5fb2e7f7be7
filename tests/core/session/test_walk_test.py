"""A walk is judged by its figures, and the worst of them is what to mend."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.scene_pose import PerformerPose
from perfanim.core.geometry import rotations as rot
from perfanim.core.session.walk_test import WalkFigures, judge_walk, walk_figures

TEXTS = ("left hand",) * 9 + ("right hand",)
GOOD = WalkFigures(0.0, 60.0, np.array([0.02, 0.0]), 0.0004, 0.006, 0.99, 5.2)


@pytest.mark.parametrize(
    ("change", "verdict", "advice"),
    [
        ({}, "good, joints within about 5 degrees", "nothing needs to change"),
        ({"error_deg": float("nan")}, "good;", "nothing"),
        ({"lost": 0.06}, "usable", "6% of the images are lost"),
        ({"lost": 0.3}, "poor", "30% of the images are lost"),
        ({"fps": 15.0}, "usable", "only 15 images"),
        ({"hidden": np.array([0.0] * 9 + [0.4])}, "usable", "the marker right hand is hidden 40% of the time: turn"),
        ({"noise_m": 0.009}, "poor", "jitter by 9 mm"),
        ({"rms_m": 0.05}, "usable", "50 mm off the body: calibrate"),
        ({"rms_m": float("nan")}, "poor", "off the body"),
        ({"confidence": 0.5}, "usable", "unlike the database"),
        ({"confidence": 0.1}, "poor", "unlike the database"),
        ({"confidence": 0.1, "lost": 0.06}, "poor", "images are lost"),
        ({"hidden": np.array([0.2, 0.24])}, "poor", "markers are hidden 22% of the time: check light"),
        ({"confidence": 0.5, "lost": 0.06}, "usable", "images are lost"),  # which makes all else worse
    ],
)
def test_advice_is_on_the_worst_figure(change: dict, verdict: str, advice: str) -> None:
    sentence = judge_walk(replace(GOOD, **change), TEXTS)
    assert sentence.startswith(f"captures will be {verdict}")
    assert advice in sentence


def poses_of(seconds: float, fps: float = 30.0, noise_m: float = 0.001) -> list[PerformerPose]:
    rng = np.random.default_rng(0)
    poses = []
    for number in range(round(seconds * fps) + 1):
        markers_m = np.array([[0.0, 1.0, 0.0], [0.3, 1.0, 0.01 * number]])
        observed_m = markers_m + rng.normal(scale=noise_m, size=(2, 3))
        observed_m[1] = np.nan if number % 4 == 0 else observed_m[1]
        single = np.array([-1, 0 if number % 8 == 0 else -1])
        turns = rot.identity((3,))
        poses.append(
            PerformerPose(
                number, number / fps, turns, np.zeros(3), 0.9, markers_m, observed_m, single, 0.004,
                part_errors_deg=np.array([4.0, 8.0]),
            )
        )  # fmt: skip
    return poses


def test_walk_figures_summarise_the_poses() -> None:
    figures = walk_figures(poses_of(10.0), lost=100)
    assert figures is not None
    assert figures.lost == pytest.approx(100 / 401)
    assert figures.fps == pytest.approx(30.0)
    np.testing.assert_allclose(figures.hidden, [0.0, 0.125], atol=0.01)  # what one camera sees is not hidden
    assert figures.noise_m == pytest.approx(0.001, rel=0.2)
    assert (figures.rms_m, figures.confidence, figures.error_deg) == (0.004, 0.9, 6.0)


def test_a_short_walk_is_not_judged() -> None:
    assert walk_figures(poses_of(4.0), 0) is None
    assert walk_figures([], 0) is None
