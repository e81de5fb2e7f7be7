"""Recorded takes in Blender: kept by every capture, listed, recovered, played, solved again, renamed, deleted."""

import os
import shutil
import signal
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from clicked import run_job
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.formats.take_file.chunks import scan
from perfanim.core.formats.take_file.pose_codec import TimedPose, pack_solved
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.formats.take_file.take_setup import TakeNotes, TakeSetup
from perfanim.core.formats.take_file.take_writer import TakeWriter
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_frame_codec import pack_stamped
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.simulate.studio.studio_rig import default_rig
from played import curves_of, key_times
from solved_poses import scene_pose
from ticking import tick_poses


@pytest.fixture
def takes(part: Any) -> Iterator[Any]:
    """The library, empty before and after."""
    library = part("take_library")

    def clear() -> None:
        shutil.rmtree(library.folder())
        library.forget()

    clear()
    yield library
    clear()


def write_take(folder: Path, name: str, frames: int = 30, poses: int = 30, orphaned: bool = False) -> Path:
    """A take of somebody who stands in the rest pose and rises."""
    subject = Subject("Anna", default_skeleton(1.7), load_marker_set("boxing"))
    setup = TakeSetup.of(default_rig(), (subject,), {}, {}, {})
    writer = TakeWriter(folder / f"{name}.perftake", setup, TakeNotes(name))
    for number in range(frames):
        writer.add_frame(pack_stamped(0.0, MarkerFrame(number, number / 60)))
        if number < poses:
            pose = scene_pose(number, None, (0.0, 1.0 + number / 60, 0.0), 0.5)
            writer.add_pose(pack_solved(TimedPose(pose, 0.0)))
    writer.close(orphaned)
    return writer.path


def cut(path: Path) -> Path:
    """The same file without its last chunk."""
    last = scan(path.read_bytes(), "")[0][-1]
    path.write_bytes(path.read_bytes()[: last.offset + 30])
    return path


@pytest.mark.usefixtures("near_worker")
@pytest.mark.usefixtures("as_recorded")
def test_a_worker_that_is_killed_leaves_a_take_that_can_be_recovered(
    part: Any, chosen: Any, takes: Any, new_capture: Any, listed_takes: Any
) -> None:
    chosen.feet = "off"  # shown as the take has it
    with closing(new_capture()) as capture:  # closed as with a Blender that is killed, too: nobody starts another
        tick_poses(capture, 30)
        assert takes.cut_off() == []  # it is being recorded
        os.kill(capture.run._client.process_id, getattr(signal, "SIGKILL", signal.SIGTERM))  # Windows has one way
    received = [pose.number for pose in capture.run.poses]
    path = takes.cut_off()[0].path
    assert len(read_take_file(path).poses) >= len(received) - 30  # half a second
    operator = part("operators.put_on_character").PERFANIM_OT_recover_take
    text = run_job(part, operator, SimpleNamespace(path=str(path)))
    whole = read_take_file(path.with_name(f"{path.stem} recovered.perftake"))
    assert whole.complete
    assert text.startswith(f"{len(whole.frames)} frames recovered, ")
    assert takes.cut_off() == []
    assert path.with_name(path.name + ".cut").exists()  # set aside, not deleted
    for solved, pose in zip(whole.poses, capture.run.poses, strict=False):
        np.testing.assert_array_equal(solved.pose.performers[0].rotations, pose.performers[0].rotations)
    assert len(key_times(curves_of(chosen.armature))) == len(whole.poses)
    again = part("operators.solve_takes").PERFANIM_OT_solve_take
    as_before = {"database": "RECORDED", "performer": "RECORDED", "cameras": "RECORDED", "put_on": True}
    text = run_job(part, again, SimpleNamespace(path=str(whole.path), method="lwr", **as_before))
    name = whole.notes.name.replace(".", ":")  # as a time of day
    assert text.startswith(f"{len(whole.frames)} frames in {name} (lwr) on {chosen.armature.name}")
    assert [item.title for item in listed_takes()] == [f"{whole.notes.name} (lwr)", whole.notes.name]


def test_a_take_that_is_listed_already_can_still_be_chosen(part: Any, takes: Any, listed_takes: Any) -> None:
    """The panel may be drawn between the end of a take's file and the operator that selects it."""
    panel = part("panels.takes_panel")
    write_take(takes.folder(), "older")
    write_take(takes.folder(), "newer")
    listed_takes()
    other = next(path for path in panel._paths() if path != panel.active_path(bpy.context))
    assert not bpy.app.timers.is_registered(panel._fill)
    panel.choose(Path(other))
    panel._list(bpy.context)  # as the panel is drawn next
    assert bpy.app.timers.is_registered(panel._fill)
    bpy.app.timers.unregister(panel._fill)
    panel._fill()
    assert panel.active_path(bpy.context) == other
    panel._list(bpy.context)
    assert not bpy.app.timers.is_registered(panel._fill)


def test_the_list_shows_what_is_in_the_folder(part: Any, takes: Any, listed_takes: Any) -> None:
    folder = takes.folder()
    assert listed_takes() == []
    write_take(folder, "walk")
    cut(write_take(folder, "jump"))
    write_take(folder, "stand", frames=0)
    (folder / "words.perftake").write_text("no take at all, but some words of somebody")
    (folder / "other.txt").write_text("x")
    cut(write_take(folder, "nothing", frames=0))
    shutil.copy(folder / "walk.perftake", folder / ".walk (best).x7f_1.perftake")  # a copy that is being written
    writer = TakeWriter(folder / "running.perftake", read_take_file(folder / "walk.perftake").setup)
    writer.add_frame(pack_stamped(0.0, MarkerFrame(0, 0.0)))
    try:
        rows = {item.title: item for item in listed_takes()}
        assert len(listed_takes()) == 3
        assert set(rows) == {"walk", "jump", "stand"}
        assert rows["walk"].summary.complete
        assert part("panels.takes_panel")._length(rows["walk"].summary) == "0:00"
        assert not rows["jump"].summary.complete
        assert [take.path for take in takes.cut_off()] == [folder / "jump.perftake"]
    finally:
        writer.close()
    takes.forget()
    assert "running" in {item.title for item in listed_takes()}


def test_a_take_that_goes_while_the_folder_is_read_is_no_error(monkeypatch: pytest.MonkeyPatch, takes: Any) -> None:
    for name in ("walk", "jump"):
        write_take(takes.folder(), name)
    summarise = takes.summarise

    def deleted(path: Path) -> Any:
        summary = summarise(path)
        if path.stem == "walk":
            path.unlink()
        return replace(summary, created="")

    monkeypatch.setattr(takes, "summarise", deleted)
    takes.forget()
    assert "jump" in {take.path.stem for take in takes.listed()}
    monkeypatch.undo()
    takes.forget()
    assert [take.path.stem for take in takes.listed()] == ["jump"]


def test_name_notes_and_rating_are_kept_in_the_file(part: Any, takes: Any, listed_takes: Any) -> None:
    path = write_take(takes.folder(), "walk")
    (item,) = listed_takes()
    item.title, item.notes, item.rating = "Gang 1", "left foot slides", 4
    assert read_take_file(path).notes == TakeNotes("Gang 1", "left foot slides", 4)
    size = path.stat().st_size
    (item,) = listed_takes()
    assert (item.title, item.rating) == ("Gang 1", 4)
    assert path.stat().st_size == size  # to show it is not to change it
    cut(path)
    item.rating = 1
    assert "was cut off; recover the take first" in part("jobs.activity").message("takes")[0]


def test_a_take_is_put_on_the_character(part: Any, chosen: Any, takes: Any) -> None:
    path = write_take(takes.folder(), "walk", frames=30, poses=20)
    bpy.context.scene.render.fps = 60
    bpy.context.scene.frame_current = 11
    text, actions = part("operators.put_on_character").put_on_character(bpy.context, path)
    armature = chosen.armature
    assert text == f"20 frames in walk on {armature.name}; 10 more frames without a pose: use Solve Again"
    assert actions == ("walk",)
    np.testing.assert_allclose(key_times(curves_of(armature)), np.arange(11, 31), atol=1e-3)
    with pytest.raises(Exception, match="has no solved poses"):
        part("operators.put_on_character").put_on_character(bpy.context, write_take(path.parent, "none", poses=0))


def test_a_capture_that_outlived_blender_is_offered_until_it_is_on_a_character(
    part: Any, takes: Any, listed_takes: Any
) -> None:
    path = write_take(takes.folder(), "walk", orphaned=True)
    assert [take.path for take in takes.cut_off()] == [path]
    part("operators.put_on_character").put_on_character(bpy.context, path)
    assert takes.cut_off() == []
    assert [item.title for item in listed_takes()] == ["walk"]


def test_takes_belong_to_the_file_in_which_they_were_put_on_a_character(
    part: Any, takes: Any, listed_takes: Any, tmp_path: Path
) -> None:
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    for name in ("walk", "run"):
        write_take(takes.folder(), name)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert takes.in_project() == []
    takes.mark_played(takes.folder() / "walk.perftake", "Hero")
    assert [take.notes.name for take in takes.in_project()] == ["walk"]
    bpy.context.window_manager.perfanim_takes.this_file = True
    assert [item.title for item in listed_takes()] == ["walk"]
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    takes.mark_played(takes.folder() / "walk.perftake", "Other")  # the project stays
    assert len(takes.in_project()) == 2  # an unsaved file has none of its own
    takes.mark_played(takes.folder() / "run.perftake", "Other")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "other.blend"))
    assert [take.notes.name for take in takes.in_project()] == ["run"]  # it was put on a character before
    bpy.context.window_manager.perfanim_takes.this_file = False
