"""Settings for the keyframes of takes, stored in the scene."""

from typing import Any

import bpy

from ..animation.action_placement import Placement, PlacementMode
from ..animation.keyframes import KeyBounds
from ..blender_versions import is_selected
from ..preferences.property_kinds import choice, draw_props, number, property_column, switch, whole_number

_ONTO = (
    (PlacementMode.ACTION.name, "New Action", "Replace the active action, which is kept in the file"),
    (PlacementMode.STRIP.name, "NLA Strip", "Push the active action down and add a strip above it"),
    (PlacementMode.LAYER.name, "Layer", "Add a strip that blends in over the existing animation and out again"),
)


class PERFANIM_PG_result(bpy.types.PropertyGroup):
    """Settings for Put on Character and for captures."""

    attached_to = (bpy.types.Scene, "perfanim_result")
    onto: choice("Insert As", "Destination of the keyframes", _ONTO, default=PlacementMode.ACTION.name)
    start: choice(
        "Start",
        "Scene frame at which a take begins",
        (("PLAYHEAD", "At Playhead", "At the scene's current frame"), ("FIRST", "Frame 1", "At frame 1")),
        "PLAYHEAD",
    )
    on_floor: switch(
        "On Floor",
        "Move the take to the height of its floor, and stand the soles of standing feet exactly on it",
        default=True,
    )
    continue_here: switch(
        "Continue from Here",
        "Begin with the place, heading and pose that the character has in the take's first frame, as a strip above the "
        "present animation",
    )
    blend_frames: whole_number("Blend", "Frames until the pose is that of the take", 20, 1, 1000)
    offset: bpy.props.FloatVectorProperty(
        name="Offset",
        description="Shift of the take in the scene; Z is its height",
        default=(0.0, 0.0, 0.0),
        subtype="TRANSLATION",
        unit="LENGTH",
    )
    turn: bpy.props.FloatProperty(
        name="Turn",
        description="Rotation about the vertical, about the place where the take begins",
        default=0.0,
        subtype="ANGLE",
    )
    whole_frames: switch(
        "Whole Frames", "Insert keyframes on the scene's frames; otherwise one for each recorded pose", default=True
    )
    pictures: switch(
        "Reference Pictures",
        "Also add cameras where the real ones stood, with the take's films or pictures behind them, in time, and sound",
    )
    filters: choice(
        "Filters",
        "Smoothing and foot lock of the keyframes",
        (
            (
                "RECORDED",
                "As Recorded",
                "As during the capture; for takes that do not store this, as set in the Capture panel",
            ),
            ("CHOSEN", "As Set", "As set in the Capture panel"),
        ),
        "RECORDED",
    )
    only_selected: switch(
        "Selected Only", "Animate only the bones selected in Pose Mode; the others keep their own animation"
    )
    doubtful: choice(
        "Doubtful Poses",
        "What to do in frames in which the take lists the pose as probably wrong",
        (
            ("MARK", "Mark", "Insert keyframes of the type Jitter"),
            ("LEAVE_OUT", "Leave Out", "Insert no keyframes, so that the motion is interpolated"),
        ),
        "MARK",
    )
    reduce: switch("Fewer Keys", "Remove keyframes as long as the motion stays within the tolerances in every frame")
    reduce_deg: number("Tolerance (°)", "Largest rotation error of each bone relative to its parent", 0.5, 0.01, 20.0)
    reduce_mm: number("Tolerance (mm)", "Largest location error of the hips", 2.0, 0.01, 200.0)


def placement(
    context: bpy.types.Context, armature_object: bpy.types.Object | None, only: frozenset[str] | None = None
) -> Placement:
    """Return the placement of keyframes on an armature; None stands for a new one.

    Args:
        only: Names of the bones that may get keyframes; None for all.
    """
    chosen = context.scene.perfanim_result
    onto = PlacementMode[chosen.onto]
    bounds = KeyBounds(chosen.reduce_deg, chosen.reduce_mm) if chosen.reduce else None
    if armature_object is None:
        return Placement(onto, None, bounds)
    if chosen.only_selected:
        selected = frozenset(bone.name for bone in armature_object.pose.bones if is_selected(bone))
        only = selected if only is None else selected & only
    animation = armature_object.animation_data
    # a new action would remove the animation that is continued, or that of the other bones
    if (
        (only is not None or chosen.continue_here)
        and onto is PlacementMode.ACTION
        and animation is not None
        and animation.action is not None
    ):
        onto = PlacementMode.STRIP
    return Placement(onto, only, bounds)


def start_frame(context: bpy.types.Context) -> float:
    """Return the first scene frame of a take."""
    return 1.0 if context.scene.perfanim_result.start == "FIRST" else float(context.scene.frame_current)


def draw(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the settings."""
    chosen: Any = context.scene.perfanim_result
    column = property_column(layout)
    draw_props(column, chosen, "onto", "start", "on_floor", "continue_here")
    if chosen.continue_here:
        draw_props(column, chosen, "blend_frames")
    draw_props(column, chosen, "offset", "turn")
    draw_props(column, chosen, "filters", "only_selected", "doubtful", "whole_frames", "pictures", "reduce")
    if chosen.reduce:
        draw_props(column, chosen, "reduce_deg", "reduce_mm")
