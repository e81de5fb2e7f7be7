"""Paths that controls of a sketch follow, such as the hips' path on the floor."""

import bpy

from ...core.errors import SettingsError
from ..animation.actions import scene_fps
from ..blender_versions import action_curves
from ..character.selection import leave_modes, select_only
from .controls import EDITING, controls_of


def add_path(context: bpy.types.Context, armature_object: bpy.types.Object) -> bpy.types.Object:
    """Add an empty curve on the floor, in Edit Mode with the Draw tool."""
    leave_modes(context)
    data = bpy.data.curves.new(f"Hips Path of {armature_object.name}", "CURVE")
    data.dimensions = "3D"
    path = bpy.data.objects.new(data.name, data)
    path.location.z = armature_object.matrix_world.translation.z
    context.scene.collection.objects.link(path)
    select_only(context, [path])
    bpy.ops.object.mode_set(mode="EDIT")
    context.tool_settings.curve_paint_settings.depth_mode = "CURSOR"
    context.scene.cursor.location = path.location
    regions = [each for each in context.area.regions if each.type == "WINDOW"] if context.area is not None else []
    if regions and context.area.type == "VIEW_3D":
        with context.temp_override(area=context.area, region=regions[0]):
            bpy.ops.view3d.view_axis(type="TOP")
            bpy.ops.wm.tool_set_by_id(name="builtin.draw")
    return path


def follow(
    context: bpy.types.Context, armature_object: bpy.types.Object, control: bpy.types.Object, path: bpy.types.Object
) -> tuple[int, int]:
    """Make a control follow a curve at constant speed; return the first and last frame.

    The control keeps its height above the curve's origin; hips on a flat curve at the height of the character's origin
    are free in height. The motion takes the time span of the other controls' keys; without keys it runs at walking
    speed from the current frame on. The control's own keys are removed.

    Raises:
        SettingsError: The curve has no length.
    """
    leave_modes(context)
    context.view_layer.update()
    length = sum(spline.calc_length() for spline in path.data.splines) * path.matrix_world.median_scale
    if length <= 0.0:
        raise SettingsError("has no length", where=path.name, advice="draw it in Edit Mode first")
    height = control.matrix_world.translation.z - path.matrix_world.translation.z
    others = [each for each in controls_of(armature_object).values() if each != control]
    frames = sorted(key.co.x for each in others for curve in action_curves(each) for key in curve.keyframe_points)
    first = round(frames[0]) if frames else context.scene.frame_current
    walked = first + max(1, round(length / EDITING.walk_speed * scene_fps(context.scene)))
    last = round(frames[-1]) if frames and frames[-1] > first else walked
    if control == controls_of(armature_object).get("root"):
        armature_object.perfanim_sketch.free_height = _is_on_floor(path, armature_object)
    control.animation_data_clear()
    for old in [each for each in control.constraints if each.type == "FOLLOW_PATH"]:
        control.constraints.remove(old)
    control.location = (0.0, 0.0, height)
    held = control.constraints.new("FOLLOW_PATH")
    held.target, held.use_fixed_location = path, True
    path.data.update_tag()  # Blender evaluates a path only once something follows it
    for frame, share in ((first, 0.0), (last, 1.0)):
        held.offset_factor = share
        held.keyframe_insert("offset_factor", frame=frame)
    for key in (key for curve in action_curves(control) for key in curve.keyframe_points):
        key.interpolation = "LINEAR"
    return first, last


def _is_on_floor(path: bpy.types.Object, armature_object: bpy.types.Object) -> bool:
    """Return whether a curve lies flat at the height of the character's origin."""
    floor = armature_object.matrix_world.translation.z
    splines = path.data.splines
    points = [point.co for spline in splines for point in (spline.bezier_points or spline.points)]
    tolerance = EDITING.flat * armature_object.matrix_world.median_scale
    return all(abs((path.matrix_world @ point.to_3d()).z - floor) < tolerance for point in points)
