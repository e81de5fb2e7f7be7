"""Several performers: each moves a character of their own, which stand to each other as the performers do."""

from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from clicked import run_job
from perfanim.core.body.scene_pose import ScenePose
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.formats.motion.bvh import read_bvh
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject, save_subject
from perfanim.core.simulate.studio.simulated_source import open_simulated
from perfanim.core.system.assets import MOTION
from played import curves_of, key_times, played_poses, points_to_blender, select_bones
from solved_poses import performer_pose, write_poses
from ticking import stop_and_keep, tick, tick_poses

pytestmark = pytest.mark.usefixtures("as_recorded")

FIRST, SECOND = default_skeleton(1.75), default_skeleton(1.60)
ANNA = Subject("Anna", FIRST, load_marker_set("boxing"))
BEN = Subject("Ben", SECOND, load_marker_set("boxing"))
SEEN = 4  # index of the first pose in which the second performer is seen
PLACE_M = 0.05  # error of the hips: as far as markers lie from the bones; the other performer stands 1.2 m aside
EXACT_M = 1e-5  # Blender keeps float32


@pytest.fixture(autouse=True)
def timeline(addon: Any) -> None:
    """Poses fall on the scene's frames, from the first."""
    bpy.context.scene.render.fps = 60
    bpy.context.scene.frame_set(1)


@pytest.fixture
def ben(targets: Any, tmp_path: Path) -> Any:
    """A further performer in the list."""
    save_subject(BEN, tmp_path / "ben.toml")
    entry = targets.entries.add()
    entry.kind, entry.subject = "PERFORMER", str(tmp_path / "ben.toml")
    return entry


def rotations(skeleton: Any, number: int, heading_deg: float) -> np.ndarray:
    """A pose (J, 4) with a heading; an arm and a leg swing a little further in each frame."""
    result = rot.identity((len(skeleton),))
    heading = np.radians(heading_deg)
    result[0] = np.cos(heading / 2), 0.0, np.sin(heading / 2), 0.0
    for bone in ("lhumerus", "rfemur"):
        half = 0.01 * number
        result[skeleton.index(bone)] = np.cos(half), np.sin(half), 0.0, 0.0
    return result


def duel(count: int) -> list[ScenePose]:
    """Poses of two who walk about, 60 a second; nothing is known of the second until the fifth."""
    found = []
    for n in range(count):
        place = (1.2 + 0.004 * n, 0.85, 0.1 + 0.01 * n)
        other = performer_pose(n, rotations(SECOND, n, 30.0 - n), place, 0.9 if n >= SEEN else 0.0)
        first = performer_pose(n, rotations(FIRST, n, n), (-0.6, 0.93, 0.005 * n))
        found.append(ScenePose((first, other)))
    return found


def in_scene(armature: Any, bone: str = "hips") -> tuple[np.ndarray, np.ndarray]:
    """Place (3,) and axes (3, 3), of length one, of a bone in the scene."""
    bpy.context.view_layer.update()
    obj = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
    matrix = obj.matrix_world @ obj.pose.bones[bone].matrix
    return np.array(matrix.translation), np.array(matrix.to_3x3().normalized())


def test_the_list_says_who_cannot_be_followed(
    part: Any, chosen: Any, new_character: Any, ben: Any, tmp_path: Path
) -> None:
    module, scene = part("settings.target_settings"), bpy.context.scene

    def problem() -> str:
        return str(module.problem(scene))

    assert (module.title(ben), problem()) == ("Ben", "")
    assert [subject.name for subject in module.performers(scene)] == ["Ben"]
    assert module.props(scene) == []
    ben.subject = str(tmp_path / "gone.toml")
    assert module.title(ben) == "gone" and "gone.toml" in problem()
    ben.subject = ""
    assert (module.title(ben), problem()) == ("Performer 2", "")
    chosen.practise = True
    assert "Performer 2: has no subject" in problem()
    ben.subject = str(tmp_path / "ben.toml")
    assert problem() == ""
    ben.armature = chosen.armature = new_character(FIRST)
    assert "Performer: cannot follow two performers" in problem()
    ben.armature = bpy.data.objects.new("Lamp", bpy.data.armatures.new("Lamp"))
    assert problem().startswith("Lamp: ")
    ben.armature = None
    chosen.source, chosen.right_device = "CAMERAS", -1
    assert "one camera cannot tell several performers apart" in problem()


def test_the_request_has_the_performers(part: Any, chosen: Any, targets: Any, ben: Any, tmp_path: Path) -> None:
    build_database([str(MOTION / "boxing-01-neutral.bvh")], tmp_path / "a.pfdb", BuildSettings(fps=10.0))
    chosen.database, chosen.behaviour = str(tmp_path / "a.pfdb"), "boxing"
    setup = part("capture.capture_request").make(chosen)
    assert [subject.name for subject in setup.performers[1:]] == ["Ben"]
    assert [subject.name for subject in setup.request.performers[1:]] == ["Ben"]
    assert [partner.behaviour for partner in setup.request.cameras.source.partners] == ["kendo"]
    targets.entries.clear()
    assert len(part("capture.capture_request").make(chosen).request.performers) == 1


def test_a_new_character_stands_beside_the_first_as_the_performers_do(chosen: Any, play: Any, ben: Any) -> None:
    capture, poses = play(duel(20), ANNA, BEN), duel(20)
    tick(capture, SEEN)  # the first begins it
    character = chosen.armature
    np.testing.assert_allclose(in_scene(ben.armature)[0][:2], character.location[:2], atol=EXACT_M)  # not seen yet
    tick(capture, 10)
    newest, second = poses[len(capture.run.poses) - 1], ben.armature
    assert second.name == "Ben" and character.name == "Performer"
    for armature, pose in zip((character, second), newest.performers, strict=True):
        place, _ = in_scene(armature)
        np.testing.assert_allclose(
            place - np.array(character.location), points_to_blender(pose.root_position_m), atol=EXACT_M
        )
    bpy.context.scene.frame_set(5)  # the timeline is free
    text = capture.keep(bpy.context)
    assert text == "13 frames recorded in Capture, Capture Ben: 0.2 s, scene frames 1 to 13"
    assert len(bpy.data.actions) == 2
    times = key_times(curves_of(second))
    np.testing.assert_allclose(times, np.arange(1.0 + SEEN, 14.0), atol=1e-3)
    shown, roots = played_poses(second.name, times, SECOND)
    kept = [pose.performers[1] for pose in poses[SEEN:13]]
    np.testing.assert_allclose(roots, [pose.root_position_m for pose in kept], atol=EXACT_M)
    apart = np.abs(np.sum(shown * np.array([pose.rotations for pose in kept]), axis=-1))
    np.testing.assert_allclose(apart, 1.0, atol=1e-6)
    capture.close()


def test_a_character_that_is_chosen_is_carried_into_the_room(
    part: Any, chosen: Any, play: Any, ben: Any, new_character: Any
) -> None:
    """However it stands, and twice as large: there where its performer is first seen, from then on by its own steps."""
    chosen.armature = new_character(FIRST, "Anna")
    chosen.armature.location, chosen.armature.rotation_euler = (1.0, 2.0, 0.5), (0.0, 0.0, 0.6)
    ben.armature = new_character(SECOND, "Giant")
    ben.armature.location, ben.armature.rotation_euler = (5.0, -3.0, 0.5), (0.0, 0.0, -1.1)
    ben.armature.scale = (2.0, 2.0, 2.0)
    bpy.context.view_layer.update()
    before = ben.armature.matrix_world.copy()
    room = np.array(chosen.armature.matrix_world)
    poses = duel(20)
    capture = play(poses, ANNA, BEN)
    tick(capture, 2 + SEEN)
    place, axes = in_scene(ben.armature)
    first = poses[SEEN].performers[1]
    wanted = room[:3, :3] @ points_to_blender(first.root_position_m) + room[:3, 3]
    # the floor is where the lowest joint is
    np.testing.assert_allclose(place[:2], wanted[:2], atol=EXACT_M)
    tick(capture, 10)
    way = points_to_blender(poses[len(capture.run.poses) - 1].performers[1].root_position_m - first.root_position_m)
    later, _ = in_scene(ben.armature)
    np.testing.assert_allclose(later - place, 2.0 * room[:3, :3] @ way, atol=2 * EXACT_M)
    assert ben.armature.matrix_world == before  # the bones carry it
    text = capture.keep(bpy.context)
    capture.close()
    assert "in Capture, Capture Ben: " in text
    bpy.context.scene.frame_set(1 + SEEN)
    again, turned_axes = in_scene(ben.armature)
    np.testing.assert_allclose(again, place, atol=EXACT_M)
    np.testing.assert_allclose(turned_axes, axes, atol=1e-5)
    # it looks where its performer looks: as a character of the first's own room would
    twin = new_character(SECOND, "Twin")
    twin.matrix_world = chosen.armature.matrix_world
    part("capture.armature_driver").ArmatureDriver("Twin", SECOND).apply(first.rotations, first.root_position_m)
    for bone in ("hips", "head", "forearm.L"):
        np.testing.assert_allclose(in_scene(ben.armature, bone)[1], in_scene(twin, bone)[1], atol=1e-4)


def test_each_recording_is_an_action_and_own_actions_are_given_back(
    chosen: Any, play: Any, ben: Any, new_character: Any
) -> None:
    ben.armature = new_character(SECOND, "Actor")
    ben.armature.animation_data_create().action = old = bpy.data.actions.new("Old")
    chosen.record_by_button = True
    capture = play(duel(40), ANNA, BEN)
    tick(capture, 2 + SEEN)
    assert ben.armature.animation_data.action is None
    for ticks in (8, 5, 4):  # recorded, not, recorded
        capture.record(chosen)
        tick(capture, ticks)
    text = capture.keep(bpy.context)
    capture.close()
    assert "Capture, Capture.001, Capture Ben, Capture Ben.001" in text
    assert ben.armature.animation_data.action is bpy.data.actions["Capture Ben.001"]
    assert old.use_fake_user


def test_nothing_recorded_leaves_the_scene_as_it_was(
    part: Any, chosen: Any, play: Any, ben: Any, new_character: Any
) -> None:
    ben.armature = new_character(SECOND, "Actor")
    ben.armature.animation_data_create().action = old = bpy.data.actions.new("Old")
    chosen.record_by_button = True
    capture = play(duel(20), ANNA, BEN)
    tick(capture, 12)
    assert capture.keep(bpy.context) == ""
    capture.close()
    assert ben.armature.animation_data.action is old
    assert list(bpy.data.actions) == [old]
    assert part("capture.live_capture")._after_frame_change not in bpy.app.handlers.frame_change_post


def test_a_character_deleted_meanwhile_does_no_harm(play: Any, ben: Any) -> None:
    capture = play(duel(30), ANNA, BEN)
    tick(capture, 10)
    bpy.data.objects.remove(ben.armature)
    tick(capture, 10)
    text = capture.keep(bpy.context)
    capture.close()
    assert text == "19 frames recorded in Capture, Capture Ben: 0.3 s, scene frames 1 to 19"
    assert ben.armature.animation_data.action is bpy.data.actions["Capture Ben"]  # the motion is not lost


def test_strips_and_selected_bones_count_for_all(chosen: Any, play: Any, ben: Any, new_character: Any) -> None:
    chosen.armature = new_character(FIRST, "Anna")
    ben.armature = new_character(SECOND, "Actor")
    bpy.context.scene.perfanim_result.onto = "STRIP"
    capture = play(duel(20), ANNA, BEN)
    tick(capture, 10)
    capture.keep(bpy.context)
    capture.close()
    assert [track.name for track in ben.armature.animation_data.nla_tracks] == ["Capture Ben"]
    bpy.context.scene.perfanim_result.only_selected = True
    for armature, bones in ((chosen.armature, {"head"}), (ben.armature, set())):
        select_bones(armature, bones)
    capture = play(duel(20), ANNA, BEN)
    tick(capture, 10)
    assert "in Capture.001: " in capture.keep(bpy.context)  # of the second no bone is meant
    capture.close()
    assert len(ben.armature.animation_data.nla_tracks) == 1


def test_bones_of_another_armature_than_the_first_are_found_and_kept(
    part: Any, chosen: Any, ben: Any, new_character: Any
) -> None:
    first = chosen.armature = new_character(FIRST, "Anna")
    other = new_character(SECOND, "Other")
    for bone in other.data.bones:
        bone.name = bone.name.replace("forearm", "lower_arm")
    ben.armature = other
    kept = other.perfanim_character
    assert {entry.bone for entry in kept.joints if entry.name == "lradius"} == {"lower_arm.L"}
    kept.joints["lradius"].bone = ""
    if bpy.context.window is not None:
        assert bpy.ops.perfanim.find_bones(armature="Other") == {"FINISHED"}
        assert kept.joints["lradius"].bone == "lower_arm.L"
    assert not first.perfanim_character.joints
    assert not part("character.retarget_plans").map_problem(first)


@pytest.fixture
def take(part: Any) -> str:
    """A take of the two, 20 frames."""
    path = write_poses(part("take_library").folder(), "duel", (ANNA, BEN), duel(20))
    part("take_library").forget()
    return str(path)


def test_a_take_is_put_on_the_characters_that_are_meant(
    part: Any, chosen: Any, targets: Any, ben: Any, take: str, new_character: Any
) -> None:
    targets.entries.add()  # a prop
    other = targets.entries.add()
    other.kind = "PERFORMER"
    targets.entries.move(0, 2)  # Ben is the last now
    entries = {part("settings.target_settings").title(entry): entry for entry in targets.entries}
    meant = entries["Ben"].armature = new_character(SECOND, "Meant")
    bpy.context.scene.frame_set(11)
    assert bpy.ops.perfanim.play_take(path=take) == {"FINISHED"}
    text, _ = part("jobs.activity").message("takes")
    assert text == "20 frames in duel, duel Ben on Performer"
    times = key_times(curves_of(meant))
    np.testing.assert_allclose(times, np.arange(11.0 + SEEN, 31.0), atol=1e-3)
    bpy.context.scene.frame_set(25)
    apart = in_scene(meant)[0] - in_scene(chosen.armature)[0]
    pose, other = duel(20)[14].performers
    np.testing.assert_allclose(apart, points_to_blender(other.root_position_m - pose.root_position_m), atol=EXACT_M)
    # where none is of that name, the first in the list; where there is none at all, a new character
    entries["Ben"].subject = "gone.toml"
    bpy.ops.perfanim.play_take(path=take)
    first = entries["Performer 2"].armature
    assert (first.name, first.animation_data.action.name) == ("Ben", "duel Ben.001")
    targets.entries.clear()
    bpy.ops.perfanim.play_take(path=take)
    assert bpy.data.objects["Ben.001"].animation_data.action.name == "duel Ben.002"


def test_a_take_names_all_and_each_can_be_exported(
    part: Any, chosen: Any, ben: Any, take: str, listed_takes: Any, tmp_path: Path
) -> None:
    (item,) = listed_takes()
    assert (
        part("panels.takes_panel").origin_of(item.summary) == "Anna and Ben, markers boxing, method lwr, database walks"
    )
    given = {"path": take, "kind": "BVH"}
    with pytest.raises(RuntimeError, match="Ben: the performer has no character"):
        bpy.ops.perfanim.export_take(**given, filepath=str(tmp_path / "b.bvh"), performer=2)
    with pytest.raises(RuntimeError, match="has no performer 3, only 2; choose 1 to 2"):
        bpy.ops.perfanim.export_take(**given, filepath=str(tmp_path / "b.bvh"), performer=3)
    bpy.ops.perfanim.play_take(path=take)
    for performer, name in ((1, "Anna"), (2, "Ben")):
        target = tmp_path / f"{name}.bvh"
        bpy.ops.perfanim.export_take(**given, filepath=str(target), performer=performer)
        on = chosen.armature if performer == 1 else ben.armature
        assert part("jobs.activity").message("takes")[0] == f"20 frames of duel ({name}) on {on.name} in {target}"
        assert read_bvh(target).frames == 20
    bpy.ops.perfanim.export_take(path=take, kind="ANGLES", filepath=str(tmp_path / "b.angles.csv"), performer=2)
    assert part("jobs.activity").message("takes")[0].startswith("20 frames of duel (Ben) in ")


@pytest.mark.long
@pytest.mark.usefixtures("near_worker")
def test_two_before_the_cameras_live_and_solved_again(
    part: Any, chosen: Any, targets: Any, new_capture: Any, tmp_path: Path
) -> None:
    clips = [str(path) for name in ("kendo", "boxing") for path in MOTION.glob(f"{name}-*.bvh")]
    build_database(clips, tmp_path / "two.pfdb", BuildSettings(fps=10.0))
    chosen.database, chosen.behaviour = str(tmp_path / "two.pfdb"), "kendo"
    chosen.feet = "off"  # shown as the take has it
    targets.entries.add().kind = "PERFORMER"
    source = {"behaviour": "kendo", "height_m": 1.75, "at_once": True, "partners": [{"behaviour": "boxing"}]}
    truth = [one.motion for one in open_simulated(source).performance.everybody]
    with closing(new_capture()) as capture:
        tick_poses(capture, 20)
        text = stop_and_keep(capture)
    poses = capture.run.poses
    assert "in Capture, Capture Performer 2" in text
    characters = chosen.armature, targets.entries[0].armature
    for pose in (poses[len(poses) // 2], poses[-1]):
        bpy.context.scene.frame_set(round(1 + 60 * (pose.time_s - poses[0].time_s)))
        for armature, motion in zip(characters, truth, strict=True):
            place = in_scene(armature)[0] - np.array(chosen.armature.location)
            true = motion.root_positions_m[round(pose.number / 60 * motion.fps)]
            assert np.linalg.norm(place - points_to_blender(true)) < PLACE_M
    take = read_take_file(part("take_library").listed()[0].path)
    for solved, pose in zip(take.poses, poses, strict=True):
        np.testing.assert_array_equal(solved.pose.performers[1].rotations, pose.performers[1].rotations)
    given = {"database": "CHOSEN", "performer": "RECORDED", "cameras": "RECORDED", "put_on": True}
    operator = part("operators.solve_takes").PERFANIM_OT_solve_take
    text = run_job(part, operator, SimpleNamespace(path=str(take.path), method="nearest", **given))
    name = f"{take.notes.name.replace('.', ':')} (nearest)"
    assert text.startswith(f"{len(poses)} frames in {name}, {name} Performer 2 on ")
    assert part("take_library").listed()[0].performers[1:] == ("Performer 2",)
