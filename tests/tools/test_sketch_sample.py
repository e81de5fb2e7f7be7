"""The sample of a sketch is written from twelve keys, and its motion goes to the mark."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from played import curves_of, key_times

bpy = pytest.importorskip("bpy", reason="needs the bpy wheel")
ROOT = Path(__file__).resolve().parents[2]


def test_the_sample_is_written(tmp_path: Path) -> None:
    out = tmp_path / "sample.blend"
    command = [sys.executable, str(ROOT / "tools" / "sketch_sample.py"), "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "130 frames in Performer sketch; all keys are met" in done.stdout
    bpy.ops.wm.open_mainfile(filepath=str(out))
    armature = next(obj for obj in bpy.data.objects if obj.type == "ARMATURE")
    controls = [obj for obj in bpy.data.objects if "perfanim_joint" in obj]
    assert sum(len(key_times(curves_of(control))) for control in controls) == 12
    places = []
    for frame in (1, 75):
        bpy.context.scene.frame_set(frame)
        posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
        places.append(np.array(posed.matrix_world @ posed.pose.bones["root"].head))
    np.testing.assert_allclose(places[1] - places[0], (0.0, -2.0, 0.0), atol=0.01)
