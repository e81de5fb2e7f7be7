"""Between world space and Blender's: directions."""

import numpy as np
from perfanim.perfanim_addon.character import axes


def test_performer_faces_minus_y_with_z_up():
    left, up, forward = axes.points_to_blender(np.eye(3))
    assert left.tolist() == [1.0, 0.0, 0.0]
    assert up.tolist() == [0.0, 0.0, 1.0]
    assert forward.tolist() == [0.0, -1.0, 0.0]
