"""How motion is put on the character, as is chosen: where its keyframes go, how many there are, from which frame on."""

from typing import Any

import bpy

from ..animation.keyframes import KeyBounds
from ..animation.placement import Onto, Placement

_ONTO = (
    (Onto.ACTION.name, "New Action", "A new action, which takes the place of the one in use; that is kept in the file"),
    (Onto.STRIP.name, "NLA Strip", "A strip on a track of its own, above the action in use, which becomes a strip too"),
    (
        Onto.LAYER.name,
        "Layer",
        "A strip that blends in over what the character plays and out again; what is below shows before and after it",
    ),
)


class PERFANIM_PG_result(bpy.types.PropertyGroup):
    """How motion is put on the character."""

    onto: bpy.props.EnumProperty(
        name="Onto", description="Where the keyframes go", items=_ONTO, default=Onto.ACTION.name
    )
    start: bpy.props.EnumProperty(
        name="Start",
        description="Scene frame on which a take begins",
        items=(
            ("PLAYHEAD", "At Playhead", "At the scene's current frame"),
            ("FIRST", "Frame 1", "At frame 1"),
        ),
        default="PLAYHEAD",
    )
    filters: bpy.props.EnumProperty(
        name="Filters",
        description="Smoothing and foot lock of the keyframes",
        items=(
            (
                "RECORDED",
                "As Recorded",
                "As during the capture; takes that do not store it: as set in the Capture panel",
            ),
            ("CHOSEN", "As Set", "As set in the Capture panel"),
        ),
        default="RECORDED",
    )
    only_selected: bpy.props.BoolProperty(
        name="Selected Bones Only",
        description="Move only the bones that are selected in Pose Mode; the others keep their own animation",
        default=False,
    )
    reduce: bpy.props.BoolProperty(
        name="Fewer Keys",
        description="Leave out keyframes as long as the motion stays within the bounds in every frame",
        default=False,
    )
    reduce_deg: bpy.props.FloatProperty(
        name="Within (°)",
        description="How many degrees each bone may be off, relative to its parent",
        default=0.5,
        min=0.01,
        max=20.0,
    )
    reduce_mm: bpy.props.FloatProperty(
        name="Within (mm)",
        description="How many millimetres the hips may be off",
        default=2.0,
        min=0.01,
        max=200.0,
    )


def placement(
    context: bpy.types.Context, armature_object: bpy.types.Object | None, only: frozenset[str] | None = None
) -> Placement:
    """Return how keyframes are put on an armature.

    Args:
        armature_object: None for a character that is yet to be made, of which no bones are selected.
        only: names of the bones that may get any, None for all.
    """
    chosen = context.scene.perfanim_result
    onto = Onto[chosen.onto]
    bounds = KeyBounds(chosen.reduce_deg, chosen.reduce_mm) if chosen.reduce else None
    if armature_object is None:
        return Placement(onto, None, bounds)
    if chosen.only_selected:
        selected = frozenset(bone.name for bone in armature_object.pose.bones if _selected(bone))
        only = selected if only is None else selected & only
    animation = armature_object.animation_data
    if only is not None and onto is Onto.ACTION and animation is not None and animation.action is not None:
        onto = Onto.STRIP  # a new action would take the other bones' animation away
    return Placement(onto, only, bounds)


def _selected(bone: bpy.types.PoseBone) -> bool:
    return bool(bone.select if bpy.app.version >= (5, 0, 0) else bone.bone.select)


def start_frame(context: bpy.types.Context) -> float:
    """Return the scene's frame on which a take begins."""
    return 1.0 if context.scene.perfanim_result.start == "FIRST" else float(context.scene.frame_current)


def draw(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the choices."""
    chosen: Any = context.scene.perfanim_result
    column = layout.column()
    column.use_property_split = True
    column.use_property_decorate = False
    for name in ("onto", "start", "filters", "only_selected", "reduce"):
        column.prop(chosen, name)
    if chosen.reduce:
        column.prop(chosen, "reduce_deg")
        column.prop(chosen, "reduce_mm")


def register() -> None:
    """Register the choices and hang them on the scene."""
    bpy.utils.register_class(PERFANIM_PG_result)
    bpy.types.Scene.perfanim_result = bpy.props.PointerProperty(type=PERFANIM_PG_result)


def unregister() -> None:
    """Undo `register`."""
    del bpy.types.Scene.perfanim_result
    bpy.utils.unregister_class(PERFANIM_PG_result)
