"""What the Takes panel's buttons do: import, solve again, put on a character, export, delete, have back, clean up."""

import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from clicked import run_job
from perfanim.core.body.motion import sliced
from perfanim.core.body.skeleton import marker_positions
from perfanim.core.formats.markers.marker_files import write_take
from perfanim.core.formats.motion.bvh import read_bvh
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.formats.take_file.take_setup import TakeNotes
from perfanim.core.formats.take_file.whole_take import write_whole_take
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.markers.subject import save_subject
from played import curves_of, key_times, points_to_blender, select_bones
from solved_poses import scene_pose, write_poses

pytestmark = pytest.mark.usefixtures("anna", "near_worker")
CHOSEN = {"database": "CHOSEN", "performer": "CHOSEN", "cameras": "RECORDED", "put_on": False}


@pytest.fixture(scope="module")
def walk(walk: SimpleNamespace) -> SimpleNamespace:
    """Twenty frames of Anna's walk, also as C3D with z up."""
    motion, markers = sliced(walk.motion, 20, 40), walk.subject.marker_set
    joints = markers.joint_indices(motion.skeleton)
    places = marker_positions(motion.skeleton, joints, markers.offsets_m, motion.rotations, motion.root_positions_m)
    write_take(MarkerTake("walk", 30.0, markers.names, points_to_blender(places)), walk.folder / "walk.c3d")
    return SimpleNamespace(folder=walk.folder, motion=motion, subject=walk.subject)


def recorded(part: Any, walk: SimpleNamespace, name: str, **notes: Any) -> Path:
    """A take with the walk as its poses."""
    motion = zip(walk.motion.rotations, walk.motion.root_positions_m, strict=True)
    poses = [scene_pose(number, *pose, fps=30.0, markers=8) for number, pose in enumerate(motion)]
    path = write_poses(part("take_library").folder(), name, (walk.subject,), poses, **notes)
    part("take_library").forget()
    return path


def imported(part: Any, walk: SimpleNamespace, *files: str, put_on: bool = False) -> str:
    operator = part("operators.import_takes").PERFANIM_OT_import_takes
    names = [SimpleNamespace(name=name) for name in files]
    given = {"files": names, "directory": str(walk.folder), "filepath": "", "up": "auto", "method": "nearest"}
    given |= {"trust_labels": False, "body": "CHOSEN", "put_on": put_on}
    return run_job(part, operator, SimpleNamespace(**given))


@pytest.fixture
def recorded_import(part: Any, walk: SimpleNamespace, listed_takes: Any) -> Any:
    """Return what the button says of one imported take with these further facts."""

    def said(**facts: Any) -> str:
        take = {"out": str(recorded(part, walk, "filmed")), "verdict": "good", "warnings": [], **facts}
        operator = part("operators.import_takes").PERFANIM_OT_import_takes
        return str(operator.on_result(SimpleNamespace(put_on=False), bpy.context, {"takes": [take], "failed": []}))

    return said


def test_marker_takes_are_imported_into_the_list_and_played(
    part: Any, walk: SimpleNamespace, listed_takes: Any, chosen: Any
) -> None:
    (walk.folder / "words.trc").write_text("no markers")
    write_take(MarkerTake("half", 30.0, ("a", "b"), np.zeros((5, 2, 3))), walk.folder / "half.csv")
    text = imported(part, walk, "words.trc", "walk.c3d", "half.csv")
    assert text.startswith("1 of 3 takes imported; ")
    assert "words.trc" in text
    assert "choose the marker set that was worn" in text
    (item,) = listed_takes()
    assert (item.title, item.summary.complete) == ("walk", True)
    panel = part("panels.takes_panel")
    assert panel.origin_of(item.summary) == "Anna, markers locomotion, method nearest, database walk"
    assert panel.size_of(item.summary).startswith("20 frames, ")
    bpy.context.scene.render.fps = 30
    bpy.context.scene.frame_set(7)
    assert bpy.ops.perfanim.play_take(path=item.path) == {"FINISHED"}
    armature = chosen.armature
    np.testing.assert_allclose(key_times(curves_of(armature)), np.arange(7, 27), atol=1e-3)
    assert panel.origin_of(listed_takes()[0].summary).endswith(f"on {armature.name}")
    bpy.context.scene.frame_set(15)  # half way through the walk the body stands upright there
    hips = armature.matrix_world @ armature.pose.bones["hips"].head
    wanted = points_to_blender(walk.motion.root_positions_m[8])
    assert np.linalg.norm(np.array(hips - armature.location) - wanted) < 0.05


def test_a_single_take_is_put_on_the_active_character(
    part: Any, walk: SimpleNamespace, listed_takes: Any, chosen: Any
) -> None:
    assert bpy.ops.perfanim.add_character("EXEC_DEFAULT") == {"FINISHED"}
    hero = chosen.armature
    hero.name = "Hero"
    chosen.armature = None
    bpy.context.view_layer.objects.active = hero.children[0]  # importers leave the mesh active
    text = imported(part, walk, "walk.c3d", put_on=True)
    assert re.fullmatch(r"1 take imported; good; 20 frames in walk on Hero", text)
    assert chosen.armature == hero
    assert hero.animation_data.action.name == "walk"


@pytest.mark.parametrize(
    ("files", "follow", "given"),
    [
        (["a.c3d"], "MARKERS", []),
        (["a.mp4", "b.mp4"], "MARKERS", ["--marker-set", "locomotion"]),
        (["a.mp4", "b.mp4"], "PERSON", ["--people"]),
        (["a.jpg"], "PERSON", ["--people"]),
    ],
)
def test_what_is_not_chosen_is_found_by_the_work(
    part: Any, chosen: Any, tmp_path: Path, files: list[str], follow: str, given: list[str]
) -> None:
    for name in files:
        (tmp_path / name).write_bytes(b"")
    chosen.follow, chosen.marker_set, chosen.database = follow, "locomotion", "starter"
    operator = part("operators.import_takes").PERFANIM_OT_import_takes
    clicked = SimpleNamespace(body="AUTO", up="auto", method="best", trust_labels=False)
    clicked.chosen_files = lambda: [str(tmp_path / name) for name in files]
    clicked._performer = partial(operator._performer, clicked)
    words = operator.arguments(clicked, bpy.context)
    first = 2 + len(files)
    assert words[first : words.index("--database")] == given
    assert words[words.index("--database") + 1] == str(part("settings.readiness").starter_database_path())
    chosen.calibration = str(tmp_path / "cameras.toml")
    words = operator.arguments(clicked, bpy.context)
    is_filmed = files != ["a.c3d"]
    assert ("--cameras" in words) == is_filmed
    chosen.calibration = ""


def test_films_and_pictures_have_settings_unless_other_files_are_chosen(part: Any) -> None:
    may_be = part("operators.import_takes").may_be_filmed
    assert may_be([]) and may_be([""]) and may_be(["walk.c3d", "LEFT.MP4"])  # [""]: a folder in the file browser
    assert not may_be(["", "walk.c3d"])


def test_the_floor_under_the_feet_is_reported_below_a_good_take(recorded_import: Any, message: Any) -> None:
    heights, floor = {"left": 1103.2, "right": 1700.0}, "floor found under the feet; cameras above it: left 1.10 m"
    assert recorded_import(camera_heights_mm=heights) == "1 take imported; good"
    assert message("takes") == f"{floor}, right 1.70 m"
    assert floor in recorded_import(camera_heights_mm=heights, verdict="left arm guessed")
    assert message("takes") == ""


def test_nothing_to_import_is_said_before_any_work(part: Any, walk: SimpleNamespace, listed_takes: Any) -> None:
    with pytest.raises(Exception, match="not found"):
        imported(part, walk, "none.c3d")
    (walk.folder / "none.trc").write_text("no markers")
    with pytest.raises(Exception, match=r"none\.trc"):
        imported(part, walk, "none.trc")
    assert listed_takes() == []


def test_without_a_database_the_starter_is_made_first(
    part: Any, walk: SimpleNamespace, monkeypatch: Any, listed_takes: Any, chosen: Any
) -> None:
    chosen.database = ""
    target = part("settings.readiness").starter_database_path()
    monkeypatch.setattr(part("operators.database_operators"), "MOTION", walk.folder)
    assert not target.exists()
    assert imported(part, walk, "walk.c3d") == "1 take imported; good"
    assert target.exists()
    assert read_take_file(listed_takes()[0].path).setup.database["path"] == str(target)


def test_a_take_is_solved_again_with_other_settings(
    part: Any, walk: SimpleNamespace, listed_takes: Any, chosen: Any
) -> None:
    imported(part, walk, "walk.c3d")
    path = listed_takes()[0].path
    save_subject(replace(walk.subject, name="Anna anew"), walk.folder / "anew.toml")
    chosen.subject = str(walk.folder / "anew.toml")
    operator = part("operators.solve_takes").PERFANIM_OT_solve_take
    text = run_job(part, operator, SimpleNamespace(path=path, method="local-pca", **CHOSEN))
    assert text == "20 frames solved as walk (local-pca)"
    assert [(i.title, part("panels.takes_panel").origin_of(i.summary)) for i in listed_takes()] == [
        ("walk (local-pca)", "Anna anew, markers locomotion, method local-pca, database walk"),
        ("walk", "Anna, markers locomotion, method nearest, database walk"),
    ]
    assert bpy.context.window_manager.perfanim_takes.active == 0
    chosen.calibration = ""
    with pytest.raises(Exception, match="choose one under Cameras"):
        run_job(part, operator, SimpleNamespace(path=path, method="best", **CHOSEN | {"cameras": "CHOSEN"}))


def test_a_take_without_a_performer_is_listed_and_solved_with_the_chosen_one(
    part: Any, walk: SimpleNamespace, listed_takes: Any, chosen: Any
) -> None:
    """As `perfanim track --out TAKE.perftake` writes it, without labels and poses."""
    imported(part, walk, "walk.c3d")
    take = read_take_file(listed_takes()[0].path)
    bare = part("take_library").folder() / "bare.perftake"
    frames = [(0.0, replace(frame, labels=np.full(len(frame.points_m), -1))) for frame in take.frames]
    write_whole_take(bare, replace(take.setup, performers=(), database={}), TakeNotes("bare"), frames, [])
    part("take_library").forget()
    (item,) = (item for item in listed_takes() if item.title == "bare")
    assert part("panels.takes_panel").origin_of(item.summary) == "no performer yet: click Solve Again"
    for operator in (bpy.ops.perfanim.play_take, bpy.ops.perfanim.export_take):
        with pytest.raises(RuntimeError, match="bare: has no solved poses; click Solve Again"):
            operator(path=str(bare))
    operator, given = part("operators.solve_takes").PERFANIM_OT_solve_take, CHOSEN | {"performer": "RECORDED"}
    text = run_job(part, operator, SimpleNamespace(path=str(bare), method="nearest", **given))
    assert text == "20 frames solved as bare (nearest)"
    assert len(read_take_file(bare.with_name("bare (nearest).perftake")).poses) == 20
    chosen.subject = ""
    with pytest.raises(Exception, match="no subject is chosen; choose one under Subject"):
        run_job(part, operator, SimpleNamespace(path=str(bare), method="best", **given))


def test_a_take_goes_where_is_chosen(part: Any, walk: SimpleNamespace) -> None:
    path, scene = recorded(part, walk, "walk"), bpy.context.scene
    scene.render.fps = 30
    result = scene.perfanim_result
    result.start, result.reduce = "FIRST", True
    scene.frame_set(50)
    bpy.ops.perfanim.play_take(path=str(path))
    armature = scene.perfanim.armature
    curves = curves_of(armature)
    assert key_times(curves)[[0, -1]].tolist() == pytest.approx([1.0, 20.0])
    assert sum(len(curve.keyframe_points) for curve in curves) < 0.7 * 20 * len(curves)
    result.start, result.reduce, result.onto, result.only_selected = "PLAYHEAD", False, "LAYER", True
    select_bones(armature, {"upper_arm.L"})
    bpy.ops.perfanim.play_take(path=str(path))
    tracks = armature.animation_data.nla_tracks
    assert [track.name for track in tracks] == ["walk", "walk.001"]
    assert (tracks[1].strips[0].frame_start, tracks[1].strips[0].blend_in > 0.0) == (pytest.approx(50.0), True)
    armature.animation_data.action = bpy.data.actions["walk.001"]
    if hasattr(armature.animation_data, "action_slot"):
        armature.animation_data.action_slot = bpy.data.actions["walk.001"].slots[0]
    assert {curve.group.name for curve in curves_of(armature)} == {"upper_arm.L"}


def test_a_take_is_exported(part: Any, walk: SimpleNamespace, tmp_path: Path, chosen: Any, message: Any) -> None:
    path, export = str(recorded(part, walk, "walk")), bpy.ops.perfanim.export_take
    assert export(path=path, kind="FBX", filepath=str(tmp_path / "a.bvh")) == {"FINISHED"}
    assert message("takes") == f"20 frames of walk on {chosen.armature.name} in {tmp_path / 'a.fbx'}"
    assert [file.name for file in tmp_path.iterdir()] == ["a.fbx"]
    with pytest.raises(RuntimeError, match=r"cannot be\s+written"):
        export(path=path, kind="FBX", filepath=str(tmp_path / "a.fbx" / "b.fbx"))
    for kind, name in (("VRMA", "b.vrma"), ("ANGLES", "b.angles.csv")):
        export(path=path, kind=kind, filepath=str(tmp_path / name), rate=15, naming="unreal")
        assert message("takes") == f"10 frames of walk in {tmp_path / name}"
    assert "hand_l_z_deg" in (tmp_path / "b.angles.csv").read_text()
    given = {"kind": "BVH", "naming": "unreal", "scale": 100.0, "rate": 15.0}
    export(path=path, filepath=str(tmp_path / "c.bvh"), **given)
    read = read_bvh(tmp_path / "c.bvh")
    assert (read.frames, read.fps, read.metres_per_unit) == (10, 15.0, 0.01)
    assert "pelvis" in read.names


def test_the_next_export_is_offered_in_the_folder_of_the_last(
    part: Any, walk: SimpleNamespace, tmp_path: Path, chosen: Any
) -> None:
    path, operator = str(recorded(part, walk, "walk")), part("operators.export_operators").PERFANIM_OT_export_take
    bpy.ops.perfanim.export_take(path=path, kind="VRMA", filepath=str(tmp_path / "a.vrma"))
    shown: list[Any] = []
    dialog = type(operator.__name__, (SimpleNamespace,), {})(path=path, kind="BVH")
    window_manager = SimpleNamespace(fileselect_add=shown.append)
    assert operator.invoke(dialog, SimpleNamespace(window_manager=window_manager), None) == {"RUNNING_MODAL"}
    assert shown == [dialog]
    assert dialog.filepath == str(tmp_path / "walk.bvh")


def test_a_deleted_take_can_be_had_back(part: Any, walk: SimpleNamespace, listed_takes: Any) -> None:
    first, second = recorded(part, walk, "walk"), recorded(part, walk, "run")
    content = first.read_bytes()
    assert bpy.ops.perfanim.delete_take(path=str(first)) == {"FINISHED"}
    assert [item.title for item in listed_takes()] == ["run"]
    assert part("take_library").disk_space() == (second.stat().st_size, len(content))
    (gone,) = part("take_library").deleted()
    recorded(part, walk, "walk")  # another of that name
    assert bpy.ops.perfanim.restore_take(take=str(gone.path)) == {"FINISHED"}
    assert sorted(item.title for item in listed_takes()) == ["run", "walk", "walk"]
    assert not bpy.ops.perfanim.restore_take.poll()
    assert (first.parent / "walk (2).perftake").read_bytes() == content
    with pytest.raises(RuntimeError, match="cannot be read"):
        bpy.ops.perfanim.delete_take(path=str(first) + "x")


def test_clean_up_removes_what_is_deleted_or_old_and_nothing_else(
    part: Any, walk: SimpleNamespace, listed_takes: Any, chosen: Any, message: Any
) -> None:
    takes = part("take_library")
    for name, days, rating in (("old", 100, 0), ("old but good", 100, 3), ("new", 1, 0), ("gone", 1, 5)):
        path = recorded(part, walk, name, rating=rating)
        made = read_take_file(path)
        setup = replace(made.setup, created=(datetime.now(UTC) - timedelta(days=days)).isoformat())
        write_whole_take(path, setup, made.notes, made.stamped_frames, made.poses)
    (takes.folder() / ("cut.perftake" + takes.RECOVERED_SUFFIX)).write_bytes(b"x" * 500)
    takes.forget()
    takes.delete(takes.folder() / "gone.perftake")
    deleted = next(iter(takes.deleted())).path.stat().st_size
    assert takes.disk_space()[1] == deleted + 500
    assert bpy.ops.perfanim.clean_up_takes(deleted=True, old=False) == {"FINISHED"}
    assert message("takes") == f"2 files removed, {takes.size_text(deleted + 500)} freed"
    assert {item.title for item in listed_takes()} == {"new", "old", "old but good"}
    assert takes.disk_space()[1] == 0
    assert bpy.ops.perfanim.clean_up_takes(deleted=False, old=True, days=90, stars=0) == {"FINISHED"}
    assert {item.title for item in listed_takes()} == {"new", "old but good"}
    with pytest.raises(RuntimeError, match="nothing is selected"):
        bpy.ops.perfanim.clean_up_takes(deleted=True, old=False)


def test_sizes_are_told_as_people_read_them(part: Any) -> None:
    text = part("take_library").size_text
    sizes = {0: "0 bytes", 999: "999 bytes", 1000: "1 KB", 2_340_000: "2 MB", 1_250_000_000: "1.2 GB"}
    assert {size: text(size) for size in sizes} == sizes
