"""Runs inside Blender: writes what it sees to a file, ten times a second, and follows a few orders.

It never clicks and never calls the add-on's operators unless a test orders it to.
"""

import hashlib
import json
import os
import sys
import time
import traceback
from pathlib import Path

import addon_utils
import blf
import bpy
import gpu
import numpy as np
from mathutils import Euler, Matrix

sys.path.append(str(Path(__file__).resolve().parents[1] / "addon"))

from remains import remains

FOLDER = Path(os.environ["OBSERVER_FOLDER"])
ADDON = "bl_ext.user_default.perfanim"

ticks = 0
orders = 0
answer = {}
changes: list[float] = []  # moments at which the evaluated armature had another pose than before
drawn: list[float] = []  # moments at which the viewport was drawn
_last_pose = b""
_bare = {}


def part(name):
    return sys.modules.get(f"{ADDON}.perfanim_addon.{name}")


def armature():
    return bpy.context.scene.perfanim.armature if hasattr(bpy.context.scene, "perfanim") else None


def pose_bytes(obj):
    bones = obj.pose.bones
    values = np.empty(4 * len(bones), dtype=np.float32)
    bones.foreach_get("rotation_quaternion", values)
    return values.tobytes() + np.array(bones[0].location, dtype=np.float32).tobytes()


def after_update(scene, depsgraph):
    global _last_pose
    obj = scene.perfanim.armature if hasattr(scene, "perfanim") else None
    if obj is None or obj.name not in scene.objects:
        return
    now = pose_bytes(obj)
    if now != _last_pose:
        _last_pose = now
        changes.append(time.perf_counter())


def after_draw():
    drawn.append(time.perf_counter())


def regions():
    found = {}
    for area in bpy.context.window_manager.windows[0].screen.areas:
        if area.type == "VIEW_3D":
            for region in area.regions:
                found[region.type] = [region.x, region.y, region.width, region.height]
                if region.type == "UI":
                    found["tab"] = getattr(region, "active_panel_category", "")
    return found


def browser():
    """Return the folder that a file browser shows, "" without one."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            params = area.spaces.active.params if area.type == "FILE_BROWSER" else None
            if params is not None:
                return params.directory.decode()
    return ""


def capture_facts():
    running, capture = part("running"), part("operators.capture")
    if running is None or capture is None:
        return {"registered": False}
    messages = {panel: text for panel, (text, _icon) in running._state.messages.items()}
    facts = {"registered": True, "messages": messages, "activity": None, "heading": ""}
    activity = running.current()
    facts["timer"] = running._state.timer is not None
    if activity is not None:
        facts["activity"] = type(activity).__name__
        facts["line"] = getattr(activity, "text", "")
        facts["heading"] = getattr(activity, "heading", "")
        run = getattr(activity, "run", None)
        if run is not None:
            facts["phase"] = run.phase.name
            facts["line"] = run.activity
            facts["statistics"] = vars(run.statistics)
            remember(run)
    return facts


def preview_facts():
    preview = part("preview")
    if preview is None:
        return {}
    return {"shown": preview._state.handler is not None, "image": preview.NAME in bpy.data.images}


last_run = None


def remember(run):
    global last_run
    last_run = run


def curves_in(action):
    if hasattr(action, "fcurves"):
        return list(action.fcurves)
    strips = [strip for layer in action.layers for strip in layer.strips]
    return [curve for strip in strips for bag in strip.channelbags for curve in bag.fcurves]


def actions():
    found = {}
    for action in bpy.data.actions:
        curves = curves_in(action)
        keys = [len(curve.keyframe_points) for curve in curves]
        found[action.name] = {
            "curves": len(curves),
            "paths": sorted({curve.data_path.rpartition(".")[2] for curve in curves}),
            "keys_min": min(keys, default=0),
            "keys_max": max(keys, default=0),
            "groups": len({curve.group.name for curve in curves if curve.group}),
        }
    return found


def report():
    global ticks
    ticks += 1
    found = regions()
    colour = bpy.context.preferences.themes[0].user_interface.wcol_tool.inner
    obj = armature()
    state = {
        "ticks": ticks,
        "orders": orders,
        "answer": answer,
        "tab": found.pop("tab", ""),
        "regions": found,
        "browser": browser(),
        "button_colour": [round(255 * c) for c in colour[:3]],
        "capture": capture_facts(),
        "preview": preview_facts(),
        "changes": len(changes),
        "pose": hashlib.sha256(_last_pose).hexdigest(),
        "armature": obj.name if obj else "",
        "actions": actions(),
        "frame_end": bpy.context.scene.frame_end,
    }
    temporary = FOLDER / "state.new"
    temporary.write_text(json.dumps(state))
    temporary.replace(FOLDER / "state.json")


class OBSERVER_OT_bare_timer(bpy.types.Operator):  # noqa: N801
    """Write recorded poses to the same bones at each tick of a 60 Hz timer, and do nothing else"""

    bl_idname = "observer.bare_timer"
    bl_label = "Bare Timer"

    def execute(self, context):
        obj = armature()
        _bare.update(done=False, tick=0, until=time.perf_counter() + _bare["seconds"])
        self._action = obj.animation_data.action
        self._poses = recorded_poses(obj, self._action)
        obj.animation_data.action = None  # as during a capture
        self._timer = context.window_manager.event_timer_add(1 / 60, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        obj = armature()
        rotations, locations = self._poses
        index = _bare["tick"] % len(rotations)
        obj.pose.bones.foreach_set("rotation_quaternion", rotations[index])
        obj.pose.bones[0].location = locations[index]
        _bare["tick"] += 1
        if time.perf_counter() < _bare["until"]:
            return {"PASS_THROUGH"}
        context.window_manager.event_timer_remove(self._timer)
        obj.animation_data.action = self._action
        _bare["done"] = True
        return {"FINISHED"}


def recorded_poses(obj, action):
    places = {bone.name: index for index, bone in enumerate(obj.pose.bones)}
    curves = curves_in(action)
    keys = len(curves[0].keyframe_points)
    rotations = np.zeros((keys, len(places), 4), dtype=np.float32)
    rotations[..., 0] = 1.0
    locations = np.zeros((keys, 3), dtype=np.float32)
    for curve in curves:
        co = np.empty(2 * len(curve.keyframe_points), dtype=np.float32)
        curve.keyframe_points.foreach_get("co", co)
        bone = curve.data_path.split('"')[1]
        if curve.data_path.endswith("rotation_quaternion"):
            rotations[:, places[bone], curve.array_index] = co[1::2]
        else:
            locations[:, curve.array_index] = co[1::2]
    return rotations.reshape(keys, -1), locations


def follow_orders():
    global orders, answer
    try:
        order = json.loads((FOLDER / "order.json").read_text())
    except FileNotFoundError:
        return
    if order["number"] <= orders:
        return
    try:
        result = ORDERS[order["what"]](order)
    except Exception as error:  # the test reads it
        traceback.print_exc()
        result = {"error": f"{type(error).__name__}: {error}"}
    if result is not None:
        answer, orders = result, order["number"]


def order_bare_timer(order):
    if not _bare:
        _bare["seconds"] = order["seconds"]
        window = bpy.context.window_manager.windows[0]
        with bpy.context.temp_override(window=window):
            bpy.ops.observer.bare_timer()
        _bare["start"] = time.perf_counter()
        return None
    if not _bare["done"]:
        return None
    since, until = _bare["start"] + 1.0, _bare["until"] - 0.5
    result = {"ticks": _bare["tick"], "changes_per_s": rate(changes, since, until)}
    _bare.clear()
    return result


def rate(moments, since, until):
    return sum(since <= moment < until for moment in moments) / (until - since)


def order_rates(order):
    """Rates of pose changes and of redraws over the last seconds, less the very last."""
    until = time.perf_counter()
    since = until - order["seconds"]
    return {"changes_per_s": rate(changes, since, until), "drawn_per_s": rate(drawn, since, until)}


def order_last_run(order):
    figures = dict(vars(last_run.statistics))
    poses = last_run.poses
    return {
        "statistics": figures,
        "poses": len(poses),
        "numbers": [pose.number for pose in poses],
        "distinct": len({pose.rotations.tobytes() for pose in poses}),
        "confidence": [round(pose.confidence, 3) for pose in poses],
    }


def order_set(order):
    chosen = bpy.context.scene.perfanim
    for name, value in order["values"].items():
        setattr(chosen, name, bpy.data.objects.get(value) if name == "armature" else value)
    part("running").redraw_sidebars()
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
    "get": order_get,
    "call": order_call,
    "draw_text": order_draw_text,
    "armatures": order_armatures,
    "joints": order_joints,
    "map": order_map,
    "look": order_look,
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


def every_tenth():
    try:
        follow_orders()
        report()
    except Exception:  # Blender never calls a timer again that has raised; the run would hang without a word
        traceback.print_exc()
    return 0.1


bpy.utils.register_class(OBSERVER_OT_bare_timer)
bpy.app.handlers.depsgraph_update_post.append(after_update)
bpy.types.SpaceView3D.draw_handler_add(after_draw, (), "WINDOW", "POST_PIXEL")
bpy.app.timers.register(every_tenth, persistent=True)
