"""What no control says: a body goes along the path of its hips, lets its hands hang, and lifts its feet to step."""

import numpy as np
import pytest
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.sketch.sketch_file import Control, Sketch
from perfanim.core.sketch.solve_sketch import SketchSettings, SketchSolver

HIPS_M = 0.97
MOVES_M_S = 0.2
FPS = 30.0


def positions_of(motion):
    return forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)[0]


@pytest.mark.parametrize(
    "path_m",
    [[(0, 0), (0, 0.7), (0, 1.4)], [(0, 0), (0.7, 0), (1.4, 0)], [(0, 0), (0, 1.0), (0.9, 1.4)]],
    ids=["ahead", "to the left", "with a turn"],
)
def test_hips_alone_lead_a_body_that_walks_ahead(truth, database, path_m):
    keys = np.array([(x, HIPS_M, z) for x, z in path_m])
    sketch = Sketch("path", FPS, (Control("root", np.array([0.0, 45.0, 90.0]), keys),))
    solution = SketchSolver(truth.skeleton, database).solve(sketch)
    assert solution.unmet == ()
    assert solution.drawn_from[0].startswith("walking")
    positions = positions_of(solution.motion)
    root, left, right, *hands = (
        positions[:, truth.skeleton.index(name)] for name in ("root", "lfemur", "rfemur", "lhand", "rhand")
    )
    ahead = np.cross(left - right, [0.0, 1.0, 0.0])[:, [0, 2]]
    way = np.gradient(root[:, [0, 2]], axis=0) * FPS
    speeds = np.linalg.norm(way, axis=1)
    cosines = np.sum(ahead * way, axis=1) / (np.linalg.norm(ahead, axis=1) * np.maximum(speeds, 1e-9))
    assert cosines[speeds > MOVES_M_S].min() > np.cos(np.radians(50.0))
    assert max(hand[0, 1] for hand in hands) < root[0, 1]


def test_hips_free_in_height_have_the_databases(truth, database):
    """Keys a foot too low make a body crouch, unless their height is free."""
    low_m = np.array([(0.0, HIPS_M - 0.3, 0.0), (0.0, HIPS_M - 0.3, 1.5)])
    heights = {}
    for is_free in (False, True):
        hips = Control("root", np.array([0.0, 60.0]), low_m, height_is_free=is_free)
        solution = SketchSolver(truth.skeleton, database).solve(Sketch("low", FPS, (hips,)))
        assert solution.unmet == ()
        heights[is_free] = positions_of(solution.motion)[:, truth.skeleton.index("root"), 1]
    assert abs(np.mean(heights[True]) - HIPS_M) < 0.06 < 0.2 < HIPS_M - np.mean(heights[False])


def test_a_drawn_curve_leads_as_far_as_it_is_followed(truth, database):
    drawn_m = np.column_stack(
        (0.4 * np.sin(np.linspace(0.0, np.pi, 61)), np.full(61, HIPS_M), np.linspace(0.0, 1.5, 61))
    )
    hips = Control("root", np.array([0.0, 60.0]), drawn_m[[0, -1]], drawn_m)
    strays = []
    for follow in (0.0, 1.0):
        solution = SketchSolver(truth.skeleton, database).solve(Sketch("arc", FPS, (hips,)), SketchSettings(follow))
        assert solution.unmet == ()
        root = positions_of(solution.motion)[:, truth.skeleton.index("root")]
        strays.append(np.linalg.norm(root - drawn_m, axis=1).max())
    assert strays[1] < 0.01 < 0.02 < strays[0]


def test_hands_without_keys_stay_low_over_feet_wide_apart(truth, database):
    """No clip stands so: what legs and arms do together in the database must not raise the arms."""
    places_m = {"root": (0.0, HIPS_M), "lfoot": (0.38, 0.06), "rfoot": (-0.38, 0.06)}
    controls = tuple(
        Control(joint, np.array([0.0, 36.0]), np.array([(*place_m, 0.0), (*place_m, 1.2)]))
        for joint, place_m in places_m.items()
    )
    solution = SketchSolver(truth.skeleton, database).solve(Sketch("wide", 24.0, controls))
    positions = positions_of(solution.motion)
    elbows, hands = (
        positions[:, [truth.skeleton.index(side + joint) for side in "lr"], 1] for joint in ("radius", "hand")
    )
    assert np.all(hands < elbows)


def test_hips_that_two_keys_hold_low_stay_low(truth, database):
    """The database's motion is far from these keys: it must not stand up between them."""
    places_m = np.array([(0.0, HIPS_M, 0.0), (0.0, 0.55, -0.3), (0.0, 0.55, -0.3)])
    feet_m = {side: np.repeat([(x, 0.06, 0.04)], 2, axis=0) for side, x in (("lfoot", 0.09), ("rfoot", -0.09))}
    controls = [Control("root", np.array([0.0, 30.0, 60.0]), places_m)]
    controls += [Control(joint, np.array([0.0, 60.0]), place_m) for joint, place_m in feet_m.items()]
    solution = SketchSolver(truth.skeleton, database).solve(Sketch("sit", FPS, tuple(controls)))
    heights = positions_of(solution.motion)[30:, truth.skeleton.index("root"), 1]
    assert heights.max() - 0.55 < 0.2 * (HIPS_M - 0.55)


def test_feet_without_keys_stay_on_the_floor_below_hips_that_sink(truth, database):
    keys_m = np.array([(0.0, 0.9, 0.0), (0.0, 0.45, 0.0), (0.0, 0.9, 0.0)])
    sketch = Sketch("crouch", FPS, (Control("root", np.array([0.0, 30.0, 60.0]), keys_m),))
    solution = SketchSolver(truth.skeleton, database).solve(sketch)
    toes = positions_of(solution.motion)[:, [truth.skeleton.index(side + "toes") for side in "lr"], 1]
    assert toes.min() > -0.01
