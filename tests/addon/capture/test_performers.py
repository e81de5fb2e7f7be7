"""Several performers: each moves a character of their own, which stand to each other as the performers do."""

import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from clicked import run_job
from perfanim.core.body.scene_pose import PerformerPose, ScenePose
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.formats.motion.bvh import read_bvh
from perfanim.core.formats.take_file.pose_codec import TimedPose
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.formats.take_file.take_setup import TakeNotes, TakeSetup
from perfanim.core.formats.take_file.whole_take import write_whole_take
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject, save_subject
from perfanim.core.simulate.studio.simulated_source import open_simulated
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.system.assets import MOTION
from played import curves_of, key_times, played_poses

PATIENCE_S = 600.0
FIRST, SECOND = default_skeleton(1.75), default_skeleton(1.60)
ANNA = Subject("Anna", FIRST, load_marker_set("boxing"))
SUBJECTS = (Subject("Ben", SECOND, load_marker_set("boxing")),)
SEEN = 4  # the pose in which the second performer is first seen
PLACE_M = 0.05  # of hips, as far as markers lie from the bones; the other performer stands 1.2 m aside
EXACT_M = 1e-5  # float32, as Blender keeps it


@pytest.fixture
def ben(shown: Any, tmp_path: Path) -> Any:
    """A further performer in the list."""
    save_subject(SUBJECTS[0], tmp_path / "ben.toml")
    entry = shown.entries.add()
    entry.kind, entry.subject = "PERFORMER", str(tmp_path / "ben.toml")
    return entry


def turned(skeleton: Any, number: int, heading_deg: float) -> np.ndarray:
    """A pose (J, 4): facing somewhere, an arm and a leg swung a little further in each frame."""
    result = rot.identity((len(skeleton),))
    heading = np.radians(heading_deg)
    result[0] = np.cos(heading / 2), 0.0, np.sin(heading / 2), 0.0
    for bone in ("lhumerus", "rfemur"):
        half = 0.01 * number
        result[skeleton.index(bone)] = np.cos(half), np.sin(half), 0.0, 0.0
    return result


def pose_of(number: int, rotations: np.ndarray, root_m: tuple[float, ...], sure: float) -> PerformerPose:
    none, single = np.full((9, 3), np.nan), np.full(9, -1)
    return PerformerPose(number, number / 60, rotations, np.array(root_m), sure, none, none, single, np.nan)


def moments(count: int) -> list[ScenePose]:
    """Poses of two who walk about, 60 a second; nothing is known of the second until the fifth."""
    found = []
    for n in range(count):
        place = (1.2 + 0.004 * n, 0.85, 0.1 + 0.01 * n)
        other = pose_of(n, turned(SECOND, n, 30.0 - n), place, 0.9 if n >= SEEN else 0.0)
        first = pose_of(n, turned(FIRST, n, n), (-0.6, 0.93, 0.005 * n), 0.9)
        found.append(ScenePose((first, other)))
    return found


@pytest.fixture
def play(part: Any, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Start a capture that gets one of the poses at each tick."""

    def start(poses: list[Any]) -> Any:
        run = SimpleNamespace(poses=[], persistent_warning="", activity="", take_preview=lambda: None)
        run.tick = lambda: run.poses.append(poses[len(run.poses)]) or run.poses[-1]
        run.shown = run.close = run.stop = lambda: None
        asked = SimpleNamespace(performers=(ANNA, *SUBJECTS), props=(), request={"take": ""}, start=lambda _: run)
        monkeypatch.setattr(part("capture.capture_request"), "make", lambda _chosen: asked)
        monkeypatch.setattr(part("take_library"), "mark_captured", lambda *_: None)
        bpy.context.scene.perfanim.overlay, bpy.context.scene.render.fps = set(), 60  # there are no cameras
        bpy.context.scene.frame_set(1)
        return part("capture.live_capture").LiveCapture(None, [])

    return start


def go_on(capture: Any, ticks: int) -> None:
    for _ in range(ticks):
        capture.tick(bpy.context)


def in_scene(armature: Any, bone: str = "root") -> tuple[np.ndarray, np.ndarray]:
    """Place (3,) and axes (3, 3), of length one, of a bone in the scene."""
    bpy.context.view_layer.update()
    obj = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
    matrix = obj.matrix_world @ obj.pose.bones[bone].matrix
    return np.array(matrix.translation), np.array(matrix.to_3x3().normalized())


def to_blender(point: np.ndarray) -> np.ndarray:
    x, y, z = point
    return np.array([x, -z, y])


def test_the_list_says_who_cannot_be_followed(part: Any, shown: Any, ben: Any, tmp_path: Path) -> None:
    targets, scene = part("settings.target_settings"), bpy.context.scene
    assert (targets.title(ben), targets.problem(scene)) == ("Ben", "")
    assert [subject.name for subject in targets.performers(scene)] == ["Ben"]
    assert targets.props(scene) == []
    ben.subject = str(tmp_path / "gone.toml")
    assert (targets.title(ben), "gone.toml" in targets.problem(scene)) == ("gone", True)
    ben.subject = ""
    assert (targets.title(ben), targets.problem(scene)) == ("Performer 2", "")
    scene.perfanim.practise = True
    assert "not calibrated" in targets.problem(scene)
    ben.subject = str(tmp_path / "ben.toml")
    assert targets.problem(scene) == ""
    scene.perfanim.armature = bpy.data.objects[part("character.create_character").create_character(bpy.context, FIRST)]
    ben.armature = scene.perfanim.armature
    assert "Performer: cannot follow two performers" in targets.problem(scene)
    ben.armature = bpy.data.objects.new("Lamp", bpy.data.armatures.new("Lamp"))
    assert targets.problem(scene).startswith("Lamp: ")
    ben.armature = None
    scene.perfanim.source, scene.perfanim.right_device = "CAMERAS", -1
    assert "one camera cannot tell several performers apart" in targets.problem(scene)


def test_what_the_worker_is_asked_for(part: Any, shown: Any, ben: Any) -> None:
    scene = bpy.context.scene
    build_path = str(part("preferences.paths").user_folder("databases") / "a.pfdb")
    build_database([str(MOTION / "boxing-01-neutral.bvh")], build_path, BuildSettings(fps=10.0))
    scene.perfanim.database, scene.perfanim.behaviour = build_path, "boxing"
    setup = part("capture.capture_request").make(scene.perfanim)
    assert [subject.name for subject in setup.performers[1:]] == ["Ben"]
    assert [subject.name for subject in setup.request.performers[1:]] == ["Ben"]
    assert [partner.behaviour for partner in setup.request.cameras.source.partners] == ["kendo"]
    shown.entries.clear()
    assert len(part("capture.capture_request").make(scene.perfanim).request.performers) == 1


def test_a_new_character_stands_beside_the_first_as_the_performers_do(part: Any, play: Any, ben: Any) -> None:
    capture, poses = play(moments(20)), moments(20)
    go_on(capture, SEEN)  # the first begins it
    character = bpy.context.scene.perfanim.armature
    np.testing.assert_allclose(in_scene(ben.armature)[0][:2], character.location[:2], atol=EXACT_M)  # not seen yet
    go_on(capture, 10)
    newest, second = poses[len(capture.run.poses) - 1], ben.armature
    assert second.name == "Ben" and character.name == "Performer"
    for armature, pose in zip((character, second), newest.performers, strict=True):
        place, _ = in_scene(armature)
        np.testing.assert_allclose(place - np.array(character.location), to_blender(pose.root_position_m), atol=EXACT_M)
    bpy.context.scene.frame_set(5)  # the timeline is free
    text = capture.keep(bpy.context)
    assert text == "13 frames recorded in Capture, Capture Ben"
    assert len(bpy.data.actions) == 2
    times = key_times(curves_of(second))
    np.testing.assert_allclose(times, np.arange(1.0 + SEEN, 14.0), atol=1e-3)
    rotations, roots = played_poses(second.name, times, SECOND)
    kept = [pose.performers[1] for pose in poses[SEEN:13]]
    np.testing.assert_allclose(roots, [pose.root_position_m for pose in kept], atol=EXACT_M)
    apart = np.abs(np.sum(rotations * np.array([pose.rotations for pose in kept]), axis=-1))
    np.testing.assert_allclose(apart, 1.0, atol=1e-6)
    capture.close()


def test_a_character_that_is_chosen_is_carried_into_the_room(part: Any, play: Any, ben: Any) -> None:
    """However it stands, and twice as large: there where its performer is first seen, from then on by its own steps."""
    chosen, create = bpy.context.scene.perfanim, part("character.create_character").create_character
    chosen.armature = bpy.data.objects[create(bpy.context, FIRST, "Anna")]
    chosen.armature.location, chosen.armature.rotation_euler = (1.0, 2.0, 0.5), (0.0, 0.0, 0.6)
    ben.armature = bpy.data.objects[create(bpy.context, SECOND, "Giant")]
    ben.armature.location, ben.armature.rotation_euler = (5.0, -3.0, 0.5), (0.0, 0.0, -1.1)
    ben.armature.scale = (2.0, 2.0, 2.0)
    bpy.context.view_layer.update()
    before = ben.armature.matrix_world.copy()
    room = np.array(chosen.armature.matrix_world)
    poses = moments(20)
    capture = play(poses)
    go_on(capture, 2 + SEEN)
    place, axes = in_scene(ben.armature)
    first = poses[SEEN].performers[1]
    wanted = room[:3, :3] @ to_blender(first.root_position_m) + room[:3, 3]
    # the floor is where the lowest joint is
    np.testing.assert_allclose(place[:2], wanted[:2], atol=EXACT_M)
    go_on(capture, 10)
    way = to_blender(poses[len(capture.run.poses) - 1].performers[1].root_position_m - first.root_position_m)
    later, _ = in_scene(ben.armature)
    np.testing.assert_allclose(later - place, 2.0 * room[:3, :3] @ way, atol=2 * EXACT_M)
    assert ben.armature.matrix_world == before  # the bones carry it
    text = capture.keep(bpy.context)
    capture.close()
    assert text.endswith("in Capture, Capture Ben")
    bpy.context.scene.frame_set(1 + SEEN)
    again, turned_axes = in_scene(ben.armature)
    np.testing.assert_allclose(again, place, atol=EXACT_M)
    np.testing.assert_allclose(turned_axes, axes, atol=1e-5)
    # it looks where its performer looks: as a character of the first's own room would
    twin = bpy.data.objects[create(bpy.context, SECOND, "Twin")]
    twin.matrix_world = chosen.armature.matrix_world
    part("capture.armature_driver").ArmatureDriver("Twin", SECOND).apply(first.rotations, first.root_position_m)
    for bone in ("root", "head", "lradius"):
        np.testing.assert_allclose(in_scene(ben.armature, bone)[1], in_scene(twin, bone)[1], atol=1e-4)


def test_each_recording_is_an_action_and_own_actions_are_given_back(part: Any, play: Any, ben: Any) -> None:
    chosen, create = bpy.context.scene.perfanim, part("character.create_character").create_character
    ben.armature = bpy.data.objects[create(bpy.context, SECOND, "Actor")]
    ben.armature.animation_data_create().action = old = bpy.data.actions.new("Old")
    chosen.record_by_button = True
    capture = play(moments(40))
    go_on(capture, 2 + SEEN)
    assert ben.armature.animation_data.action is None
    for ticks in (8, 5, 4):  # recorded, not, recorded
        capture.record(chosen)
        go_on(capture, ticks)
    text = capture.keep(bpy.context)
    capture.close()
    assert "Capture, Capture.001, Capture Ben, Capture Ben.001" in text
    assert ben.armature.animation_data.action is bpy.data.actions["Capture Ben.001"]
    assert old.use_fake_user


def test_nothing_recorded_leaves_the_scene_as_it_was(part: Any, play: Any, ben: Any) -> None:
    create = part("character.create_character").create_character
    ben.armature = bpy.data.objects[create(bpy.context, SECOND, "Actor")]
    ben.armature.animation_data_create().action = old = bpy.data.actions.new("Old")
    bpy.context.scene.perfanim.record_by_button = True
    capture = play(moments(20))
    go_on(capture, 12)
    assert capture.keep(bpy.context) == ""
    capture.close()
    assert ben.armature.animation_data.action is old
    assert list(bpy.data.actions) == [old]
    assert part("capture.live_capture")._after_frame_change not in bpy.app.handlers.frame_change_post


def test_a_character_deleted_meanwhile_does_no_harm(part: Any, play: Any, ben: Any) -> None:
    capture = play(moments(30))
    go_on(capture, 10)
    bpy.data.objects.remove(ben.armature)
    go_on(capture, 10)
    text = capture.keep(bpy.context)
    capture.close()
    assert text == "19 frames recorded in Capture, Capture Ben"
    assert ben.armature.animation_data.action is bpy.data.actions["Capture Ben"]  # the motion is not lost


def test_strips_and_selected_bones_count_for_all(part: Any, play: Any, ben: Any) -> None:
    chosen, create = bpy.context.scene.perfanim, part("character.create_character").create_character
    chosen.armature = bpy.data.objects[create(bpy.context, FIRST, "Anna")]
    ben.armature = bpy.data.objects[create(bpy.context, SECOND, "Actor")]
    bpy.context.scene.perfanim_result.onto = "STRIP"
    capture = play(moments(20))
    go_on(capture, 10)
    capture.keep(bpy.context)
    capture.close()
    assert [track.name for track in ben.armature.animation_data.nla_tracks] == ["Capture Ben"]
    bpy.context.scene.perfanim_result.only_selected = True
    for armature, bones in ((chosen.armature, {"head"}), (ben.armature, set())):
        for bone in armature.pose.bones:
            holder = bone if bpy.app.version >= (5, 0, 0) else bone.bone
            holder.select = bone.name in bones
    capture = play(moments(20))
    go_on(capture, 10)
    assert capture.keep(bpy.context).endswith("in Capture.001")  # of the second no bone is meant
    capture.close()
    assert len(ben.armature.animation_data.nla_tracks) == 1


def test_bones_of_another_armature_than_the_first_are_found_and_kept(part: Any, ben: Any) -> None:
    create, posing = part("character.create_character").create_character, part("character.posing")
    first = bpy.context.scene.perfanim.armature = bpy.data.objects[create(bpy.context, FIRST, "Anna")]
    other = bpy.data.objects[create(bpy.context, SECOND, "Other")]
    for bone in other.data.bones:
        bone.name = bone.name.replace("radius", "forearm")
    ben.armature = other
    kept = other.perfanim_character
    assert {entry.bone for entry in kept.joints if entry.name == "lradius"} == {"lforearm"}
    kept.joints["lradius"].bone = ""
    if bpy.context.window is not None:
        assert bpy.ops.perfanim.find_bones(armature="Other") == {"FINISHED"}
        assert kept.joints["lradius"].bone == "lforearm"
    assert not first.perfanim_character.joints
    assert not posing.map_problem(first)


def taken(part: Any, name: str) -> Path:
    """A take of the two, 20 frames."""
    database = {"path": "C:/data/walks.pfdb"}
    setup = TakeSetup.of(default_rig(), (ANNA, *SUBJECTS), {"method": "lwr"}, database, {})
    poses = moments(20)
    frames = [(0.0, MarkerFrame(pose.number, pose.time_s)) for pose in poses]
    path = part("take_library").folder() / f"{name}.perftake"
    write_whole_take(path, setup, TakeNotes(name), frames, [TimedPose(pose, 0.0) for pose in poses])
    part("take_library").forget()
    return path


def test_a_take_is_put_on_the_characters_that_are_meant(part: Any, shown: Any, ben: Any) -> None:
    path, create = taken(part, "duel"), part("character.create_character").create_character
    shown.entries.add()  # a prop
    other = shown.entries.add()
    other.kind = "PERFORMER"
    shown.entries.move(0, 2)  # Ben is the last now
    entries = {part("settings.target_settings").title(entry): entry for entry in shown.entries}
    meant = entries["Ben"].armature = bpy.data.objects[create(bpy.context, SECOND, "Meant")]
    bpy.context.scene.render.fps = 60
    bpy.context.scene.frame_set(11)
    assert bpy.ops.perfanim.play_take(path=str(path)) == {"FINISHED"}
    text, _ = part("jobs.activity").message("takes")
    assert text == "20 frames in duel, duel Ben on Performer"
    times = key_times(curves_of(meant))
    np.testing.assert_allclose(times, np.arange(11.0 + SEEN, 31.0), atol=1e-3)
    character = bpy.context.scene.perfanim.armature
    bpy.context.scene.frame_set(25)
    apart = in_scene(meant)[0] - in_scene(character)[0]
    pose, other = moments(20)[14].performers
    np.testing.assert_allclose(apart, to_blender(other.root_position_m - pose.root_position_m), atol=EXACT_M)
    # where none is of that name, the first in the list; where there is none at all, a new character
    entries["Ben"].subject = "gone.toml"
    bpy.ops.perfanim.play_take(path=str(path))
    first = entries["Performer 2"].armature
    assert (first.name, first.animation_data.action.name) == ("Ben", "duel Ben.001")
    shown.entries.clear()
    bpy.ops.perfanim.play_take(path=str(path))
    assert bpy.data.objects["Ben.001"].animation_data.action.name == "duel Ben.002"


def test_a_take_names_all_and_each_can_be_exported(part: Any, ben: Any, tmp_path: Path) -> None:
    path = taken(part, "duel")
    part("panels.takes_panel")._fill()
    (item,) = bpy.context.window_manager.perfanim_takes.entries
    assert part("panels.takes_panel").origin_of(item.summary) == "Anna and Ben, boxing, lwr, database walks"
    given = {"path": str(path), "kind": "BVH"}
    with pytest.raises(RuntimeError, match="Ben: the performer has no character"):
        bpy.ops.perfanim.export_take(**given, filepath=str(tmp_path / "b.bvh"), performer=2)
    with pytest.raises(RuntimeError, match="has 2 performers"):
        bpy.ops.perfanim.export_take(**given, filepath=str(tmp_path / "b.bvh"), performer=3)
    bpy.ops.perfanim.play_take(path=str(path))
    for performer, name in ((1, "Anna"), (2, "Ben")):
        target = tmp_path / f"{name}.bvh"
        bpy.ops.perfanim.export_take(**given, filepath=str(target), performer=performer)
        on = bpy.context.scene.perfanim.armature if performer == 1 else ben.armature
        assert part("jobs.activity").message("takes")[0] == f"20 frames of duel ({name}) on {on.name} in {target}"
        assert read_bvh(target).frames == 20
    bpy.ops.perfanim.export_take(path=str(path), kind="ANGLES", filepath=str(tmp_path / "b.angles.csv"), performer=2)
    assert part("jobs.activity").message("takes")[0].startswith("20 frames of duel (Ben) in ")


def test_two_before_the_cameras_live_and_solved_again(part: Any, shown: Any, tmp_path: Path) -> None:
    live, scene = part("capture.live_capture"), bpy.context.scene
    build_database([str(MOTION)], tmp_path / "two.pfdb", BuildSettings(fps=10.0))
    scene.perfanim.database, scene.perfanim.behaviour = str(tmp_path / "two.pfdb"), "kendo"
    scene.perfanim.feet = "off"  # shown as the take has it
    scene.render.fps = 60
    scene.frame_set(1)
    shown.entries.add().kind = "PERFORMER"
    source = {"behaviour": "kendo", "height_m": 1.75, "partners": [{"behaviour": "boxing"}]}
    truth = [one.motion for one in open_simulated(source).performance.everybody]
    capture = live.LiveCapture(None, [])
    limit = time.monotonic() + PATIENCE_S

    def tick_until(condition: Callable[[], bool]) -> None:
        while not condition():
            assert not capture.done, capture.run.error
            assert time.monotonic() < limit, capture.line
            capture.tick(bpy.context)
            time.sleep(1 / 60)

    try:
        tick_until(lambda: capture.run is not None and len(capture.run.poses) >= 20)
        capture.stop()
        tick_until(lambda: capture.done)
        text = capture.keep(bpy.context)
    finally:
        capture.close()
    poses = capture.run.poses
    assert "in Capture, Capture Performer 2" in text
    characters = scene.perfanim.armature, shown.entries[0].armature
    for pose in (poses[len(poses) // 2], poses[-1]):
        scene.frame_set(round(1 + 60 * (pose.time_s - poses[0].time_s)))
        for armature, motion in zip(characters, truth, strict=True):
            place = in_scene(armature)[0] - np.array(scene.perfanim.armature.location)
            true = motion.root_positions_m[round(pose.number / 60 * motion.fps)]
            assert np.linalg.norm(place - to_blender(true)) < PLACE_M
    take = read_take_file(part("take_library").listed()[0].path)
    for solved, pose in zip(take.poses, poses, strict=True):
        np.testing.assert_array_equal(solved.pose.performers[1].rotations, pose.performers[1].rotations)
    chosen = {"database": "CHOSEN", "performer": "RECORDED", "cameras": "RECORDED", "put_on": True}
    operator = part("operators.solve_takes").PERFANIM_OT_solve_take
    text = run_job(part, operator, SimpleNamespace(path=str(take.path), method="nearest", **chosen))
    name = f"{take.notes.name} (nearest)"
    assert text.startswith(f"{len(poses)} frames in {name}, {name} Performer 2 on ")
    assert part("take_library").listed()[0].performers[1:] == ("Performer 2",)
