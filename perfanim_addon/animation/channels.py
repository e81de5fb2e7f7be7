"""Curves of actions: on the action up to Blender 4.3, in slots from 4.4.

The one module that knows: `Action.fcurves` is gone in Blender 5.0.
"""

from collections.abc import Iterator
from typing import Any

import bpy

HAS_SLOTS = bpy.app.version >= (4, 4, 0)


def new_channels(action: bpy.types.Action, armature_object: bpy.types.Object) -> Any:
    """Return a new action's curve container: a slot's channel bag, or the action."""
    if not HAS_SLOTS:
        return action
    slot = action.slots.new(id_type="OBJECT", name=armature_object.name)
    return action.layers.new("Layer").strips.new(type="KEYFRAME").channelbag(slot, ensure=True)


def new_curve(channels: Any, path: str, component: int, group: str) -> bpy.types.FCurve:
    """Add the curve of one property component to a curve container."""
    if not HAS_SLOTS:
        return channels.fcurves.new(path, index=component, action_group=group)
    curve = channels.fcurves.new(path, index=component)
    curve.group = channels.groups.get(group) or channels.groups.new(group)
    return curve


def slot_of(animated: bpy.types.AnimData | bpy.types.NlaStrip) -> Any:
    """Return the slot of the action that is played, None before 4.4."""
    return animated.action_slot if HAS_SLOTS else None


def channels_of(action: bpy.types.Action, slot: Any) -> Iterator[Any]:
    """Yield an action's curve containers: channel bags of a slot, or the action."""
    if not HAS_SLOTS:
        yield action
        return
    for layer in action.layers:
        for strip in layer.strips:
            bag = strip.channelbag(slot) if slot is not None and strip.type == "KEYFRAME" else None
            if bag is not None:
                yield bag


def assign(animation: bpy.types.AnimData, action: bpy.types.Action) -> None:
    """Make an action the active one; the earlier one gets a fake user and is saved."""
    if animation.action is not None:
        animation.action.use_fake_user = True
    animation.action = action
    if HAS_SLOTS:
        animation.action_slot = action.slots[0]


def played(armature_object: bpy.types.Object) -> tuple[Any, ...] | None:
    """Return an armature's animation for `play`, None without any."""
    animation = armature_object.animation_data
    return None if animation is None else (animation.action, slot_of(animation), animation.use_nla)


def play(armature_object: bpy.types.Object, before: tuple[Any, ...] | None) -> None:
    """Restore the animation returned by `played`."""
    if before is None:
        armature_object.animation_data_clear()
        return
    animation = armature_object.animation_data
    animation.action, slot, animation.use_nla = before
    if slot is not None:
        animation.action_slot = slot


def play_only(armature_object: bpy.types.Object, action: bpy.types.Action) -> None:
    """Play an action of an armature without strips, until `play` restores them."""
    animation = armature_object.animation_data or armature_object.animation_data_create()
    animation.use_nla, animation.action = False, action
    if HAS_SLOTS and animation.action_slot is None and len(action.slots):
        animation.action_slot = action.slots[0]
