"""A batch from the sidebar: the real worker does it, the test plays the timer."""

import json
import sys
import time
import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from perfanim.core.body.motion import resampled, sliced
from perfanim.core.body.scene_pose import PerformerPose, ScenePose
from perfanim.core.cli.main import main
from perfanim.core.formats.markers.marker_files import write_take
from perfanim.core.formats.motion.bvh import read_bvh, write_bvh
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.formats.take_file.pose_codec import TimedPose
from perfanim.core.formats.take_file.take_setup import TakeNotes, TakeSetup
from perfanim.core.formats.take_file.whole_take import write_whole_take
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject, save_subject
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.system.assets import MOTION

PATIENCE_S = 300.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A database, who walks, and takes of the walk: one good, one broken, one in a folder of its own."""
    place = tmp_path_factory.mktemp("batch")
    motion = resampled(read_motion(MOTION / "walking-01-neutral.bvh"), 30.0)
    write_bvh(motion, place / "walk.bvh")
    assert main(["database", "build", str(place / "walk.bvh"), "--fps", "30", "--out", str(place / "walk.pfdb")]) == 0
    subject = Subject("Anna", motion.skeleton, load_marker_set("locomotion"))
    save_subject(subject, place / "anna.toml")
    part = sliced(motion, 20, 30)
    take = simulate_markers(part, subject)[0]
    (place / "takes" / "day 2").mkdir(parents=True)
    write_take(take, place / "takes" / "walk.c3d")
    write_take(take, place / "takes" / "day 2" / "again.trc")
    (place / "takes" / "broken.c3d").write_bytes(b"no take")
    return place


@pytest.fixture
def part(part: Any, folder: Path) -> Any:
    """Return a module of the add-on by its name; performer, database and marker set are chosen."""
    chosen = bpy.context.scene.perfanim
    chosen.subject, chosen.database = str(folder / "anna.toml"), str(folder / "walk.pfdb")
    chosen.marker_set = "locomotion"
    return part


def run_job(part: Any) -> tuple[str, list[str]]:
    """Do what the operator does between the click and the end; return its line and what the panel said meanwhile."""
    operator = part("operators.batch_operators").PERFANIM_OT_run_batch
    played = SimpleNamespace(title=operator.title)
    played.uses_starter = lambda context: operator.uses_starter(played, context)
    played.panel = operator.panel
    played.arguments = lambda context: operator.arguments(played, context)
    played.request = lambda context: operator.request(played, context)
    job = operator.create_job(played, bpy.context, None)
    limit, said = time.monotonic() + PATIENCE_S, []
    try:
        while not job.ended:
            job.tick()
            said += [job.text] * (job.text not in said)
            assert time.monotonic() < limit, job.text
            time.sleep(0.01)
    finally:
        job.close()
    return str(operator.on_result(played, bpy.context, job.summary)), said


def test_a_folder_of_takes_is_done_and_shown(part: Any, folder: Path, tmp_path: Path, monkeypatch: Any) -> None:
    chosen, shown = bpy.context.scene.perfanim_batch, []
    monkeypatch.setattr(part("operators.batch_operators"), "show_page", shown.append)
    assert not bpy.ops.perfanim.run_batch.poll()
    chosen.takes, chosen.out = str(folder / "takes"), str(tmp_path / "out")
    assert bpy.ops.perfanim.run_batch.poll()
    chosen.naming, chosen.vrma = "mixamo", True
    text, said = run_job(part)
    page = tmp_path / "out" / "summary.html"
    assert text.startswith("3 takes: ")
    assert text.endswith(f"1 bad; see {page}")
    assert shown == [page]
    assert any("3 takes" in line and "left" in line for line in said)
    told = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert [take["status"] == "bad" for take in told["takes"]] == [False, True, False]
    assert [take["name"] for take in told["takes"]] == ["again", "broken", "walk"]
    assert read_bvh(tmp_path / "out" / "walk.bvh").names[0] == "mixamorig:Hips"
    assert (tmp_path / "out" / "again.vrma").is_file()
    assert [row["name"] for row in tomllib.loads((tmp_path / "out" / "plan.toml").read_text())["take"]] == [
        "again", "broken", "walk",
    ]  # fmt: skip


def test_own_takes_are_solved_for_who_was_recorded(part: Any, folder: Path, tmp_path: Path, monkeypatch: Any) -> None:
    subject = Subject("Ben", read_motion(folder / "walk.bvh").skeleton, load_marker_set("locomotion"))
    nowhere = np.full((8, 3), np.nan)
    motion = read_motion(folder / "walk.bvh")
    pose = PerformerPose(
        0, 0.0, motion.rotations[0], motion.root_positions_m[0], 0.9, nowhere, nowhere, np.full(8, -1), 0.0
    )
    setup = TakeSetup.of(default_rig(), (subject,), {}, {"path": "x"}, {})
    own = part("take_library").folder() / "ben.perftake"
    write_whole_take(own, setup, TakeNotes("ben"), [], [TimedPose(ScenePose((pose,)), 0.0)])
    chosen = bpy.context.scene.perfanim_batch
    chosen.out = str(tmp_path / "out")  # no folder of takes: those of the list
    bpy.context.scene.perfanim.subject = ""
    path = part("settings.batch_settings").plan_file(bpy.context, chosen)
    plan = tomllib.loads(path.read_text())
    assert plan["take"] == [{"take": str(own), "name": "ben"}]
    assert plan["database"] == str(folder / "walk.pfdb")
    chosen.takes = str(folder / "takes")
    errors = sys.modules[part("settings.batch_settings").SettingsError.__module__]
    with pytest.raises(errors.SettingsError, match="choose one under Subject"):
        part("settings.batch_settings").plan_file(bpy.context, chosen)
    bpy.context.scene.perfanim.subject = str(folder / "anna.toml")
    chosen.character, chosen.save_as = str(folder / "anna.toml"), "fbx"
    monkeypatch.setattr(bpy.app, "binary_path", "/opt/blender")
    plan = tomllib.loads(part("settings.batch_settings").plan_file(bpy.context, chosen).read_text())
    assert {key: plan[key] for key in ("to", "save_as", "blender")} == {
        "to": str(folder / "anna.toml"), "save_as": "fbx", "blender": "/opt/blender",
    }  # fmt: skip
    rows = tomllib.loads(part("settings.batch_settings").plan_file(bpy.context, chosen).read_text())["take"]
    assert {row["name"] for row in rows} == {"again", "broken", "walk"}
    assert {row["subject"] for row in rows} == {str(folder / "anna.toml")}


def test_what_is_missing_is_said_on_the_button(part: Any, folder: Path) -> None:
    chosen, problem = bpy.context.scene.perfanim_batch, part("settings.batch_settings").problem
    assert problem(chosen) == "choose a folder for the results"
    chosen.takes = str(folder / "nowhere")
    assert problem(chosen) == "folder of takes not found"
    chosen.plan = str(folder / "none.toml")
    assert problem(chosen) == "plan file not found"
