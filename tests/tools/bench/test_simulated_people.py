"""Simulated films of a person for the benchmark: errors, exchanged limbs, and limbs on the other side."""

from dataclasses import replace

import numpy as np
import pytest
from bench import simulated_people
from bench.rendered_person import in_the_middle, two_cameras
from perfanim.core.body.motion import sliced
from perfanim.core.simulate.shipped_performance import performance
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.vision.people.people_pipeline import PersonLocator

SETTINGS = simulated_people.FilmSettings()


@pytest.fixture(scope="module")
def walk():
    return in_the_middle(sliced(performance("walking", 12.0, SETTINGS.fps), 60, 360))


@pytest.fixture(scope="module")
def filmed(walk):
    rig = two_cameras(6.0)
    return rig, *simulated_people.film(walk, rig, np.random.default_rng(1))


def test_a_fifth_of_one_camera_s_pictures_show_limbs_exchanged(filmed):
    _, frames, right = filmed
    exchanged = (right != np.arange(right.shape[2])).any(axis=2)
    shares = sorted(exchanged.mean(axis=0))
    assert shares[0] == 0.0 and SETTINGS.exchanged <= shares[1] < SETTINGS.exchanged + 0.05
    missing = np.mean([[rows[:, 3] == 0.0 for rows in frame.blobs] for frame in frames])
    assert missing == pytest.approx(SETTINGS.missing, abs=0.01)


def test_points_that_are_put_right_lie_about_their_true_places(walk, filmed):
    rig, frames, right = filmed
    true = simulate_markers(walk, simulated_people._POINTS)[0].positions_m
    far_m = [np.linalg.norm(camera.to_camera(true.mean(axis=1)), axis=-1) for camera in rig.cameras]
    for c, camera in enumerate(rig.cameras):
        pixels = np.array([frame.blobs[c][rows[c], :2] for frame, rows in zip(frames, right, strict=True)])
        off_m = (pixels - camera.project(true)) * (far_m[c] / camera.focal_px)[:, None, None]
        assert np.std(off_m) == pytest.approx(np.hypot(0.030 / np.sqrt(3.0), 0.006), rel=0.15)


def test_wrong_rows_are_counted_and_right_ones_are_not(filmed):
    rig, frames, right = filmed
    found = PersonLocator(rig, simulated_people._POINTS).locate_all(frames)
    wrong = simulated_people._misplaced(found, right)
    assert wrong.mean() < 0.1  # most exchanges are put right
    as_given = np.tile(np.arange(right.shape[2]), (*right.shape[:2], 1))
    told = simulated_people._counted(simulated_people._misplaced(found, as_given))
    assert told["frames"] == len(frames) and told["exchanged"] > 0.15 * len(frames)


def test_limbs_nearer_to_the_other_side_are_counted(walk):
    assert not simulated_people.crossed_limbs(walk, walk).any()
    legs = [walk.skeleton.index(side + "femur") for side in "lr"]
    turned = walk.rotations.copy()
    turned[:, legs] = turned[:, legs[::-1]]
    crossed = simulated_people.crossed_limbs(replace(walk, rotations=turned), walk)
    assert not crossed[:, 0].any() and crossed.shape == (walk.frames, 2)
    assert simulated_people._counted(np.array([False, True, True, True, True, False, True])) == {
        "frames": 7, "exchanged": 5, "exchanged_long": 4
    }  # fmt: skip
