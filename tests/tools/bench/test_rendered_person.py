"""A person rendered by Blender: the pictures show the true motion, and the network and the solver find it."""

import cv2
import numpy as np
import pytest
from bench import rendered_person
from perfanim.core.body.motion import sliced
from perfanim.core.vision.people.network_file import body_network_file

pytest.importorskip("bpy", reason="needs the bpy wheel")
FRAMES = 20  # fewer do not determine a body


@pytest.mark.long
def test_a_rendered_walk_is_found(cmu_dir, tmp_path):
    if not body_network_file().is_file():
        pytest.skip("the body network is not here: perfanim network get")
    motion = sliced(rendered_person.filmed_motion(cmu_dir, rendered_person.ROOM.seconds), 10, 10 + FRAMES)
    rig = rendered_person.two_cameras()
    found = rendered_person.distances(motion, rig, tmp_path)
    assert found["found"] > 0.9 and found["warnings"] == []
    assert found["median_mm"] < 60.0
    assert {row["joint"] for row in found["rows"]} == {side + name for name in rendered_person.JOINTS for side in "lr"}
    trousers = cv2.imread(str(tmp_path / "left" / "0000.png"))
    joints_m = rendered_person.joints_of(sliced(motion, 0, 1))[0]
    knees = [rendered_person.JOINTS.index("tibia") * 2 + side for side in range(2)]
    for x, y in np.rint(rig.cameras[0].project(joints_m[knees])).astype(int):
        around = np.median(trousers[y - 3 : y + 4, x - 3 : x + 4], axis=(0, 1))
        assert around.max() < 130.0  # they are dark; wall and floor are not
