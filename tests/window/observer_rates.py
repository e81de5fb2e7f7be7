"""How often the character's pose changes, how often the viewport is drawn, and a bare timer to compare with."""

import hashlib
import time

import bpy
import numpy as np
from observer_state import armature, curves_in

changes: list[float] = []  # moments at which the evaluated armature had another pose than before
drawn: list[float] = []  # moments at which the viewport was drawn
_last_pose = b""
_bare = {}


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


def last_pose():
    """Return a text that stands for the last pose that was seen."""
    return hashlib.sha256(_last_pose).hexdigest()


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


def watch():
    """Begin to count."""
    bpy.utils.register_class(OBSERVER_OT_bare_timer)
    bpy.app.handlers.depsgraph_update_post.append(after_update)
    bpy.types.SpaceView3D.draw_handler_add(after_draw, (), "WINDOW", "POST_PIXEL")
