"""Motion of files whose world is upside down, and handstands, which are not."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.body_size import standing_root_m
from perfanim.core.body.calibration_poses import standing
from perfanim.core.body.motion import Motion
from perfanim.core.body.posture import posture_of, turned_upright
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.formats.motion.read_motion import read_motion, read_motion_parts
from perfanim.core.geometry import rotations as rot

BODY = default_skeleton()
HALF_TURN = np.array([0.0, 1.0, 0.0, 0.0])


@pytest.fixture
def stands():
    """A body that stands and walks forward."""
    path = standing_root_m(BODY) + np.linspace(0.0, 1.0, 20)[:, None] * [0.0, 0.0, 1.0]
    return Motion("stands", 30.0, BODY, np.tile(standing(BODY), (20, 1, 1)), path)


def on_its_head(motion, positions_m):
    rotations = motion.rotations.copy()
    rotations[:, 0] = rot.multiply(HALF_TURN, rotations[:, 0])
    return replace(motion, rotations=rotations, root_positions_m=positions_m)


def test_a_world_with_y_down_is_turned_over(stands):
    found = turned_upright(on_its_head(stands, stands.root_positions_m * [1.0, -1.0, -1.0]))
    np.testing.assert_allclose(found.root_positions_m, stands.root_positions_m, atol=1e-12)
    np.testing.assert_allclose(posture_of(found).positions_m, posture_of(stands).positions_m, atol=1e-12)
    assert turned_upright(stands) is None


def test_a_body_that_alone_is_turned_stays_above_the_floor(stands):
    found = turned_upright(on_its_head(stands, stands.root_positions_m * [1.0, 1.0, -1.0]))
    np.testing.assert_allclose(found.root_positions_m, stands.root_positions_m, atol=1e-12)


def test_a_handstand_is_left_alone(stands):
    raised = stands.rotations.copy()
    for side in "lr":
        humerus = BODY.index(side + "humerus")
        raised[:, humerus] = rot.multiply(HALF_TURN, raised[:, humerus])
    hands = on_its_head(replace(stands, rotations=raised), stands.root_positions_m * [1.0, 1.2, 1.0])
    assert posture_of(hands).is_upside_down
    assert turned_upright(hands) is None


def test_files_with_y_down_are_read_upright(stands, tmp_path):
    write_bvh(on_its_head(stands, stands.root_positions_m * [1.0, -1.0, -1.0]), tmp_path / "down.bvh")
    np.testing.assert_allclose(read_motion(tmp_path / "down.bvh").root_positions_m, stands.root_positions_m, atol=1e-5)
    (defect,) = read_motion_parts(tmp_path / "down.bvh").defects
    assert (defect.kind, defect.done) == ("the body is upside down in all frames", "turned over")
