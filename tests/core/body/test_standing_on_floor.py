"""Feet on the floor: soles of the performer, and motions that are put on their floor."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.body_size import SOLE_BELOW_TOES_M, standing_root_m
from perfanim.core.body.calibration_poses import standing
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.moved_feet import floor_height_m, hold_planted, sole_heights
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.body.standing_feet import balls_m, planted_feet
from perfanim.core.body.standing_on_floor import on_floor
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry import rotations as rot
from perfanim.core.system.assets import MOTION

NEAR_M = 0.005  # required: soles of standing feet


def clip(name: str, frames: int = 180) -> Motion:
    return sliced(read_motion(MOTION / f"{name}.bvh"), 0, frames)


def raised(motion: Motion, height_m: np.ndarray | float) -> Motion:
    return replace(motion, root_positions_m=motion.root_positions_m + np.multiply.outer(height_m, [0.0, 1.0, 0.0]))


def test_a_standing_person_has_flat_soles() -> None:
    skeleton = default_skeleton()
    rotations = standing(skeleton)
    positions, _ = forward_kinematics(skeleton, rotations, standing_root_m(skeleton))
    ball = positions[skeleton.index("ltoes"), 1]
    still = Motion("still", 60.0, skeleton, rotations[None], standing_root_m(skeleton)[None])
    assert np.allclose(sole_heights(still), ball - SOLE_BELOW_TOES_M, atol=1e-9)


def test_a_pitched_foot_stands_on_its_toes_and_a_raised_one_on_its_heel() -> None:
    skeleton = default_skeleton()
    ankle = skeleton.index("lfoot")
    lowest = []
    for pitch_deg in (-20.0, 0.0, 30.0):
        rotations = standing(skeleton)
        pitch = rot.from_rotation_vector(np.radians([pitch_deg, 0.0, 0.0]))
        rotations[ankle] = rot.multiply(rot.multiply(rot.conjugate(rotations[ankle - 2]), pitch), rotations[ankle - 2])
        still = Motion("still", 60.0, skeleton, rotations[None], np.zeros((1, 3)))
        positions, _ = forward_kinematics(skeleton, rotations, np.zeros(3))
        lowest.append(float(positions[ankle, 1] - sole_heights(still)[0, 0]))
    assert lowest[0] > lowest[1] - 0.002 and lowest[2] > lowest[1] + 0.05


@pytest.mark.parametrize("name", ["walking-01-neutral", "boxing-01-neutral"])
def test_a_floating_and_wavering_take_is_put_on_the_floor(name: str) -> None:
    motion = clip(name)
    wavers = 0.12 + 0.01 * np.sin(np.arange(motion.frames) / 25.0)
    placed = on_floor(raised(motion, wavers))
    stands = planted_feet(placed, 0.0)
    assert stands.mean() > 0.3
    assert np.abs(sole_heights(placed)[stands]).max() < NEAR_M
    assert sole_heights(placed).min() > -NEAR_M
    assert sole_heights(placed).min(axis=1).max() < NEAR_M  # neither clip flies


def test_a_treadmill_does_not_float() -> None:
    """The feet of a walk on a belt are never slow; the whole take is moved, and its feet touch the floor."""
    motion = clip("walking-01-neutral")
    belt = raised(motion, 0.15)
    roots = belt.root_positions_m.copy()
    roots[:, [0, 2]] -= np.arange(motion.frames)[:, None] * (roots[-1] - roots[0])[[0, 2]] / (motion.frames - 1)
    placed = on_floor(replace(belt, root_positions_m=roots))
    assert np.abs(sole_heights(placed).min(axis=1)).max() < NEAR_M


def test_a_jump_stays_a_jump() -> None:
    motion = clip("walking-01-neutral", 120)
    flight = 0.4 * np.clip(np.sin((np.arange(120) - 40) * np.pi / 40), 0.0, None) * (np.arange(120) < 80)
    high = sole_heights(on_floor(raised(motion, flight))).min(axis=1)
    assert high.max() == pytest.approx(flight.max(), abs=0.02)


def test_known_floors_are_kept() -> None:
    motion = clip("walking-01-neutral", 60)
    lifted = on_floor(raised(motion, 0.5), floor_m=floor_height_m(motion))
    assert np.allclose(lifted.root_positions_m[:, 1].mean() - motion.root_positions_m[:, 1].mean(), 0.5, atol=0.01)


def test_standing_feet_that_glide_are_held() -> None:
    motion = clip("walking-01-neutral")
    stands = planted_feet(motion, floor_height_m(motion))
    glide = replace(motion, root_positions_m=motion.root_positions_m + np.arange(180)[:, None] * [0.0005, 0.0, 0.0])
    moved = []
    for each in (glide, hold_planted(glide, stands)):
        steps = np.linalg.norm(np.diff(balls_m(each), axis=0)[..., [0, 2]], axis=-1)
        moved.append(float(steps[stands[1:] & stands[:-1]].max()))
    assert moved[0] > 0.0004
    assert moved[1] < 1e-5
