"""The command line by an installed Blender, without a window and without another Python."""

import json
import os
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from motion_synthesis import perform
from perfanim.core.body.motion import sliced
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.formats.markers.marker_files import write_take
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.simulate.simulated_markers import simulate_markers

PATIENCE_S = 120.0


@pytest.fixture
def blender(wrapper: str, user: Path) -> Callable[..., subprocess.Popen[str]]:
    def start(*arguments: str) -> subprocess.Popen[str]:
        command = [wrapper, "blender", "--background", "--command", "perfanim", *arguments]
        environment = {**os.environ, "BLENDER_USER_RESOURCES": str(user)}
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)

    return start


def test_a_batch_is_solved_and_retargeted_by_blender_alone(blender, shared_dir: Path, tmp_path: Path) -> None:
    motion = perform("walking", 4.0)
    write_bvh(motion, tmp_path / "walk.bvh")
    build_database([str(tmp_path / "walk.bvh")], tmp_path / "walk.pfdb", BuildSettings(fps=60.0))
    take, _ = simulate_markers(sliced(motion, 0, 60), load_marker_set("boxing"))
    write_take(take, tmp_path / "walk.take.npz")
    character = next((shared_dir / "rigs").rglob("CesiumMan.glb"))
    line = ["batch", str(tmp_path / "walk.take.npz"), "--database", str(tmp_path / "walk.pfdb"), "--marker-set"]
    line += ["boxing", "--skeleton", str(tmp_path / "walk.bvh"), "--to", str(character), "--out", str(tmp_path / "all")]
    with blender(*line, "--json") as process:
        out, err = process.communicate()
    assert process.returncode == 0, err
    (told,) = json.loads(out)["takes"]  # nothing else is on stdout
    assert told["status"] == "good", told
    assert {Path(path).suffix for path in told["outputs"].values()} == {".bvh", ".blend", ".jpg"}


def test_bad_input_and_an_end_by_force(blender, tmp_path: Path) -> None:
    with blender("database", "info", str(tmp_path / "none.pfdb")) as process:
        _, err = process.communicate()
    assert process.returncode == 1
    assert [line for line in err.splitlines() if line.startswith("perfanim: ")]
    assert "Traceback" not in err
    with blender("vmc", "receive", "--port", "0", "--seconds", "600", "--out", str(tmp_path / "a.bvh")) as process:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        wait_until(lambda: bool(children.read_text().split()))
        (child,) = children.read_text().split()
        process.kill()
        wait_until(lambda: not Path(f"/proc/{child}").exists())


def wait_until(condition: Callable[[], bool]) -> None:
    limit_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < limit_s
        time.sleep(0.1)
