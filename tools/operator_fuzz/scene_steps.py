"""Steps without the add-on: objects, modes, files, undo, the timeline."""

import random
from pathlib import Path
from typing import Any

import bpy

_KEPT = 3  # number of saved .blend files


def some_object(chance: random.Random) -> Any:
    """Return an object of the scene, or None if it is empty."""
    objects = list(bpy.context.view_layer.objects)
    return chance.choice(objects) if objects else None


def remove_object(chance: random.Random, folder: Path) -> None:
    """Delete an object."""
    found = some_object(chance)
    if found is not None:
        bpy.data.objects.remove(found)


def remove_data(chance: random.Random, folder: Path) -> None:
    """Delete an action, mesh, armature or collection that something may be using."""
    kind = chance.choice((bpy.data.actions, bpy.data.armatures, bpy.data.meshes, bpy.data.collections))
    if len(kind):
        kind.remove(chance.choice(list(kind)))


def rename(chance: random.Random, folder: Path) -> None:
    """Rename an object, its data or a bone."""
    found = some_object(chance)
    if found is None:
        return
    name = chance.choice(("Performer", "Other", "x" * 63, "Ä", "Prop", ""))
    which = chance.randrange(3)
    if which == 0:
        found.name = name
    elif found.data is not None and which == 1:
        found.data.name = name
    elif found.type == "ARMATURE" and len(found.data.bones):
        chance.choice(list(found.data.bones)).name = name


def choose(chance: random.Random, folder: Path) -> None:
    """Make an object active and select it, or deselect everything."""
    bpy.ops.object.select_all(action="DESELECT")
    found = some_object(chance)
    bpy.context.view_layer.objects.active = found
    if found is not None:
        found.select_set(True)


def change_mode(chance: random.Random, folder: Path) -> None:
    """Switch to another mode with the active object."""
    active = bpy.context.view_layer.objects.active
    if active is not None:
        modes = ("OBJECT", "POSE", "EDIT") if active.type == "ARMATURE" else ("OBJECT",)
        bpy.ops.object.mode_set(mode=chance.choice(modes))


def add_object(chance: random.Random, folder: Path) -> None:
    """Add an armature without bones, an empty or a curve."""
    kind = chance.randrange(3)
    data = (bpy.data.armatures.new("Bare"), None, bpy.data.curves.new("Path", "CURVE"))[kind]
    added = bpy.data.objects.new("Added", data)
    bpy.context.scene.collection.objects.link(added)
    parent = some_object(chance)
    if chance.random() < 0.3 and parent is not None and parent != added:
        added.parent = parent


def duplicate(chance: random.Random, folder: Path) -> None:
    """Copy an object with or without its data."""
    found = some_object(chance)
    if found is not None:
        copied = found.copy()
        if found.data is not None and chance.random() < 0.5:
            copied.data = found.data.copy()
        bpy.context.scene.collection.objects.link(copied)


def key_object(chance: random.Random, folder: Path) -> None:
    """Move an object and key it."""
    found = some_object(chance)
    if found is not None:
        found.location = [chance.uniform(-3.0, 3.0) for _ in range(3)]
        found.keyframe_insert("location", frame=chance.choice((-10, 1, 5, 30, 31.5)))


def change_time(chance: random.Random, folder: Path) -> None:
    """Go to another frame, or change the scene's rate or unit."""
    scene = bpy.context.scene
    scene.frame_set(chance.choice((-100, 0, 1, 10, 100_000)))
    scene.render.fps = chance.choice((1, 24, 60, 240))
    scene.unit_settings.scale_length = chance.choice((1.0, 0.01, 100.0))


def change_scene(chance: random.Random, folder: Path) -> None:
    """Add a scene, or delete the current one."""
    if chance.random() < 0.5 or len(bpy.data.scenes) < 2:
        added = bpy.data.scenes.new("Second")
        if bpy.context.window is not None:
            bpy.context.window.scene = added
    else:
        bpy.data.scenes.remove(bpy.context.scene)


def push_undo(chance: random.Random, folder: Path) -> None:
    """Set an undo point."""
    bpy.ops.ed.undo_push(message="step")


def undo(chance: random.Random, folder: Path) -> None:
    """Undo once or more."""
    for _ in range(chance.choice((1, 1, 3))):
        if bpy.ops.ed.undo.poll():
            bpy.ops.ed.undo()


def redo(chance: random.Random, folder: Path) -> None:
    """Redo once."""
    if bpy.ops.ed.redo.poll():
        bpy.ops.ed.redo()


def new_file(chance: random.Random, folder: Path) -> None:
    """Load an empty scene or Blender's startup file."""
    bpy.ops.wm.read_homefile(use_empty=chance.random() < 0.5, use_factory_startup=chance.random() < 0.5)


def save_file(chance: random.Random, folder: Path) -> None:
    """Save the scene."""
    path = folder / f"saved-{chance.randrange(_KEPT)}.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=chance.random() < 0.5, check_existing=False)


def open_file(chance: random.Random, folder: Path) -> None:
    """Open a saved scene."""
    path = folder / f"saved-{chance.randrange(_KEPT)}.blend"
    if path.is_file():
        bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=chance.random() < 0.3, use_scripts=False)


def render(chance: random.Random, folder: Path) -> None:
    """Render a tiny picture, or two of an animation, with Cycles, which needs no window."""
    scene = bpy.context.scene
    if scene.camera is None:
        scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
        scene.collection.objects.link(scene.camera)
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 1
    scene.render.resolution_x = scene.render.resolution_y = 16
    scene.render.resolution_percentage = 100
    scene.frame_start, scene.frame_end = 1, 2
    scene.render.filepath = str(folder / "rendered-")
    if chance.random() < 0.3:
        bpy.ops.render.render(animation=True)
    else:
        in_background = bpy.context.window is not None and chance.random() < 0.5
        bpy.ops.render.render("INVOKE_DEFAULT" if in_background else "EXEC_DEFAULT")


def change_windows(chance: random.Random, folder: Path) -> str:
    """Open a second window, or close one of several."""
    windows = list(bpy.context.window_manager.windows)
    if bpy.context.window is None or not windows:
        return "none"
    if len(windows) == 1:
        bpy.ops.wm.window_new()
        return "opened"
    # not a main window: Blender exits with the last of them, as it should
    children = [window for window in windows if window.parent]
    if not children:
        return "none"
    with bpy.context.temp_override(window=chance.choice(children)):
        bpy.ops.wm.window_close()
    return "closed"


# step -> relative frequency
SCENE_STEPS = {
    remove_object: 4,
    remove_data: 3,
    rename: 4,
    choose: 6,
    change_mode: 4,
    add_object: 3,
    duplicate: 2,
    key_object: 4,
    change_time: 2,
    change_scene: 1,
    push_undo: 6,
    undo: 6,
    redo: 3,
    new_file: 1,
    save_file: 1,
    open_file: 1,
    render: 1,
    change_windows: 2,
}
