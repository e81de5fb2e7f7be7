"""A walk between two standing poses: no sole sinks, and the feet are at rest at the first and the last key."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.calibration_poses import standing
from perfanim.core.body.motion import Motion
from perfanim.core.body.moved_feet import sole_heights
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standing_feet import STANDING, balls_m
from perfanim.core.sketch.above_floor import above_floor
from perfanim.core.sketch.sketch_file import Control, Sketch
from perfanim.core.sketch.solve_sketch import LIMITS, SketchSolver

FPS = 24.0


@pytest.fixture(scope="module")
def stance(truth):
    """Positions of the joints of a body that stands on the floor."""
    rotations = standing(truth.skeleton)
    pose = Motion("stance", FPS, truth.skeleton, rotations[None], np.zeros((1, 3)))
    positions, _ = forward_kinematics(truth.skeleton, rotations, np.zeros(3))
    return positions - [0.0, sole_heights(pose).min(), 0.0]


@pytest.fixture(scope="module")
def solver(truth, database):
    return SketchSolver(truth.skeleton, database)


def six_keys(skeleton, stance, way_m, frames, up_m=0.0):
    """Hips and feet of a standing body, and the same some way ahead."""
    ends, ahead = np.array([1.0, 1.0 + frames]), np.array([[0.0, up_m, 0.0], [0.0, up_m, way_m]])
    joints = ("root", "lfoot", "rfoot")
    return Sketch("walk", FPS, tuple(Control(j, ends, stance[skeleton.index(j)] + ahead) for j in joints))


@pytest.mark.parametrize(("way_m", "frames"), [(1.2, 36), (0.6, 24), (2.5, 60), (1.2, 24)])
def test_soles_stay_above_the_floor_and_rest_at_the_ends(truth, stance, solver, way_m, frames):
    solution = solver.solve(six_keys(truth.skeleton, stance, way_m, frames))
    assert solution.unmet == ()
    assert sole_heights(solution.motion).min() > -0.001
    speeds = np.linalg.norm(np.diff(balls_m(solution.motion), axis=0), axis=-1) * FPS
    assert speeds[[0, -1]].max() < STANDING.planted_m_s  # they stand, in other parts of the program, too
    assert speeds.max() > 1.0  # it walked


def test_feet_that_are_keyed_below_the_floor_stay_there(truth, stance, solver):
    """The floor is elsewhere: on a stage, or in another place of the scene."""
    solution = solver.solve(six_keys(truth.skeleton, stance, 1.2, 36, up_m=-0.5))
    assert solution.key_distances_m.max() < LIMITS.met_m
    assert sole_heights(solution.motion).min() < -0.4


def test_feet_are_lifted_those_with_keys_hardly(truth, stance):
    rotations = np.repeat(standing(truth.skeleton)[None], 30, axis=0)
    roots = np.repeat(stance[[truth.skeleton.index("root")]], 30, axis=0)
    roots[10:] -= [0.0, 0.01, 0.0]
    motion = Motion("sunk", FPS, truth.skeleton, rotations, roots)
    keyed = np.zeros((30, 2), dtype=bool)
    keyed[20, 0] = True
    lifted = above_floor(motion, keyed, np.zeros_like(keyed))
    heights = sole_heights(lifted)
    assert np.delete(heights[:, 0], range(16, 25)).min() > -0.001
    assert heights[:, 1].min() > -0.001
    assert heights[20, 0] == pytest.approx(-0.01, abs=0.0005)  # turned, its heel or its tip would sink deeper
    ankles = [truth.skeleton.index(side + "foot") for side in "lr"]
    moved = (
        forward_kinematics(each.skeleton, each.rotations, each.root_positions_m)[0][:, ankles, 1]
        for each in (lifted, motion)
    )
    up_m = next(moved) - next(moved)
    assert up_m[20] == pytest.approx([0.0, -sole_heights(motion)[20, 1]], abs=0.0005)
    whole = replace(motion, root_positions_m=roots + np.array([0.0, 0.02, 0.0]))
    assert above_floor(whole, keyed, keyed) is whole
