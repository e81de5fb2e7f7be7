"""What the observer does when a test orders it."""

import os
from pathlib import Path

import addon_utils
import blf
import bpy
import gpu
import numpy as np
import observer_state
from mathutils import Euler, Matrix
from observer_rates import order_bare_timer, order_rates
from observer_state import ADDON, armature, part
from remains import remains

FOLDER = Path(os.environ["OBSERVER_FOLDER"])


def order_last_run(order):
    figures = dict(vars(observer_state.last_run.statistics))
    poses = [pose.performers[0] for pose in observer_state.last_run.poses]
    return {
        "statistics": figures,
        "poses": len(poses),
        "numbers": [pose.number for pose in poses],
        "distinct": len({pose.rotations.tobytes() for pose in poses}),
        "confidence": [round(pose.confidence, 3) for pose in poses],
    }


def order_set(order):
    chosen = getattr(bpy.context.scene, order.get("group", "perfanim"))
    for name, value in order["values"].items():
        value = set(value) if isinstance(value, list) else value
        setattr(chosen, name, bpy.data.objects.get(value) if name == "armature" else value)
    part("jobs.activity").redraw_sidebars()
    return {}


def order_preference(order):
    """Change a setting of the add-on's preferences."""
    setattr(bpy.context.preferences.addons[ADDON].preferences, order["name"], order["value"])
    return {}


def order_get(order):
    return {"value": getattr(bpy.context.scene.perfanim, order["name"])}


def order_call(order):
    """Call an operator as a button does, and tell how it ended."""
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    with bpy.context.temp_override(window=window, area=area):
        operator = getattr(bpy.ops.perfanim, order["operator"])
        try:
            return {"result": list(operator("EXEC_DEFAULT", **order.get("arguments", {})))}
        except RuntimeError as error:
            return {"error": str(error)}


def order_drop(order):
    """Drop files on the 3D viewport: what Blender calls when it gets them from the system."""
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    region = next(region for region in area.regions if region.type == "WINDOW")
    files = [Path(path) for path in order["paths"]]
    with bpy.context.temp_override(window=window, area=area, region=region):
        bpy.ops.wm.drop_import_file(
            "INVOKE_DEFAULT", directory=str(files[0].parent), files=[{"name": path.name} for path in files]
        )
    return {}


def order_click(order):
    """Invoke an operator as a button does, which goes on by itself."""
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    with bpy.context.temp_override(window=window, area=area):
        getattr(bpy.ops.perfanim, order["operator"])("INVOKE_DEFAULT")
    return {}


def order_targets(order):
    """Set the kinds of the additional targets, and the armature of further characters."""
    for entry, kind in zip(bpy.context.scene.perfanim_targets.entries, order["kinds"], strict=True):
        entry.kind = kind
        entry.armature = bpy.data.objects[order["armature"]] if kind == "CHARACTER" else None
    return {}


def order_draw_text(order):
    """Draw a text as buttons show it, and keep its pixels (height, width) in a file."""
    preferences = bpy.context.preferences
    size = preferences.ui_styles[0].widget.points * preferences.system.ui_scale
    blf.size(0, size)
    width, height = int(blf.dimensions(0, order["text"])[0]) + 4, int(1.6 * size)
    offscreen = gpu.types.GPUOffScreen(width, height)
    with offscreen.bind():
        frame = gpu.state.active_framebuffer_get()
        frame.clear(color=(0.0, 0.0, 0.0, 1.0))
        with gpu.matrix.push_pop():
            gpu.matrix.load_matrix(Matrix.Identity(4))
            across, up = (2.0 / width, 0, 0, -1), (0, 2.0 / height, 0, -1)
            gpu.matrix.load_projection_matrix(Matrix((across, up, (0, 0, 1, 0), (0, 0, 0, 1))))
            gpu.state.blend_set("ALPHA")
            blf.position(0, 2, int(0.45 * size), 0)
            blf.color(0, 1.0, 1.0, 1.0, 1.0)
            blf.draw(0, order["text"])
        pixels = frame.read_color(0, 0, width, height, 4, 0, "UBYTE")
    offscreen.free()
    pixels.dimensions = width * height * 4
    path = FOLDER / "text.npy"
    np.save(path, np.array(pixels, dtype=np.uint8).reshape(height, width, 4)[::-1, :, 0])
    return {"path": str(path)}


def order_joints(order):
    """Tell where bones of an object are in the scene, frame after frame."""
    scene, obj, found = bpy.context.scene, bpy.data.objects[order["object"]], []
    before = scene.frame_current
    for frame in order["frames"]:
        scene.frame_set(int(np.floor(frame)), subframe=frame - np.floor(frame))
        posed = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
        found.append([list(posed.matrix_world @ posed.pose.bones[name].head) for name in order["bones"]])
    scene.frame_set(before)
    return {"joints": found}


def order_armatures(order):
    """Tell the bones of each armature."""
    return {obj.name: [bone.name for bone in obj.data.bones] for obj in bpy.data.objects if obj.type == "ARMATURE"}


def order_map(order):
    """Tell which bones of the chosen armature stand for which joints, and how sure that is."""
    kept = armature().perfanim_character.joints
    return {entry.name: [entry.bone, entry.state] for entry in kept}


def order_through(order):
    """Look through a camera at a frame, as with Ctrl 0."""
    bpy.context.scene.camera = bpy.data.objects[order["camera"]]
    bpy.context.scene.frame_set(order["frame"])
    for area in bpy.context.window_manager.windows[0].screen.areas:
        if area.type == "VIEW_3D":
            area.spaces.active.region_3d.view_perspective = "CAMERA"
            area.tag_redraw()
    return {}


def order_look(order):
    """Turn the viewport to the chosen character as it is at a frame, and hide all others."""
    scene, obj = bpy.context.scene, armature()
    scene.frame_set(order["frame"])
    for other in bpy.context.view_layer.objects:
        mine = other in (obj, obj.parent) or other.find_armature() == obj or other.parent == obj
        other.hide_set(not mine)
    posed = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mapped = [entry.bone for entry in obj.perfanim_character.joints if entry.bone]
    heads = np.array([obj.matrix_world @ posed.pose.bones[name].head for name in mapped])
    low, high = heads.min(axis=0), heads.max(axis=0)
    for group in obj.data.collections_all if "DEF" in obj.data.collections_all else ():
        group.is_visible = group.name == "DEF"  # of a control rig what its mesh would follow
    for area in bpy.context.window_manager.windows[0].screen.areas:
        if area.type == "VIEW_3D":
            view = area.spaces.active.region_3d
            view.view_rotation = Euler((np.radians(80.0), 0.0, np.radians(order["around_deg"]))).to_quaternion()
            view.view_location, view.view_distance = (low + high) / 2.0, 1.8 * np.linalg.norm(high - low)
            area.tag_redraw()
    return {}


def order_bare_armature(order):
    armature_data = bpy.data.armatures.new("Other")
    obj = bpy.data.objects.new("Other", armature_data)
    bpy.context.scene.collection.objects.link(obj)
    return {"name": obj.name}


def order_remains(order):
    """Tell what of the add-on hangs on Blender, and whether the add-on is on."""
    found = remains()
    handlers = [name for names in found.pop("handlers", {}).values() for name in names if "perfanim" in name]
    return {**found, "handlers": handlers}


def order_addon(order):
    """Switch the add-on, or another, on or off."""
    switch = addon_utils.enable if order["on"] else addon_utils.disable
    switch(order.get("name", ADDON), default_set=True)
    return {}


def order_workspace(order):
    """Show another workspace in the window, as a click on its tab does."""
    bpy.context.window_manager.windows[0].workspace = bpy.data.workspaces[order["name"]]
    return {}


def order_remove_armature(order):
    bpy.data.objects.remove(armature())
    return {}


def order_step(order):
    """Do something that undo takes back: add an object."""
    bpy.context.scene.collection.objects.link(bpy.data.objects.new(order["name"], None))
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        bpy.ops.ed.undo_push(message=order["name"])
    return {}


def order_undo(order):
    """Undo or redo, and tell which objects there are."""
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        getattr(bpy.ops.ed, order["operator"])()
    return {"objects": [obj.name for obj in bpy.data.objects]}


def order_new_file(order):
    window = bpy.context.window_manager.windows[0]
    with bpy.context.temp_override(window=window):
        bpy.ops.wm.read_homefile(app_template="")
    return {}


def order_quit(order):
    """Quit as soon as the answer is written."""
    bpy.app.timers.register(bpy.ops.wm.quit_blender, first_interval=0.5)
    return {}


ORDERS = {
    "bare_timer": order_bare_timer,
    "rates": order_rates,
    "last_run": order_last_run,
    "set": order_set,
    "preference": order_preference,
    "get": order_get,
    "call": order_call,
    "click": order_click,
    "targets": order_targets,
    "draw_text": order_draw_text,
    "drop": order_drop,
    "armatures": order_armatures,
    "joints": order_joints,
    "map": order_map,
    "look": order_look,
    "through": order_through,
    "bare_armature": order_bare_armature,
    "remains": order_remains,
    "addon": order_addon,
    "workspace": order_workspace,
    "remove_armature": order_remove_armature,
    "step": order_step,
    "undo": order_undo,
    "new_file": order_new_file,
    "quit": order_quit,
}
