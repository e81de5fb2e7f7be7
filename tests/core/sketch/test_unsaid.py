"""What no control says: a body goes along the path of its hips, lets its hands hang, and lifts its feet to step."""

import numpy as np
import pytest
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.sketch.sketch import Control, Sketch
from perfanim.core.sketch.solve_sketch import solve_sketch

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
    solution = solve_sketch(sketch, truth.skeleton, database)
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
