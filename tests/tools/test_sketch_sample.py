"""The sample of a sketch is written from twelve keys, and its motion goes to the mark; the command line solves it."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from perfanim.core.cli.main import main
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.system.assets import MOTION
from played import curves_of, key_times

bpy = pytest.importorskip("bpy", reason="needs the bpy wheel")
ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("sample") / "sample.blend"
    command = [sys.executable, str(ROOT / "tools" / "sketch_sample.py"), "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "130 frames in Performer sketch; all keys are met" in done.stdout
    return out


def test_the_sample_goes_to_the_mark(sample: Path) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(sample))
    armature = next(obj for obj in bpy.data.objects if obj.type == "ARMATURE")
    controls = [obj for obj in bpy.data.objects if "perfanim_joint" in obj]
    assert sum(len(key_times(curves_of(control))) for control in controls) == 12
    places = []
    for frame in (1, 75):
        bpy.context.scene.frame_set(frame)
        posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
        places.append(np.array(posed.matrix_world @ posed.pose.bones["root"].head))
    np.testing.assert_allclose(places[1] - places[0], (0.0, -2.0, 0.0), atol=0.01)


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> str:
    out = tmp_path_factory.mktemp("database") / "walks.pfdb"
    clips = [str(path) for pattern in ("walking-0[1-4]*", "boxing-0[1-3]*") for path in MOTION.glob(f"{pattern}.bvh")]
    assert main(["database", "build", *clips, "--fps", "30", "--out", str(out)]) == 0
    return str(out)


def test_the_command_line_solves_a_blend_without_its_scripts(
    sample: Path, database: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(sample))
    trace, scripted, out = (tmp_path / name for name in ("trace", "scripted.blend", "sketched.bvh"))
    script = bpy.data.texts.new("start.py")
    script.write(f"open({str(trace)!r}, 'w').close()")
    script.use_module = True
    bpy.ops.wm.save_as_mainfile(filepath=str(scripted))
    capsys.readouterr()
    assert main(["sketch", str(scripted), "--database", database, "--out", str(out), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["frames"], facts["keys"], facts["first_frame"]) == (130, 12, 1)
    motion = read_motion(out)
    way_m = motion.root_positions_m[75] - motion.root_positions_m[1]
    np.testing.assert_allclose(way_m, (0.0, 0.0, 2.0), atol=0.02)
    assert not trace.exists()


def test_a_blend_without_a_sketch_and_one_that_is_none_are_refused(
    database: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    empty, broken = tmp_path / "empty.blend", tmp_path / "broken.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(empty))
    broken.write_text("no blend", encoding="utf-8")
    for path, message in ((empty, "has no sketch"), (broken, "cannot be read"), (tmp_path / "gone.blend", "no such")):
        out = tmp_path / "out.bvh"
        assert main(["sketch", str(path), "--database", database, "--out", str(out)]) == 1
        said = capsys.readouterr().err
        assert message in said
        assert len(said.splitlines()) == 1
        assert not out.exists()
