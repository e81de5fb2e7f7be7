"""Motions that continue each other, and cycles of walks."""

import logging
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from perfanim.core.body.looping import looped, repeated
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.moved_feet import floor_height_m, hold_planted
from perfanim.core.body.seams import continued, heading
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standing_feet import balls_m, planted_feet
from perfanim.core.errors import SettingsError
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry.arrays import runs
from perfanim.core.system.assets import MOTION
from scipy.ndimage import binary_erosion

LARGEST_RATIO = 1.5  # required: second differences across a seam over the takes' own
SLIDE_M = 0.005  # required: of standing feet
CLIPS = ("walking-01-neutral", "walking-02-energetic", "boxing-01-neutral", "kendo-02-neutral", "running-02-neutral")
BLEND_S = 0.8
LOG = logging.getLogger(__name__)


def clip(name: str) -> Motion:
    return hold_planted(sliced(read_motion(MOTION / f"{name}.bvh"), 0, 240))


def seconds(values: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(values, 2, axis=0).reshape(len(values) - 2, -1), axis=1)


def slide_m(motion: Motion, first: int, last: int) -> float:
    """Farthest way of a standing foot from the middle of its stand; its first and last frames apart."""
    stands = binary_erosion(planted_feet(motion, floor_height_m(motion)), np.ones((7, 1)))[first:last]
    balls, worst = balls_m(motion)[first:last][..., [0, 2]], 0.0
    for foot in range(2):
        for start, stop in runs(stands[:, foot]):
            way = balls[start:stop, foot] - np.median(balls[start:stop, foot], axis=0)
            worst = max(worst, float(np.linalg.norm(way, axis=1).max()))
    return worst


@pytest.mark.parametrize(("first", "second"), list(combinations(CLIPS, 2)))
def test_a_take_goes_on_where_another_ends(first: str, second: str) -> None:
    before, after = clip(first), clip(second)
    after = replace(after, skeleton=before.skeleton)
    end = continued(before, after, BLEND_S)
    joined = replace(
        before,
        rotations=np.concatenate((before.rotations[:-1], end.rotations)),
        root_positions_m=np.concatenate((before.root_positions_m[:-1], end.root_positions_m)),
    )
    seam, length = before.frames - 1, round(BLEND_S * before.fps)
    part = slice(seam - 2, seam + length + 2)
    ratios = []
    for of in (lambda m: m.root_positions_m, lambda m: np.unwrap(heading(m.rotations[:, 0]))[:, None]):
        own = max(seconds(of(before)).max(), seconds(of(after)).max())
        ratios.append(seconds(of(joined)[part]).max() / own)
    assert np.allclose(end.root_positions_m[0, [0, 2]], before.root_positions_m[-1, [0, 2]], atol=1e-9)
    own_slide_m = max(slide_m(before, 0, before.frames), slide_m(after, 0, after.frames))
    slid_m = slide_m(joined, seam - 2, seam + length + 2)
    LOG.info("root %.2f, heading %.2f; feet %.1f mm, own %.1f", *ratios, 1e3 * slid_m, 1e3 * own_slide_m)
    assert max(ratios) <= LARGEST_RATIO
    assert slid_m <= own_slide_m + SLIDE_M


def test_a_single_frame_cannot_be_continued() -> None:
    walk = clip("walking-01-neutral")
    with pytest.raises(SettingsError, match="one frame cannot be continued"):
        continued(sliced(walk, 0, 1), walk, BLEND_S)


@pytest.mark.parametrize("name", [path.stem for path in sorted(MOTION.glob("walking*.bvh"))[:5]])
def test_a_walk_is_looped_twenty_times_without_drift_or_pop(name: str) -> None:
    walk = read_motion(MOTION / f"{name}.bvh")
    cycle = looped(walk)
    length = cycle.frames - 1
    many = repeated(cycle, 20)
    assert np.allclose(heading(many.rotations[::length, 0]), heading(many.rotations[0, 0]), atol=1e-6)
    assert np.allclose(many.root_positions_m[::length, 1], many.root_positions_m[0, 1], atol=1e-9)
    ways = np.diff(many.root_positions_m[::length], axis=0)
    assert np.allclose(ways, ways[0], atol=1e-9)
    joints = [forward_kinematics(m.skeleton, m.rotations, m.root_positions_m)[0] for m in (many, walk)]
    pops = [np.linalg.norm(np.diff(each, 2, axis=0), axis=-1).max() for each in joints]
    slid_m = slide_m(many, 0, many.frames)
    LOG.info("second differences %.2f; feet %.1f mm", pops[0] / pops[1], 1e3 * slid_m)
    assert pops[0] <= LARGEST_RATIO * pops[1]
    assert slid_m <= SLIDE_M


def test_a_motion_without_a_cycle_says_so() -> None:
    walk = read_motion(MOTION / "walking-01-neutral.bvh")
    with pytest.raises(SettingsError, match="too short for a cycle"):
        looped(sliced(walk, 0, 20))
    still = replace(walk, rotations=walk.rotations[:1].repeat(300, axis=0), root_positions_m=np.zeros((300, 3)))
    with pytest.raises(SettingsError, match="no two moments"):
        looped(still)
