"""Parts of Blender's API that differ between the supported versions.

Up to Blender 4.3 an action holds its curves itself, from 4.4 on in one channel bag per slot; `Action.fcurves` was
removed in 5.0.
"""

from collections.abc import Iterable, Iterator
from typing import Any

import bpy

_HAS_SLOTS = bpy.app.version >= (4, 4, 0)
_IS_5 = bpy.app.version >= (5, 0, 0)


def new_channels(action: bpy.types.Action, animated: bpy.types.Object) -> Any:
    """Return the curve container of a new action: a slot's channel bag, or the action."""
    if not _HAS_SLOTS:
        return action
    slot = action.slots.new(id_type="OBJECT", name=animated.name)
    return action.layers.new("Layer").strips.new(type="KEYFRAME").channelbag(slot, ensure=True)


def new_curve(channels: Any, path: str, component: int, group: str) -> bpy.types.FCurve:
    """Add the curve for one component of a property to a curve container."""
    if not _HAS_SLOTS:
        return channels.fcurves.new(path, index=component, action_group=group)
    curve = channels.fcurves.new(path, index=component)
    curve.group = channels.groups.get(group) or channels.groups.new(group)
    return curve


def slot_of(animated: bpy.types.AnimData | bpy.types.NlaStrip) -> Any:
    """Return the slot of the action that is being played, or None before 4.4."""
    return animated.action_slot if _HAS_SLOTS else None


def first_slot(action: bpy.types.Action) -> Any:
    """Return the first slot of an action, or None without slots."""
    return action.slots[0] if _HAS_SLOTS and len(action.slots) else None


def set_slot(animated: bpy.types.AnimData | bpy.types.NlaStrip, slot: Any) -> None:
    """Play a slot of the action; None lets Blender choose."""
    if slot is not None:
        animated.action_slot = slot


def channels_of(action: bpy.types.Action, slot: Any) -> Iterator[Any]:
    """Yield an action's curve containers: channel bags of a slot, or the action."""
    if not _HAS_SLOTS:
        yield action
        return
    for layer in action.layers:
        for strip in layer.strips:
            bag = strip.channelbag(slot) if slot is not None and strip.type == "KEYFRAME" else None
            if bag is not None:
                yield bag


def curves_of(action: bpy.types.Action, slot: Any) -> list[bpy.types.FCurve]:
    """Return the curves of an action's slot."""
    return [curve for channels in channels_of(action, slot) for curve in channels.fcurves]


def action_curves(animated: bpy.types.Object) -> list[bpy.types.FCurve]:
    """Return the curves of an object's action, none if it has no action."""
    animation = animated.animation_data
    if animation is None or animation.action is None:
        return []
    return curves_of(animation.action, slot_of(animation))


def by_channel(curves: Iterable[bpy.types.FCurve]) -> dict[tuple[str, int], bpy.types.FCurve]:
    """Return curves by data path and component."""
    return {(curve.data_path, curve.array_index): curve for curve in curves}


def sequencer_strips(scene: bpy.types.Scene) -> Any:
    """Return the strips of a scene's sequencer, which is added if there is none; up to 4.3 they have another name."""
    editor = scene.sequence_editor or scene.sequence_editor_create()
    return editor.strips if _HAS_SLOTS else editor.sequences


def detach_action(animation: bpy.types.AnimData) -> None:
    """Detach the active action, if there is one; a fake user keeps it in the file."""
    if animation.action is not None:
        animation.action.use_fake_user = True
        animation.action = None


def assign(animation: bpy.types.AnimData, action: bpy.types.Action) -> None:
    """Make an action the active one; the previous one stays in the file."""
    detach_action(animation)
    animation.action = action
    set_slot(animation, first_slot(action))


def played(animated: bpy.types.Object) -> tuple[Any, ...] | None:
    """Return an object's animation for `play`, or None if there is none."""
    animation = animated.animation_data
    return None if animation is None else (animation.action, slot_of(animation), animation.use_nla)


def play(animated: bpy.types.Object, before: tuple[Any, ...] | None) -> None:
    """Restore the animation returned by `played`."""
    if before is None:
        animated.animation_data_clear()
        return
    animation = animated.animation_data
    animation.action, slot, animation.use_nla = before
    set_slot(animation, slot)


def play_only(animated: bpy.types.Object, action: bpy.types.Action) -> None:
    """Play an action of an object without NLA strips, until `play` restores them."""
    animation = animated.animation_data or animated.animation_data_create()
    animation.use_nla, animation.action = False, action
    if slot_of(animation) is None:
        set_slot(animation, first_slot(action))


def is_selected(bone: bpy.types.PoseBone) -> bool:
    """Return whether a bone is selected in Pose Mode."""
    return bool((bone if _IS_5 else bone.bone).select)


def enable_nodes(owner: bpy.types.Material | bpy.types.World) -> None:
    """Enable shader nodes, which are always enabled from 5.0 on."""
    if not _IS_5:
        owner.use_nodes = True


def texture_options() -> dict[str, bool]:
    """Return the options of `draw_texture_2d` for sRGB images: from 5.0 on, the viewport does not encode colours."""
    return {"is_scene_linear_with_rec709_srgb_target": True} if _IS_5 else {}
