"""Whatever runs is ended on every way out."""

from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest


class PlayedActivity:
    """Remembers that it was closed."""

    closed = 0
    kept = 0

    def close(self) -> None:
        self.closed += 1

    def keep(self, context: bpy.types.Context) -> str:
        self.kept += 1
        return "kept"


@pytest.fixture
def running(part: Any) -> Any:
    return part("jobs.activity")


@pytest.fixture
def activity(running: Any) -> PlayedActivity:
    activity = PlayedActivity()
    running.begin(bpy.context, activity, 0.1)
    assert running.current() is activity
    assert running._state.timer is not None
    running.picture_overlay.show(np.zeros((4, 6, 3), np.uint8), "look here")
    assert running.picture_overlay.NAME in bpy.data.images
    scene, pose = SimpleNamespace(), SimpleNamespace()
    running.overlay.show(scene, pose, frozenset({"MARKERS"}))
    return activity


def gone(running: Any, activity: PlayedActivity) -> bool:
    shown = running.picture_overlay.handler.added or running.picture_overlay.NAME in bpy.data.images
    shown = shown or running.overlay.handler.added
    return activity.closed == 1 and running.current() is None and running._state.timer is None and not shown


def test_the_preview_is_the_picture_and_changes_its_size(running: Any, activity: PlayedActivity) -> None:
    picture = np.random.default_rng(0).integers(0, 255, (5, 7, 3)).astype(np.uint8)
    running.picture_overlay.show(picture, "")
    image = bpy.data.images[running.picture_overlay.NAME]
    pixels = np.array(image.pixels[:]).reshape(5, 7, 4)
    np.testing.assert_array_equal(np.rint(pixels[::-1, :, :3] * 255), picture)
    assert image.users == 0  # so it is not saved with the file


def test_ended_once(running: Any, activity: PlayedActivity) -> None:
    running.end()
    running.end()
    assert gone(running, activity)


def test_ended_when_another_file_is_loaded(running: Any, activity: PlayedActivity) -> None:
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert gone(running, activity)
    assert activity.kept == 1


def test_ended_when_the_addon_is_switched_off(running: Any, activity: PlayedActivity, extension: str) -> None:
    import addon_utils

    addon_utils.disable(extension, default_set=True)
    assert gone(running, activity)
    assert activity.kept == 1
    addon_utils.enable(extension, default_set=True)


def test_ended_when_something_else_begins(running: Any, activity: PlayedActivity) -> None:
    other = PlayedActivity()
    running.begin(bpy.context, other, 0.1)
    assert activity.closed == 1
    assert running.current() is other
    running.end()


def test_buttons_are_greyed_and_say_why_while_something_runs(running: Any, activity: PlayedActivity) -> None:
    for operator in ("start_capture", "add_character", "build_database"):
        with pytest.raises(RuntimeError, match="Perfanim is busy"):
            getattr(bpy.ops.perfanim, operator)("EXEC_DEFAULT")
    running.end()
    with pytest.raises(RuntimeError, match="No capture is running"):
        bpy.ops.perfanim.stop_capture("EXEC_DEFAULT")
    with pytest.raises(RuntimeError, match="Select an armature first"):
        bpy.ops.perfanim.use_active_armature("EXEC_DEFAULT")
    with pytest.raises(RuntimeError, match="T pose"):
        bpy.ops.perfanim.calibrate_subject("EXEC_DEFAULT")


def test_messages_are_kept_for_each_panel(running: Any) -> None:
    assert running.message("subject") == ("", "INFO")
    running.set_message("subject", "residual 6 mm")
    running.set_message("cameras", "camera 1 froze", "ERROR")
    assert running.message("subject") == ("residual 6 mm", "INFO")
    assert running.message("cameras") == ("camera 1 froze", "ERROR")


def test_an_armature_that_cannot_be_driven_is_refused(running: Any) -> None:
    armature = bpy.data.objects.new("Other", bpy.data.armatures.new("Other"))
    bpy.context.scene.collection.objects.link(armature)
    bpy.context.view_layer.objects.active = armature
    with pytest.raises(RuntimeError, match="Other: the armature has no bones"):
        bpy.ops.perfanim.use_active_armature("EXEC_DEFAULT")
    assert bpy.context.scene.perfanim.armature is None
    assert running.message("character")[1] == "ERROR"
    assert bpy.ops.perfanim.add_character("EXEC_DEFAULT") == {"FINISHED"}
    assert bpy.context.scene.perfanim.armature.name == "Performer"


def test_a_message_goes_with_the_last_of_what_it_speaks_of(running: Any) -> None:
    one, two = (bpy.data.actions.new(name) for name in ("one", "two"))
    obj = bpy.data.objects.new("Hero", None)
    bpy.context.scene.collection.objects.link(obj)
    running.set_message("takes", "30 frames in one, two", about=(one.name, two.name))
    running.set_message("character", "Hero was chosen", about=("Hero",))
    bpy.data.actions.remove(one)
    assert running.message("takes") == ("30 frames in one, two", "INFO")
    bpy.data.actions.remove(two)
    assert running.message("takes") == ("", "INFO")
    assert running.message("character")[0] == "Hero was chosen"
    bpy.context.scene.collection.objects.unlink(obj)  # as X does; a setting keeps the object in the file
    assert running.messages() == (("", "INFO"), ("", "INFO"))
