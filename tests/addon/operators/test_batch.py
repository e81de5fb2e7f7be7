"""A batch from the sidebar: the real worker does it, the test plays the timer."""

import json
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from clicked import run_job
from perfanim.core.body.motion import sliced
from perfanim.core.formats.markers.marker_files import write_take
from perfanim.core.formats.motion.bvh import read_bvh
from perfanim.core.simulate.simulated_markers import simulate_markers
from solved_poses import scene_pose, write_poses

NAMES = ["again", "broken", "walk"]


@pytest.fixture(scope="module")
def takes(walk: SimpleNamespace) -> Path:
    """A folder of takes of the walk: a good one, a broken one, one in a folder of its own."""
    folder, take = walk.folder / "takes", simulate_markers(sliced(walk.motion, 20, 30), walk.subject)[0]
    (folder / "day 2").mkdir(parents=True)
    write_take(take, folder / "walk.c3d")
    write_take(take, folder / "day 2" / "again.trc")
    (folder / "broken.c3d").write_bytes(b"no take")
    return folder


@pytest.fixture
def batch(anna: Path) -> Any:
    """The settings of the batch."""
    return bpy.context.scene.perfanim_batch


def plan(part: Any, batch: Any) -> dict[str, Any]:
    return tomllib.loads(part("settings.batch_settings").plan_file(bpy.context, batch).read_text())


def test_a_folder_of_takes_is_done_and_shown(
    part: Any, batch: Any, takes: Path, tmp_path: Path, monkeypatch: Any
) -> None:
    operators, shown, clicked, out = part("operators.batch_operators"), [], SimpleNamespace(), tmp_path / "out"
    monkeypatch.setattr(operators, "show_page", shown.append)
    assert not bpy.ops.perfanim.run_batch.poll()
    batch.takes, batch.out = str(takes), str(out)
    assert bpy.ops.perfanim.run_batch.poll()
    batch.naming, batch.vrma = "mixamo", True
    text = run_job(part, operators.PERFANIM_OT_run_batch, clicked)
    assert text.startswith("3 takes: ")
    assert text.endswith(f"1 bad; see {out / 'summary.html'}")
    assert shown == [out / "summary.html"]
    assert any("3 takes" in line and "left" in line for line in clicked.said)
    told = json.loads((out / "summary.json").read_text())
    assert [take["status"] == "bad" for take in told["takes"]] == [False, True, False]
    assert [take["name"] for take in told["takes"]] == NAMES
    assert read_bvh(out / "walk.bvh").names[0] == "mixamorig:Hips"
    assert (out / "again.vrma").is_file()
    assert [row["name"] for row in tomllib.loads((out / "plan.toml").read_text())["take"]] == NAMES


def test_own_takes_are_solved_for_who_was_recorded(
    part: Any, chosen: Any, batch: Any, walk: SimpleNamespace, takes: Path, tmp_path: Path, monkeypatch: Any
) -> None:
    module, anna = part("settings.batch_settings"), chosen.subject
    pose = scene_pose(0, walk.motion.rotations[0], walk.motion.root_positions_m[0])
    own = write_poses(part("take_library").folder(), "ben", (replace(walk.subject, name="Ben"),), [pose])
    batch.out = str(tmp_path / "out")  # no folder of takes: those of the list
    chosen.subject = ""
    made = plan(part, batch)
    assert made["take"] == [{"take": str(own), "name": "ben"}]
    assert made["database"] == chosen.database
    batch.takes = str(takes)
    with pytest.raises(module.SettingsError, match="choose one under Subject"):
        plan(part, batch)
    chosen.subject = batch.character = anna
    batch.save_as = "fbx"
    monkeypatch.setattr(bpy.app, "binary_path", "/opt/blender")
    made = plan(part, batch)
    wanted = {"to": anna, "save_as": "fbx", "blender": "/opt/blender"}
    assert {key: made[key] for key in wanted} == wanted
    assert {row["name"] for row in made["take"]} == set(NAMES)
    assert {row["subject"] for row in made["take"]} == {anna}


def test_what_is_missing_is_said_on_the_button(part: Any, batch: Any, tmp_path: Path) -> None:
    problem = part("settings.batch_settings").problem
    assert problem(batch) == "choose a folder for the results"
    batch.takes = str(tmp_path / "nowhere")
    assert problem(batch) == "folder of takes not found"
    batch.plan = str(tmp_path / "none.toml")
    assert problem(batch) == "plan file not found"
